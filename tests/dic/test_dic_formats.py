"""Does every format read back what was written, and is everything else refused?"""

from __future__ import annotations

import hashlib
import io
import json
import pickle
import re
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from bulgefit.dic import READERS, BulgeTest, Recording, read_test, reader, write_test
from bulgefit.errors import InputError


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".hdf5"])
def test_round_trip(made_test, tmp_path, same, suffix):
    path = tmp_path / f"out{suffix}"
    write_test(made_test, path)
    again = read_test(path)
    same(made_test, again)
    assert again.name == "out"
    assert again.source == str(path)
    assert again.checksum == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_round_trip_of_float32_with_lost_components(made, tmp_path, same, suffix):
    made.displacement[1, :9, 0] = np.nan
    test = BulgeTest.from_arrays(
        made.reference, made.displacement.astype(np.float32), made.pressure, poisson_ratio=0.3
    )
    write_test(test, tmp_path / f"out{suffix}")
    same(test, read_test(tmp_path / f"out{suffix}"))


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_round_trip_of_ragged_tests(ragged, tmp_path, same, suffix):
    frames, pressure = ragged
    frames[2] = (np.empty((0, 3)), np.empty((0, 3)))
    test = BulgeTest.from_frames(frames, pressure, time=[0, 1, 2, 3])
    write_test(test, tmp_path / f"out{suffix}")
    same(test, read_test(tmp_path / f"out{suffix}"))


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_the_same_test_gives_the_same_bytes(made_test, tmp_path, suffix):
    write_test(made_test, tmp_path / f"a{suffix}")
    write_test(made_test, tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_options_override_the_file(made_test, tmp_path):
    write_test(made_test, tmp_path / "out.npz")
    test = read_test(
        tmp_path / "out.npz", radius=110, thickness=1.0, poisson_ratio=0.1, name="n", crop=60
    )
    assert (test.radius, test.thickness, test.poisson_ratio, test.name) == (110, 1.0, 0.1, "n")
    assert np.hypot(*test.blocks[0].reference[:, :2].T).max() <= 60


def test_specimen_that_is_not_said(made, tmp_path):
    np.savez(tmp_path / "t.npz", **vars(made))
    with pytest.raises(InputError, match="does not say its radius; give it in mm with --radius"):
        read_test(tmp_path / "t.npz")
    assert read_test(tmp_path / "t.npz", radius=100, thickness=1).poisson_ratio == 0.24


def test_format_is_named_where_the_suffix_says_nothing(made_test, tmp_path, same):
    write_test(made_test, tmp_path / "out.npz")
    (tmp_path / "out.npz").rename(tmp_path / "out.dat")
    with pytest.raises(InputError, match=r"not a file of a known format.*csv.*hdf5.*npz.*study"):
        read_test(tmp_path / "out.dat")
    same(made_test, read_test(tmp_path / "out.dat", format="npz"))
    with pytest.raises(InputError, match=r"unknown format 'xls'; known are .*csv"):
        read_test(tmp_path / "out.dat", format="xls")
    with pytest.raises(InputError, match=r"npz has no option --columns; leave it out$"):
        read_test(tmp_path / "out.dat", format="npz", columns={"x": "X"})


def test_what_is_of_no_format_but_belongs_to_something_that_is(made_test, tmp_path):
    for name in ("one.npz", "two.npz"):
        write_test(made_test, tmp_path / name)
    said = r"2 files, each a test of its own, .* name them one by one, as one.npz two.npz$"
    with pytest.raises(InputError, match=said):
        read_test(tmp_path / "*.npz")
    (tmp_path / "pressure.csv").write_text("file,pressure_bar\nf1.csv,1\n")
    (tmp_path / "f1.csv").write_text("x,y,z,dx,dy,dz\n1,2,0,0,0,1\n")
    for place in ("f1.csv", "f*.csv"):
        with pytest.raises(
            InputError, match=f"its folder is; name that, {re.escape(str(tmp_path))}$"
        ):
            read_test(tmp_path / place)


def test_a_reader_of_ones_own(made, tmp_path):
    @reader("mine", [".mine"])
    def read_mine(path):
        return Recording(made.pressure, "", made.reference, made.displacement, None, 100, 0.8)

    (tmp_path / "t.mine").touch()
    try:
        assert read_test(tmp_path / "t.mine").thickness == 0.8
    finally:
        del READERS["mine"]


@pytest.mark.parametrize("name", ["t.npz", "t.h5", "t.npy", "folder"])
def test_missing_file(tmp_path, name):
    with pytest.raises(InputError, match=f"{name}: no such file or folder"):
        read_test(tmp_path / name)


@pytest.mark.parametrize("format", ["npz", "hdf5", "study"])
def test_a_folder_in_place_of_a_file(tmp_path, format):
    with pytest.raises(InputError, match="cannot be read"):
        read_test(tmp_path, format=format)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".npy", ".pkl"])
@pytest.mark.parametrize("content", [b"", b"not this", b"\x00" * 1000, b"PK\x03\x04rubbish"])
def test_rubbish(tmp_path, suffix, content):
    path = tmp_path / f"t{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_test(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".npy"])
def test_cut_short_anywhere(made_test, study_rows, tmp_path, suffix):
    path = tmp_path / f"t{suffix}"
    if suffix == ".npy":
        np.save(path, study_rows, allow_pickle=True)
    else:
        write_test(made_test, path)
    whole = path.read_bytes()
    for part in np.linspace(0.001, 0.999, 25):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(InputError):
            read_test(path)


def test_missing_keys_say_what_was_found(made, tmp_path):
    np.savez(tmp_path / "t.npz", reference=made.reference, loads=made.pressure)
    with pytest.raises(
        InputError, match=r"no displacement and no pressure; found loads, reference"
    ):
        read_test(tmp_path / "t.npz")
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["other"] = 1
    with pytest.raises(InputError, match=r"no pressure; found other"):
        read_test(tmp_path / "t.h5")


def test_pickles_in_an_npz_are_refused(made, tmp_path):
    np.savez(
        tmp_path / "t.npz",
        reference=made.reference,
        displacement=np.array([Exploding()], dtype=object),
        pressure=made.pressure,
    )
    with pytest.raises(InputError, match="pickled Python objects, which are not loaded"):
        read_test(tmp_path / "t.npz")
    assert not EXPLODED


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"frame": np.zeros(3)}, "must be int"),
        ({"frame": np.zeros(4, int)}, r"must both be \(4, 3\)"),
        ({"frame": np.array([0, 1, 2])}, "there are 2 pressures"),
        ({"frame": np.array([0, -1, 1])}, "frame runs from -1"),
        ({"frame": np.array([0, 1, 1]), "static_displacement": np.zeros((1, 3, 3))}, "common"),
        ({"radius": np.array([1.0, 2.0])}, "radius has shape"),
        ({"radius": np.array("100")}, "not real numbers"),
        ({"pressure": np.array([1j, 2])}, "not real numbers"),
    ],
)
def test_bad_arrays_in_a_file(tmp_path, changes, match):
    arrays = {
        "reference": np.zeros((3, 3)),
        "displacement": np.zeros((3, 3)),
        "pressure": np.array([0.1, 0.2]),
        "radius": 100.0,
        "thickness": 1.0,
    }
    np.savez(tmp_path / "t.npz", **{**arrays, **changes})
    with pytest.raises(InputError, match=match):
        read_test(tmp_path / "t.npz")


@pytest.mark.parametrize(
    ("lengths", "length", "pressures", "pressure"),
    [("m", 1e-3, "Pa", 1e6), ("um", 1e3, "kPa", 1e3), ("mm", 1.0, "bar", 10.0)],
)
def test_hdf5_units(made, tmp_path, lengths, length, pressures, pressure):
    with h5py.File(tmp_path / "t.h5", "w") as file:
        for key, value, unit in [
            ("reference", made.reference * length, lengths),
            ("displacement", made.displacement * length, lengths),
            ("radius", 100 * length, lengths),
            ("thickness", 0.81 * length, lengths),
            ("pressure", made.pressure * pressure, pressures),
            ("time", np.arange(6), "ms"),
        ]:
            file[key] = value
            file[key].attrs["unit"] = unit
        file["poisson_ratio"] = 0.3
        file["thickness"].attrs["unit"] = np.bytes_(lengths)
    test = read_test(tmp_path / "t.h5")
    np.testing.assert_allclose(test.blocks[0].displacement, made.displacement, rtol=1e-12)
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-12)
    np.testing.assert_allclose(test.time, np.arange(6) * 1e-3)
    assert test.radius == pytest.approx(100)
    assert test.thickness == pytest.approx(0.81)


def test_hdf5_pressure_that_cannot_be_in_its_unit(made_test, tmp_path):
    write_test(made_test, tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5", "a") as file:
        file["pressure"][...] *= 1e3
        file["pressure"].attrs["unit"] = "bar"
    with pytest.raises(InputError, match="pressure 300 bar cannot be, it looks like kPa; give bar"):
        read_test(tmp_path / "t.h5")


def test_hdf5_without_units_is_in_mm_and_mpa(made, tmp_path):
    with h5py.File(tmp_path / "t.h5", "w") as file:
        for key, value in vars(made).items():
            file[key] = value
    test = read_test(tmp_path / "t.h5", radius=100, thickness=0.81)
    np.testing.assert_array_equal(test.pressure, made.pressure)


def test_hdf5_with_an_unknown_unit_or_kind(made_test, tmp_path):
    write_test(made_test, tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5", "a") as file:
        file["pressure"].attrs["unit"] = "torr"
    with pytest.raises(InputError, match="pressure has the unit 'torr'; known are MPa"):
        read_test(tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5", "a") as file:
        del file["pressure"]
        file.create_group("pressure")
    with pytest.raises(InputError, match="pressure is not a data set of real numbers"):
        read_test(tmp_path / "t.h5")


# ---- the study's layout ----


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("kind", [np.float64, np.float32, ">f8"])
def test_study_layout_as_plain_pickle(study_rows, made, tmp_path, protocol, kind):
    for row in study_rows:
        row[0] = row[0].astype(kind)
    (tmp_path / "t.pkl").write_bytes(pickle.dumps(study_rows, protocol=protocol))
    test = read_test(tmp_path / "t.pkl")
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-14)
    np.testing.assert_allclose(test.blocks[0].displacement, made.displacement, rtol=1e-6)
    assert (test.radius, test.thickness, test.poisson_ratio) == (100, 0.81, 0.24)


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_study_layout_as_npy(study_rows, made, tmp_path, protocol):
    # as numpy of any age writes it: a header, then a pickle of some protocol
    with (tmp_path / "t.npy").open("wb") as file:
        header = {"descr": "|O", "fortran_order": False, "shape": study_rows.shape}
        np.lib.format.write_array_header_1_0(file, header)
        pickle.dump(study_rows, file, protocol=protocol)
    test = read_test(tmp_path / "t.npy")
    np.testing.assert_array_equal(test.blocks[0].reference, made.reference)
    np.testing.assert_array_equal(test.blocks[0].displacement, made.displacement)
    assert test.checksum == hashlib.sha256((tmp_path / "t.npy").read_bytes()).hexdigest()


def test_study_layout_saved_by_numpy(study_rows, made, tmp_path):
    np.save(tmp_path / "t.npy", study_rows, allow_pickle=True)
    assert read_test(tmp_path / "t.npy").n_measured == made.displacement[..., 0].size


def test_study_layout_under_old_and_new_module_names(study_rows, made, tmp_path):
    for old, new in [(b"numpy._core", b"numpy.core"), (b"numpy.core", b"numpy._core")]:
        data = pickle.dumps(study_rows, protocol=2).replace(old, new)
        (tmp_path / "t.pkl").write_bytes(data)
        assert read_test(tmp_path / "t.pkl").n_frames == 6


@pytest.mark.parametrize("as_scalar", [np.float64, np.float32, float, np.array])
def test_study_layout_with_any_kind_of_pressure(study_rows, made, tmp_path, as_scalar):
    for row in study_rows:
        row[1] = as_scalar(row[1])
    (tmp_path / "t.pkl").write_bytes(pickle.dumps(study_rows.tolist()))
    np.testing.assert_allclose(read_test(tmp_path / "t.pkl").pressure, made.pressure, rtol=1e-6)


def test_study_layout_with_pressures_in_mpa(study_rows, made, tmp_path):
    for row in study_rows:
        row[1] *= 1e3
    (tmp_path / "t.pkl").write_bytes(pickle.dumps(study_rows))
    with pytest.raises(InputError, match=r"0\.3 GPa cannot be, it looks like bar or MPa; give GPa"):
        read_test(tmp_path / "t.pkl")


def test_study_layout_with_fortran_arrays_and_whole_numbers(made, tmp_path):
    points = np.asfortranarray(np.arange(12).reshape(2, 6))
    (tmp_path / "t.pkl").write_bytes(pickle.dumps([[points, 1e-4]]))
    reference, displacement = read_test(tmp_path / "t.pkl").frame(0)
    np.testing.assert_array_equal(reference, [[0, 1, 2], [6, 7, 8]])
    np.testing.assert_array_equal(displacement, [[3, 4, 5], [9, 10, 11]])


def test_study_layout_of_python_2(made, tmp_path):
    # Python 2 wrote the bytes of an array as a string, and numpy 1 its module names
    number = np.array([1.0, 2, 3, 4, 5, 6]).tobytes()
    array = (
        b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntS'b'\ntR(I1\n(I1\nI6\nt"
        b"cnumpy\ndtype\n(S'f8'\nI0\nI1\ntR(I3\nS'<'\nNNNI-1\nI-1\nI0\ntbI00\n"
        b"U" + bytes([len(number)]) + number + b"tb"
    )
    (tmp_path / "t.pkl").write_bytes(b"((" + array + b"F0.0001\ntt.")
    test = read_test(tmp_path / "t.pkl")
    assert test.pressure.tolist() == [0.1]
    np.testing.assert_array_equal(test.frame(0)[1], [[4, 5, 6]])


EXPLODED: list[str] = []


def explode(*arguments):
    EXPLODED.append("boom")


class Exploding:
    def __reduce__(self):
        return explode, ("boom",)


def malicious(tmp_path):
    """Pickles that would run code, each with the name that must be refused."""
    import builtins
    import functools
    import os
    import subprocess

    command = f"touch {tmp_path / 'ran'}"

    class Calls:
        def __init__(self, function, *arguments):
            self.call = (function, arguments)

        def __reduce__(self):
            return self.call

    system = f"{os.system.__module__}.system"
    yield Calls(os.system, command), system
    yield Calls(builtins.eval, "1"), "builtins.eval"
    yield Calls(builtins.getattr, [], "append"), "builtins.getattr"
    yield Calls(subprocess.Popen, [command]), "subprocess.Popen"
    yield Calls(functools.partial, print), "functools.partial"
    yield Calls(np.load, "x"), "numpy.load"
    yield [[np.zeros((2, 6)), Calls(os.system, command)]], system
    inside = np.empty((1, 2), dtype=object)
    inside[0, 0], inside[0, 1] = np.zeros((2, 6)), Calls(os.system, command)
    yield inside, system


@pytest.mark.parametrize("number", range(8))
@pytest.mark.parametrize("suffix", [".npy", ".pkl"])
def test_malicious_pickles_run_nothing(tmp_path, number, suffix):
    content, name = list(malicious(tmp_path))[number]
    with (tmp_path / f"t{suffix}").open("wb") as file:
        if suffix == ".npy":
            header = {"descr": "|O", "fortran_order": False, "shape": (1, 2)}
            np.lib.format.write_array_header_1_0(file, header)
        pickle.dump(content, file)
    with pytest.raises(InputError, match=f"refused, the pickle asks for {name}"):
        read_test(tmp_path / f"t{suffix}")
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "content",
    [
        b"cnumpy\nndarray\n(dS'__setstate__'\nNsb.",  # BUILD on a class
        b"cnumpy\nndarray\n(N(dS'arguments'\nNstb.",  # BUILD with attributes to set on a class
        b"cnumpy.core.multiarray\n_reconstruct\n(I1\ntR(I1\nI2\ntb.",  # a state that is no array's
        b"cnumpy.core.multiarray\n_reconstruct\n)R.",  # an array without a state
        b"cnumpy\ndtype\n(S'V8'\ntR.",
        b"Pid\n.",  # a persistent id
        b"\x82\x01.",  # a registered extension
        b"(lp0\ng0\na.",  # a list within itself
        b"]" * 100_000,
        b"N.",
        b"I1\n.",
        b"\x96\xff\xff\xff\xff\xff\xff\xff\x00.",  # more bytes than there are
    ],
)
def test_malformed_pickles(tmp_path, content):
    (tmp_path / "t.pkl").write_bytes(content)
    with pytest.raises(InputError, match="not a bulge test"):
        read_test(tmp_path / "t.pkl")


def _row(points, pressure=1e-4):
    return [[points, pressure]]


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ([], "no frames"),
        ([[1, 2, 3]], "row 0 has 3 entries"),
        (_row(np.zeros((3, 5))), r"row 0 has points of shape \(3, 5\), not \(n, 6\)"),
        (_row(np.zeros((3, 6)), np.zeros(2)), r"row 0 has a pressure of shape \(2,\)"),
        (_row(np.zeros((3, 6)), "high"), "str is not an array"),
        (_row(np.zeros((3, 6)), 10**400), "int too large to convert to float"),
        (_row(np.array([["a"] * 6])), "not one of real numbers"),
        (_row(np.zeros((3, 6), dtype=complex)), "not one of real numbers"),
        (_row([[0.0] * 6]), "list is not an array"),
        ({"a": 1}, "found dict where rows should be"),
    ],
)
def test_pickles_of_another_layout(tmp_path, content, match):
    (tmp_path / "t.pkl").write_bytes(pickle.dumps(content))
    with pytest.raises(InputError, match=match):
        read_test(tmp_path / "t.pkl")


def test_npy_of_plain_numbers(tmp_path):
    np.save(tmp_path / "t.npy", np.zeros((3, 6)))
    with pytest.raises(InputError, match="the array holds float64, not objects"):
        read_test(tmp_path / "t.npy")


def test_lying_array_sizes(tmp_path):
    for protocol in (2, 5):
        data = pickle.dumps(_row(np.zeros((3, 6))), protocol=protocol)
        changed = data.replace(b"K\x03K\x06", b"K\x7fK\x06")
        assert changed != data
        (tmp_path / "t.pkl").write_bytes(changed)
        with pytest.raises(InputError, match="another number of bytes than its shape"):
            read_test(tmp_path / "t.pkl")


# ---- a folder of CSV frames ----


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]
)
def test_csv_round_trip(csv_folder, made, separator, decimal):
    test = read_test(csv_folder(separator, decimal))
    assert len(test.blocks) == 1
    np.testing.assert_array_equal(test.blocks[0].reference, made.reference)
    np.testing.assert_array_equal(test.blocks[0].displacement, made.displacement)
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-14)
    assert (test.radius, test.thickness, test.poisson_ratio) == (100, 0.81, 0.3)
    assert test.name == "frames"


@pytest.mark.parametrize(("unit", "scale"), [("MPa", 1), ("kPa", 1e3), ("Pa", 1e6), ("bar", 10)])
def test_csv_pressure_units(csv_folder, made, unit, scale):
    test = read_test(csv_folder(unit=unit, scale=scale))
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-12)


def test_csv_pressure_that_cannot_be_in_its_unit(csv_folder):
    with pytest.raises(InputError, match="pressure 300 bar cannot be, it looks like kPa; give bar"):
        read_test(csv_folder(unit="bar", scale=1e3))


@pytest.mark.parametrize("mark", ["", "nan", "NaN", " "])
def test_csv_lost_points(csv_folder, made, mark):
    test = read_test(csv_folder(lost={3: mark, 4: mark}))
    assert test.n_points == len(made.reference) - 2


def test_csv_points_lost_in_one_frame(csv_folder, made):
    folder = csv_folder()
    lines = (folder / "frame_2.csv").read_text().splitlines()
    lines[4] = ",".join([*lines[4].split(",")[:3], "", "", ""])
    lines[5] = ",".join(["", *lines[5].split(",")[1:]])
    del lines[6]
    lines.insert(1, "")
    (folder / "frame_2.csv").write_text("\r\n".join(lines) + "\r\n")
    test = read_test(folder)
    assert np.flatnonzero(~test.blocks[0].measured[2]).tolist() == [3, 4, 5]
    assert test.n_measured == 6 * len(made.reference) - 3


def test_csv_columns(csv_folder, made):
    header = ("X [mm]", "y", "z", "dX", "dy", "d z")
    columns = {"x": "X [mm]", "dx": "dX", "dz": "d z"}
    folder = csv_folder(header=header)
    with pytest.raises(InputError, match=r"frame_0.csv: has no column 'x'; found X \[mm\], y"):
        read_test(folder)
    np.testing.assert_array_equal(
        read_test(folder, columns=columns).blocks[0].displacement, made.displacement
    )
    (folder / "test.json").write_text(
        json.dumps({"name": "n", "radius": 100, "thickness": 1, "columns": columns})
    )
    test = read_test(folder)
    assert test.name == "n"
    with pytest.raises(InputError, match="unknown column 'w'"):
        read_test(folder, columns={"w": "W"})
    with pytest.raises(InputError, match="the column 'dX' cannot be both dx and dy"):
        read_test(folder, columns={"dy": "dX"})


def test_csv_header_with_a_hash_quotes_and_more_columns(csv_folder, made):
    folder = csv_folder()
    for path in folder.glob("frame_*.csv"):
        lines = path.read_text().splitlines()
        lines = ['"id",' + line for line in lines]
        lines[0] = '# id,"x","y","z",dx,dy,dz'
        path.write_bytes(b"\xef\xbb\xbf" + "\n".join(lines).encode())
    np.testing.assert_array_equal(read_test(folder).blocks[0].reference, made.reference)


def test_csv_rows_may_end_in_separators_and_unused_names_be_doubled(csv_folder, made):
    folder = csv_folder()
    for path in folder.glob("frame_*.csv"):
        lines = [f"0,0,{line}, ," for line in path.read_text().splitlines()]
        path.write_text("\n".join(["id,id,x,y,z,dx,dy,dz", *lines[1:]]))
    np.testing.assert_array_equal(read_test(folder).blocks[0].reference, made.reference)


def test_csv_time_and_checksum(csv_folder, made):
    folder = csv_folder()
    rows = (folder / "pressure.csv").read_text().splitlines()
    rows = [f"{row},{'time_s' if i == 0 else 2 * i}" for i, row in enumerate(rows)]
    (folder / "pressure.csv").write_text("\n".join(rows))
    test = read_test(folder)
    assert test.time.tolist() == [2, 4, 6, 8, 10, 12]
    content = b"".join(
        f"{path.name}\0{path.stat().st_size}\0".encode() + path.read_bytes()
        for path in sorted(folder.iterdir())
    )
    assert test.checksum == hashlib.sha256(content).hexdigest()


def test_csv_without_specimen(csv_folder):
    folder = csv_folder(specimen=None)
    with pytest.raises(InputError, match="does not say its radius"):
        read_test(folder)
    assert read_test(folder, radius=100, thickness=0.5).thickness == 0.5


@pytest.mark.parametrize("option", ["pressure_column", "pressure_unit"])
def test_csv_is_told_what_its_pressures_are_called(csv_folder, option):
    written = f"--{option.replace('_', '-')}"
    with pytest.raises(InputError, match=f"no option {written}.*called pressure_bar.*rename it so"):
        read_test(csv_folder(), **{option: "load"})


@pytest.mark.parametrize(
    ("file", "content", "match"),
    [
        ("pressure.csv", "", "pressure.csv: is empty"),
        (
            "pressure.csv",
            "file,p\na,1\n",
            r"file and pressure_bar .*found file, p: rename what holds",
        ),
        ("pressure.csv", "file,pressure_torr\nframe_0.csv,1\n", "unit 'torr'"),
        ("pressure.csv", "file,pressure_bar\nlost.csv,1\n", "names lost.csv, which is not in"),
        ("pressure.csv", "file,pressure_bar\n../a.csv,1\n", "not the name of a file"),
        ("pressure.csv", "file,pressure_bar\nframe_0.csv,1\n", "frame_1.csv has no pressure"),
        ("pressure.csv", "file,pressure_bar\nframe_0.csv,1\nframe_0.csv,2\n", "a file twice"),
        (
            "pressure.csv",
            "file,pressure_bar\nframe_0.csv,x\n",
            "line 2, column 'pressure_bar': 'x'",
        ),
        ("frame_3.csv", "", "frame_3.csv: is empty"),
        ("frame_3.csv", "x,y\n1,2\n", "frame_3.csv: has no column 'z'"),
        ("frame_3.csv", "x,y,z,dx,dy,dz\n1,2,3,4,5,6\n1,2,a,4,5,6\n", "line 3, column 'z': 'a'"),
        ("frame_3.csv", "x,y,z,dx,dy,dz\n1,2,3,4,5\n", "line 2 ends before the column 'dz'"),
        (
            "frame_3.csv",
            "x,y,z,dx,dy,dz\n\n-26,6,-90,0,0,1,0,2,0,3,0,4\n",
            "frame_3.csv: line 3 has 12 cells, the header 6.*where the comma is decimal separate",
        ),
        (
            "pressure.csv",
            "file,pressure_bar\nframe_0.csv,0,5\n",
            "pressure.csv: line 2 has 3 cells, the header 2",
        ),
        (
            "frame_3.csv",
            "x,y,z,dx,dy,dz,dx\n1,2,3,4,5,6,7\n",
            "has 2 columns 'dx' that differ; give each",
        ),
        (
            "frame_3.csv",
            'x,y,z,dx,dy,dz,note\n1,2,3,4,5,6,7\n1,2,3,4,5,6,"a\n' + "1,2,3,4,5,6,7\n" * 9,
            "line 3 begins no row of cells .*; check its quotes",
        ),
        (
            "frame_3.csv",
            "x,y,z,dx,dy,dz\n1,2,3,4,5,6\n1,2,3,4,5," + "7" * 200_000 + "\n",
            "line 3 begins no row of cells",
        ),
        (
            "frame_3.csv",
            "x,y,z,dx,dy,dz\n1,2,3,4,5," + "a" * 1000 + "\n",
            r"line 2, column 'dz': '.{,40}' is not a number",
        ),
        ("frame_3.csv", "x,y,z,dx,dy,dz\n1_0,2,3,4,5,\n", "line 2, column 'x': '1_0' is not a"),
        ("frame_3.csv", "x,y,z,dx,dy,dz\n1_0,2,3,4,5,6\n", "line 2, column 'x': '1_0' is not a"),
        ("frame_3.csv", "x,y,z,dx,dy,dz\n١,2,3,4,5,\n", "line 2, column 'x': '١' is not a"),
        ("frame_3.csv", '\n"x",y,"z,dx\n1,2,3\n', "line 2 begins no row of cells"),
        ("frame_3.csv", "#\n1,2,3\n", "has 3 cells, the header 0"),
        ("frame_3.csv", "\0\0\0", "not a text file"),
        ("test.json", "{", "test.json: not JSON"),
        ("test.json", "[]", "must be a JSON object"),
        ("test.json", '{"radus": 1}', "unknown key 'radus'"),
        ("test.json", '{"radius": "100"}', "radius cannot be '100'"),
        ("test.json", '{"columns": {"x": 1}}', "columns cannot be"),
        ("test.json", '{"name": 1}', "name cannot be 1"),
        ("test.json", r'{"name": "a\u0000b"}', r"name cannot be 'a\\x00b'; it must be text on one"),
        ("test.json", r'{"name": "a\ud800b"}', "name cannot be"),
        ("test.json", r'{"name": "a\nb"}', "name cannot be"),
        ("test.json", f'{{"radius": 1{"0" * 400}}}', "radius cannot be inf; it must be a number"),
        ("test.json", '{"radius": NaN}', "radius cannot be nan; it must be a number in mm"),
        ("test.json", '{"radius": true}', "radius cannot be True"),
        ("test.json", f'{{"{"r" * 999}": 1}}', "unknown key '.{,40}'; known are"),
    ],
)
def test_bad_csv_folders(csv_folder, file, content, match):
    folder = csv_folder()
    (folder / file).write_text(content)
    with pytest.raises(InputError, match=match) as caught:
        read_test(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["frame_3.csv", "pressure.csv", "test.json"])
def test_csv_file_that_cannot_be_read_is_named(csv_folder, monkeypatch, name):
    def read_bytes(path):
        if path.name == name:
            raise PermissionError(13, "Permission denied")
        return whole(path)

    whole = Path.read_bytes
    folder = csv_folder()
    monkeypatch.setattr(Path, "read_bytes", read_bytes)
    with pytest.raises(InputError, match=f"{name}: cannot be read \\(Permission denied\\)"):
        read_test(folder)


def test_csv_frame_with_a_header_only_is_a_frame_without_points(csv_folder):
    folder = csv_folder()
    (folder / "frame_3.csv").write_text("x,y,z,dx,dy,dz\n")
    test = read_test(folder)
    assert len(test.frame(3)[0]) == 0
    assert test.n_frames == 6


def test_folder_that_is_no_test(tmp_path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(InputError, match=r"and it has no pressure.csv; found notes.txt"):
        read_test(tmp_path)
    with pytest.raises(InputError, match="not a folder"):
        read_test(tmp_path / "notes.txt", format="csv")


def test_npz_of_another_zip(tmp_path):
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as archive:
        archive.writestr("notes.txt", "hello")
    with pytest.raises(InputError, match=r"no pressure; found notes.txt"):
        read_test(tmp_path / "t.npz")


@pytest.mark.parametrize("name", ["pressure", "pressure.npy"])
@pytest.mark.parametrize("content", [b"", b"1,2,3"])
def test_npz_with_a_member_that_is_no_array(made, tmp_path, name, content):
    np.savez(tmp_path / "t.npz", reference=made.reference, displacement=made.displacement)
    with zipfile.ZipFile(tmp_path / "t.npz", "a") as archive:
        archive.writestr(name, content)
    with pytest.raises(InputError, match=r"t.npz: pressure is not a numpy array"):
        read_test(tmp_path / "t.npz")


@pytest.mark.parametrize(
    "shape", ["(9", "(9999999999999999999999,)", "(-9,)", "[[[]", "{[]: 1}", "\n  9\n 9"]
)
def test_damaged_headers_of_arrays(tmp_path, shape):
    head = f"{{'descr': '|O', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117)
    array = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head
    with zipfile.ZipFile(tmp_path / "t.npz", "w") as archive:
        for key in ("reference", "displacement", "pressure"):
            archive.writestr(f"{key}.npy", array.replace(b"|O", b"<f8"))
    with pytest.raises(InputError, match=r"t.npz: (cannot be read as npz|damaged|reference has)"):
        read_test(tmp_path / "t.npz")
    (tmp_path / "t.npy").write_bytes(array)
    with pytest.raises(InputError, match=r"t.npy: not a bulge test"):
        read_test(tmp_path / "t.npy")


def test_npz_with_flipped_bytes(made_test, tmp_path):
    buffer = io.BytesIO()
    block = made_test.blocks[0]
    np.savez_compressed(
        buffer, reference=block.reference, displacement=block.displacement, pressure=1
    )
    data = bytearray(buffer.getvalue())
    data[len(data) // 2] ^= 0xFF
    (tmp_path / "t.npz").write_bytes(data)
    with pytest.raises(InputError, match=r"t.npz"):
        read_test(tmp_path / "t.npz")
