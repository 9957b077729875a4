"""Do files that were made to harm harm nothing? Pipes, bombs, links, code, damage."""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import struct
import threading
import time
import tracemalloc
import zipfile

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from bulgefit.dic import hdf5_apart, read_test, write_test
from bulgefit.dic.keyed_arrays import need_memory
from bulgefit.errors import InputError

SPECIMEN = {"radius": 100.0, "thickness": 0.81}
#: Seconds of a processor after which a reader hangs, however slow the machine is, and with every
#: allocation traced. `benchmarks/fuzz.py` holds readers to 5 s as they are.
HANGS = 60.0


def refused(path, match, **options):
    """The message, where it takes neither memory nor time to refuse the file."""
    began = time.process_time()
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=match) as caught:
            read_test(path, **options)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    size = path.stat().st_size if path.is_file() else 0
    assert peak < 4 * size + 200e6
    assert time.process_time() - began < HANGS
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000
    return str(caught.value)


# ---- what is no file ----


@pytest.mark.parametrize("name", ["t.npz", "t.h5", "t.npy", "t.pkl"])
def test_a_pipe_is_not_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    done = threading.Event()

    def read():
        refused(tmp_path / name, "regular file")
        done.set()

    threading.Thread(target=read, daemon=True).start()
    assert done.wait(5)


@pytest.mark.parametrize("format", ["npz", "hdf5", "study"])
def test_a_device_is_not_read(tmp_path, format):
    (tmp_path / "t").symlink_to("/dev/zero")
    refused(tmp_path / "t", "regular file", format=format)


def test_a_folder_with_a_pipe_or_a_link_out_of_it(csv_folder, tmp_path):
    folder = csv_folder()
    (folder / "frame_3.csv").rename(tmp_path / "outside.csv")
    (folder / "frame_3.csv").symlink_to(tmp_path / "outside.csv")
    refused(folder, "frame_3.csv is a link out of the folder")
    (folder / "frame_3.csv").unlink()
    os.mkfifo(folder / "frame_3.csv")
    refused(folder, "frame_3.csv, which is not in the folder")


def test_a_link_within_the_folder_is_followed(csv_folder):
    folder = csv_folder()
    (folder / "frame_3.csv").rename(folder / "kept")
    (folder / "frame_3.csv").symlink_to("kept")
    assert read_test(folder).n_frames == 6


# ---- npz ----


def zip_of(path, members, method=zipfile.ZIP_DEFLATED):
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)


def npy_header(shape, dtype="<f8"):
    head = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}"
    head = head.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


def test_npz_bomb(made, tmp_path):
    """1.4 GB of zeros in 1.4 MB, which the header tells."""
    path = tmp_path / "t.npz"
    np.savez_compressed(path, reference=made.reference, pressure=made.pressure, **SPECIMEN)
    count = 1_400_000_000 // 24
    with (
        zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("displacement.npy", "w", force_zip64=True) as member,
    ):
        member.write(npy_header((1, count, 3)))
        for _ in range(14):
            member.write(bytes(100_000_000))
    refused(path, r"displacement has shape \(1, 5.833e\+07, 3\), which takes 4.2 GB")


def test_npz_that_is_longer_or_shorter_than_its_header(made, tmp_path):
    path, whole = tmp_path / "t.npz", io.BytesIO()
    np.lib.format.write_array(whole, made.displacement)
    for content in (whole.getvalue() + bytes(10_000_000), whole.getvalue()[:-8]):
        np.savez(path, reference=made.reference, pressure=made.pressure, **SPECIMEN)
        with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("displacement.npy", content)
        refused(path, "an array (goes on after|ends before) its last number")


def test_npz_of_a_million_members(tmp_path):
    path = tmp_path / "t.npz"
    zip_of(path, {"pressure.npy": npy_header("(1,)") + bytes(8)})
    whole = bytearray(path.read_bytes())
    # the end record tells the directory's size; the directory follows the members
    whole[-10:-6] = struct.pack("<L", 50_000_000)
    path.write_bytes(whole)
    refused(path, "far too many members")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_npz_with_other_compressions(tmp_path, method):
    zip_of(tmp_path / "t.npz", {"pressure.npy": npy_header("(1,)") + bytes(8)}, method)
    refused(tmp_path / "t.npz", "compressed in an unknown way")


def test_npz_with_far_too_many_frames(tmp_path):
    np.savez_compressed(
        tmp_path / "t.npz",
        reference=np.zeros((1, 3)),
        displacement=np.zeros((1, 3)),
        frame=np.zeros(1, int),
        pressure=np.zeros(1_000_000),
        **SPECIMEN,
    )
    refused(tmp_path / "t.npz", "1000000 pressures")


def test_memory_is_counted_together():
    left = need_memory((10, 3), np.dtype(np.float64), 1000, "t")
    assert left == 1000 - 10 * 3 * 24
    assert need_memory((10,), np.dtype(np.float32), 120, "t") == 0
    with pytest.raises(InputError, match="t has shape"):
        need_memory((10, 3), np.dtype(np.float64), left, "t")


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_large_honest_files_are_read_within_bounds(tmp_path, suffix, kind):
    rng = np.random.default_rng(0)
    reference = rng.uniform(-60, 60, (40_000, 3))
    arrays = {
        "reference": reference,
        "displacement": rng.normal(0, 1, (40, 40_000, 3)).astype(kind),
        "pressure": np.linspace(0.01, 0.3, 40),
        **SPECIMEN,
    }
    path = tmp_path / f"t{suffix}"
    if suffix == ".npz":
        np.savez(path, **arrays)
    else:
        with h5py.File(path, "w") as file:
            for key, value in arrays.items():
                file[key] = value
    del arrays
    tracemalloc.start()
    try:
        test = read_test(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * path.stat().st_size
    assert test.n_points == 40_000
    assert test.checksum == hashlib.sha256(path.read_bytes()).hexdigest()


def test_npz_in_fortran_order_and_other_bytes(made, tmp_path):
    np.savez(
        tmp_path / "t.npz",
        reference=np.asfortranarray(made.reference),
        displacement=np.asfortranarray(made.displacement.astype(">f4")),
        pressure=made.pressure,
        **SPECIMEN,
    )
    block = read_test(tmp_path / "t.npz").blocks[0]
    np.testing.assert_array_equal(block.reference, made.reference)
    np.testing.assert_array_equal(block.displacement, made.displacement.astype(np.float32))


def test_names_of_members_stay_on_one_line(tmp_path):
    members = {"a\nb.npy": b"", "\x1b[31m.npy": b"", "c" * 300: b""}
    zip_of(tmp_path / "t.npz", {**members, **{f"n{i}": b"" for i in range(50)}})
    said = refused(tmp_path / "t.npz", "not a bulge test")
    assert said.isprintable()


# ---- HDF5 ----


@pytest.fixture
def hdf5(made, tmp_path):
    """Write a good file, without one data set."""

    def write(left_out):
        path = tmp_path / "t.h5"
        with h5py.File(path, "w") as file:
            for key, value in {**vars(made), **SPECIMEN}.items():
                if key != left_out:
                    file[key] = value
        return path

    return write


def test_hdf5_with_external_storage(hdf5, tmp_path):
    path = hdf5("pressure")
    secret = tmp_path / "secret"
    secret.write_bytes(np.linspace(0.01, 0.3, 6).tobytes())
    with h5py.File(path, "a") as file:
        file.create_dataset("pressure", (6,), "f8", external=[(str(secret), 0, 48)])
    refused(path, "pressure stands in another file, which is not read")


def test_hdf5_with_links(hdf5, made, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["pressure"] = made.pressure
    for link in (h5py.ExternalLink("other.h5", "/pressure"), h5py.SoftLink("/elsewhere")):
        path = hdf5("pressure")
        with h5py.File(path, "a") as file:
            file["elsewhere"] = made.pressure
            file["pressure"] = link
        refused(path, "pressure is a link, which is not followed")


def test_hdf5_with_a_virtual_data_set(hdf5, made, tmp_path):
    path = hdf5("pressure")
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["pressure"] = made.pressure
    layout = h5py.VirtualLayout((6,), "f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "pressure", (6,))
    with h5py.File(path, "a") as file:
        file.create_virtual_dataset("pressure", layout)
    refused(path, "pressure stands in another file")


@pytest.mark.parametrize("chunks", [None, (1, 4096, 3)])
def test_hdf5_bomb(hdf5, chunks):
    path = hdf5("displacement")
    with h5py.File(path, "a") as file:
        # never written: nothing of it stands in the file
        options = {"chunks": chunks, "compression": "gzip"} if chunks else {}
        file.create_dataset("displacement", (6, 20_000_000, 3), "f8", **options)
    refused(path, "displacement has shape .* out of all proportion")


def test_hdf5_with_chunks_larger_than_itself(hdf5):
    path = hdf5("pressure")
    with h5py.File(path, "a") as file:
        file.create_dataset(
            "pressure", (6,), "f8", maxshape=(None,), chunks=(400_000_000,), compression="gzip"
        )
    refused(path, "pressure has chunks far larger than itself")


def test_hdf5_unit_of_any_length(hdf5, made):
    path = hdf5("pressure")
    with h5py.File(path, "a") as file:
        file["pressure"] = made.pressure
        file["pressure"].attrs["unit"] = "bar\n" * 10_000
    refused(path, "pressure has the unit 'bar")


def test_hdf5_takes_no_module_from_where_it_runs(hdf5, made, tmp_path, monkeypatch):
    path = hdf5("")
    (tmp_path / "h5py.py").write_text("open('ran', 'w').close()")
    monkeypatch.chdir(tmp_path)
    assert read_test(path).n_frames == 6
    assert not (tmp_path / "ran").exists()


def test_hdf5_on_which_its_library_does_not_end(hdf5, monkeypatch):
    path = hdf5("")
    start = hdf5_apart._START.split("from bulgefit")[0]
    for what, why in (
        ("while True: pass", "does not come to an end"),
        ("import os; os.kill(os.getpid(), 11)", "fails on it"),
    ):
        limit = "from bulgefit.dic.hdf5_answers import _limit; _limit(10**9, -10**7)\n"
        monkeypatch.setattr(hdf5_apart, "_START", start + "\n" + limit + what)
        refused(path, f"damaged HDF5 file .*{why}")


# ---- pickles ----


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x04" + b"]r\xff\xff\xff\x7f.",  # memorised under 2^31 - 1: 16 GB of table
        b"\x80\x05\x96" + struct.pack("<Q", 1 << 34) + b"abc.",  # a byte array of 16 GB
        b"\x80\x04\x8e" + struct.pack("<Q", 1 << 34) + b"abc.",  # bytes
        b"\x80\x04\x95" + struct.pack("<Q", 1 << 34) + b"abc.",  # a frame
        b"\x80\x04" + b"(" * 3_000_000 + b".",  # a list each
        b"\x80\x04" + b"}" * 3_000_000 + b".",  # a dict each
        b"L" + b"9" * 3_000_000 + b"L\n.",
        b"cos\nsystem\n(S'true'\ntR.",
        b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x04true\x85R.",
        b"\x80\x02\x82\x01.",  # copyreg's extensions
        b"Pabc\n.",  # a persistent object
    ],
)
def test_pickles_that_ask_for_too_much(tmp_path, content):
    (tmp_path / "t.pkl").write_bytes(content)
    refused(tmp_path / "t.pkl", "not a bulge test|refused, the pickle asks for")


def test_pickle_whose_rows_are_one_array(tmp_path):
    row = [np.zeros((100_000, 6)), 1e-4]
    (tmp_path / "t.pkl").write_bytes(pickle.dumps([row] * 5000))
    assert (tmp_path / "t.pkl").stat().st_size < 5e6
    refused(tmp_path / "t.pkl", "row 8 has shape .* out of all proportion")


# ---- checksums ----


def test_the_checksum_covers_an_empty_specimen(csv_folder):
    folder = csv_folder(specimen="{}")
    content = b"".join(
        f"{path.name}\0{path.stat().st_size}\0".encode() + path.read_bytes()
        for path in sorted(folder.iterdir())
    )
    test = read_test(folder, radius=100, thickness=0.81)
    assert test.checksum == hashlib.sha256(content).hexdigest()


# ---- damage of any kind ----


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    rng = np.random.default_rng(7)
    reference = rng.uniform(-60, 60, (12, 3))
    displacement = rng.normal(size=(3, 12, 3))
    arrays = {
        "reference": reference,
        "displacement": displacement,
        "pressure": np.array([0.1, 0.2, 0.3]),
        **SPECIMEN,
    }
    np.savez(folder / "t.npz", **arrays)
    with h5py.File(folder / "t.h5", "w") as file:
        for key, value in arrays.items():
            file[key] = value
            file[key].attrs["unit"] = "MPa" if key == "pressure" else "mm"
    rows = np.empty((3, 2), dtype=object)
    for i in range(3):
        rows[i, 0] = np.hstack([reference, displacement[i]])
        rows[i, 1] = 1e-4 * (i + 1)
    np.save(folder / "t.npy", rows, allow_pickle=True)
    (folder / "t.pkl").write_bytes(pickle.dumps(rows, protocol=2))
    return Files({path.suffix: path.read_bytes() for path in folder.iterdir()})


class Files(dict[str, bytes]):
    """Bytes of files; hypothesis shows it where an example fails."""

    def __repr__(self) -> str:
        return f"Files({list(self)})"


DAMAGE = st.lists(
    st.one_of(
        st.tuples(st.just("flip"), st.floats(0, 1), st.integers(1, 255)),
        st.tuples(st.just("cut"), st.floats(0, 1), st.integers(1, 64)),
        st.tuples(st.just("put"), st.floats(0, 1), st.binary(max_size=16)),
    ),
    min_size=1,
    max_size=4,
)


def damaged(whole, damage):
    data = bytearray(whole)
    for kind, place, what in damage:
        at = int(place * (len(data) - 1)) if data else 0
        if kind == "flip" and data:
            data[at] ^= what
        elif kind == "cut":
            del data[at : at + what]
        elif kind == "put":
            data[at : at + len(what)] = what
    return bytes(data)


@pytest.mark.parametrize("suffix", [".npz", ".npy", ".pkl"])
@settings(
    max_examples=150,
    deadline=5000,
    derandomize=True,
    phases=[Phase.generate, Phase.shrink],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(damage=DAMAGE)
def test_damaged_files_are_read_or_refused(whole_files, tmp_path, suffix, damage):
    path = tmp_path / f"t{suffix}"
    path.write_bytes(damaged(whole_files[suffix], damage))
    said = ""
    try:
        test = read_test(path)
    except InputError as error:
        said = str(error)
    else:
        assert test.checksum == hashlib.sha256(path.read_bytes()).hexdigest()
        write_test(test, tmp_path / "o.npz", force=True)
    assert "\n" not in said
    assert len(said) < 2000


def test_damage_within_a_member_is_noticed(whole_files, tmp_path):
    """zipfile's checksum is compared, although no byte beyond the array is asked for."""
    whole = bytearray(whole_files[".npz"])
    whole[whole.index(np.float64(0.2).tobytes())] ^= 1
    (tmp_path / "t.npz").write_bytes(whole)
    refused(tmp_path / "t.npz", "damaged or cut short")
