"""Are HDF5, MATLAB and .vc7 exports read back, masks and all, and nothing beside the file?"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_array

from bulgefit.dic import hdf5_apart, read_test
from bulgefit.dic.formats import davis_vc7
from bulgefit.dic.formats.matlab5 import names_of, values_of
from bulgefit.errors import InputError

SPECIMEN = {"radius": 100.0, "thickness": 1.0}


def turned(vectors):
    """y down the image and z away from the cameras."""
    return vectors * [1, -1, -1]


# ---- Istra4D ----


def istra_step(path: Path, truth, frame: int, masked=(), unit: str | None = "mm") -> None:
    """A step as Istra4D exports it; what is masked holds whatever stood in the memory."""
    scale = 1e-3 if unit == "m" else 1.0
    with h5py.File(path, "w") as file:
        for group, name, vectors in (
            ("coordinates", "coordinate", truth.reference),
            ("displacements", "displacement", truth.displacement[frame]),
        ):
            for i, axis in enumerate("xyz"):
                values = vectors[:, i] * scale
                values[list(masked)] = 1.7e308
                file[f"{group}/{name}_{axis}"] = values.reshape(9, 9)
                if unit:
                    file[f"{group}/{name}_{axis}"].attrs["unit"] = unit
            mask = np.ones(81, dtype=np.uint8)
            mask[list(masked)] = 0
            file[f"{group}/mask"] = mask.reshape(9, 9)
        file["add_data/analog_channels"] = [[7.0, truth.pressure[frame] * 4 - 0.5]]
        channels = file["add_data/analog_channels"]
        channels.attrs["name"] = ["traverse", "pressure"]
        channels.attrs["unit"] = ["mm", "bar"]
        channels.attrs["factor"] = [1.0, 2.5]
        channels.attrs["offset"] = [0.0, 1.25]


@pytest.mark.parametrize("unit", ["mm", "m", None])
def test_istra4d(truth, tmp_path, holds, unit):
    """Steps sort as numbers: 10 comes after 9."""
    for frame, step in enumerate((2, 9, 10, 11)):
        masked = (40, 3) if step == 10 else ()
        istra_step(tmp_path / f"series_step_{step}.hdf5", truth, frame, masked, unit)
    holds(read_test(tmp_path, **SPECIMEN), lost=((2, 40), (2, 3)))


@pytest.mark.parametrize("kind", ["external", "soft", "virtual", "storage"])
def test_nothing_outside_an_hdf5_file_is_read(truth, tmp_path, kind):
    folder = tmp_path / "steps"
    folder.mkdir()
    istra_step(folder / "step_1.hdf5", truth, 0)
    istra_step(tmp_path / "secret.hdf5", truth, 1)
    with h5py.File(folder / "step_1.hdf5", "a") as file:
        inside = file["coordinates"]
        del inside["coordinate_z"]
        if kind == "external":
            inside["coordinate_z"] = h5py.ExternalLink(
                str(tmp_path / "secret.hdf5"), "coordinates/coordinate_z"
            )
        elif kind == "soft":
            inside["coordinate_z"] = h5py.SoftLink("/coordinates/coordinate_y")
        elif kind == "virtual":
            layout = h5py.VirtualLayout((9, 9), dtype="f8")
            layout[...] = h5py.VirtualSource(
                str(tmp_path / "secret.hdf5"), "coordinates/coordinate_z", (9, 9)
            )
            inside.create_virtual_dataset("coordinate_z", layout)
        else:
            (tmp_path / "secret.bin").write_bytes(b"\1" * 648)
            inside.create_dataset(
                "coordinate_z", (9, 9), "f8", external=[(str(tmp_path / "secret.bin"), 0, 648)]
            )
    with pytest.raises(InputError, match=r"is a link|stands in another file"):
        read_test(folder, **SPECIMEN)


def test_a_folder_of_hdf5_files_is_read_by_one_process(truth, tmp_path, holds, monkeypatch):
    started = []

    def start():
        started.append(original())
        return started[-1]

    original = hdf5_apart._started
    monkeypatch.setattr(hdf5_apart, "_started", start)
    for step in range(4):
        istra_step(tmp_path / f"step_{step}.hdf5", truth, step)
    holds(read_test(tmp_path, **SPECIMEN))
    assert len(started) == 1
    assert started[0].poll() is not None


def test_a_file_that_ends_the_process_is_asked_once_and_others_are_read(tmp_path, monkeypatch):
    """What kills the library is one file's damage, not the folder's."""
    for name in ("good.h5", "bad.h5"):
        with h5py.File(tmp_path / name, "w") as file:
            file["a"] = [1.0, 2.0]
    start = hdf5_apart._START.split("from bulgefit")[0]
    deadly = (
        "import bulgefit.dic.hdf5_answers as a, os; one = a._answer\n"
        "a._answer = lambda where, keys: os.abort() if 'bad' in where else one(where, keys)\n"
        "a.serve()"
    )
    monkeypatch.setattr(hdf5_apart, "_START", start + "\n" + deadly)
    starts = []
    original = hdf5_apart._started
    monkeypatch.setattr(hdf5_apart, "_started", lambda: starts.append(0) or original())
    with hdf5_apart.one_helper():
        for name in ("good.h5", "bad.h5", "bad.h5", "good.h5", "bad.h5", "good.h5"):
            with (tmp_path / name).open("rb") as file:
                if name == "bad.h5":
                    with pytest.raises(InputError, match="the HDF5 library fails on it"):
                        hdf5_apart.read_apart(file, ["a"], str(tmp_path / name))
                else:
                    found = hdf5_apart.read_apart(file, ["a"], str(tmp_path / name))
                    assert found.datasets["a"].numbers.tolist() == [1.0, 2.0]
    assert len(starts) == 2


def test_cells_that_refer_to_one_large_array_are_counted_each_time(truth, tmp_path, log):
    """Ten thousand references to a megabyte are ten gigabytes."""

    def write(file):
        file["#refs#/a"] = np.zeros((3, 40_000))
        for name in ("Points3D", "Disp/DispVec"):
            refs = np.array([[file["#refs#/a"].ref] * 10_000], dtype=object)
            file.create_dataset(f"DIC3D/{name}", data=refs, dtype=h5py.ref_dtype)

    write_newest(tmp_path / "DIC3D.mat", write)
    with pytest.raises(InputError, match=r"Points3D has shape .* out of all proportion"):
        read_test(tmp_path / "DIC3D.mat", **SPECIMEN)


@pytest.mark.parametrize("kind", ["external", "soft", "virtual", "storage"])
def test_nothing_outside_a_matlab_file_is_read(truth, tmp_path, log, kind):
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["W"] = np.ones((9, 9))

    def write(file):
        for name, values in vic_arrays(truth, 0).items():
            if name != "W":
                file[name] = values.T
        if kind == "external":
            file["W"] = h5py.ExternalLink(str(secret), "W")
        elif kind == "soft":
            file["W"] = h5py.SoftLink("/V")
        elif kind == "virtual":
            layout = h5py.VirtualLayout((9, 9), dtype="f8")
            layout[...] = h5py.VirtualSource(str(secret), "W", (9, 9))
            file.create_virtual_dataset("W", layout)
        else:
            file.create_dataset("W", (9, 9), "f8", external=[(str(secret), 0, 648)])

    write_newest(tmp_path / "run_1bar.mat", write)
    with pytest.raises(InputError, match=r"W is a link|W stands in another file"):
        read_test(tmp_path / "run_1bar.mat", **SPECIMEN)


def test_istra4d_that_is_damaged(truth, tmp_path):
    path = tmp_path / "step_1.hdf5"
    istra_step(path, truth, 0)
    whole = path.read_bytes()
    with hdf5_apart.one_helper():  # one start for all
        for part in np.linspace(0.1, 0.95, 12):
            path.write_bytes(whole[: int(part * len(whole))])
            with pytest.raises(InputError):
                read_test(path, **SPECIMEN)
    path.write_bytes(whole)
    with h5py.File(path, "a") as file:
        del file["displacements/displacement_z"]
    with pytest.raises(InputError, match="displacements has no displacement_z; export it from a"):
        read_test(path, **SPECIMEN)
    with h5py.File(path, "a") as file:
        file.create_dataset("displacements/displacement_z", (1 << 20, 1 << 12), "f8")
    with pytest.raises(InputError, match=r"displacement_z has shape .* out of all proportion"):
        read_test(path, **SPECIMEN)


# ---- MATLAB: VIC-3D ----


def vic_arrays(truth, frame, lost=()):
    arrays = {
        name: vectors[:, i].reshape(9, 9).copy()
        for names, vectors in (
            ("XYZ", truth.reference),
            ("UVW", truth.displacement[frame]),
            ("xy", truth.pixels.astype(float)),
        )
        for i, name in enumerate(names)
    }
    arrays["sigma"] = np.full((9, 9), 0.01)
    for point in lost:
        arrays["sigma"][divmod(point, 9)] = -1
        arrays["U"][divmod(point, 9)] = 1e9
    return arrays


def write_newest(path: Path, write) -> None:
    """A MATLAB file of version 7.3: HDF5 behind a text of 512 bytes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        write(file)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


@pytest.mark.parametrize("version", ["5", "5 compressed", "7.3"])
def test_vic3d_mat(truth, tmp_path, log, holds, version):
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in range(4):
        arrays = vic_arrays(truth, i, lost=(7, 60) if i == 2 else ())
        path = folder / f"run_{i}.mat"
        if version == "7.3":
            write_newest(path, lambda f, a=arrays: [f.create_dataset(k, data=a[k].T) for k in a])
        else:
            savemat(path, arrays, do_compression="compressed" in version)
    table = str(log([f"run_{i}.tif" for i in range(4)]))
    holds(read_test(folder, pressure=table, **SPECIMEN), lost=((2, 7), (2, 60)))


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_vic3d_mat_of_several_areas(truth, tmp_path, log, holds, version):
    """Each area of interest has its own numbered matrices, in shapes of their own."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in range(4):
        whole = vic_arrays(truth, i, lost=(7, 60) if i == 2 else ())
        arrays = {f"{k}{end}": v[rows] for k, v in whole.items() for end, rows in AREAS.items()}
        path = folder / f"run_{i}.mat"
        if version == "7.3":
            write_newest(path, lambda f, a=arrays: [f.create_dataset(k, data=a[k].T) for k in a])
        else:
            savemat(path, arrays)
    table = str(log([f"run_{i}.tif" for i in range(4)]))
    holds(read_test(folder, pressure=table, **SPECIMEN), lost=((2, 7), (2, 60)))


AREAS = {"": slice(0, 3), "_1": slice(3, 4), "_2": slice(4, 9)}


def test_matlab_files_that_are_not_read(truth, tmp_path):
    path = tmp_path / "run_1bar.mat"
    arrays = vic_arrays(truth, 0)
    savemat(path, {**arrays, "W": "text"})
    with pytest.raises(InputError, match="W is not an array of real numbers"):
        read_test(path, **SPECIMEN)
    savemat(path, {**arrays, "W": arrays["W"][:5]})
    with pytest.raises(InputError, match="its matrices differ in shape"):
        read_test(path, **SPECIMEN)
    savemat(path, {"other": 1.0})
    with pytest.raises(InputError, match="not a file of a known format"):
        read_test(path, **SPECIMEN)
    with pytest.raises(InputError, match="holds no file of the format vic3d-mat; such a file has"):
        read_test(path, format="vic3d-mat", **SPECIMEN)
    savemat(path, arrays)
    whole = path.read_bytes()
    for part in np.linspace(0.05, 0.97, 12):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(InputError):
            read_test(path, **SPECIMEN)


def test_a_matlab_file_that_would_fill_the_memory(truth, tmp_path):
    """Zeros shrink a thousandfold: the header tells before they are unpacked."""
    path = tmp_path / "run_1bar.mat"
    shape = (5_200, 5_200)
    savemat(path, {**vic_arrays(truth, 0), "W": np.zeros(shape)}, do_compression=True)
    with pytest.raises(InputError, match="is larger than its file can hold"):
        read_test(path, **SPECIMEN)


# SciPy 1.18 says that sparse arrays will be its default; none is looked at here
@pytest.mark.filterwarnings("ignore:.*spmatrix:DeprecationWarning")
@pytest.mark.parametrize("compressed", [True, False])
def test_matlab_values_are_those_that_scipy_reads(tmp_path, compressed):
    """Of all kinds of numbers, cells and structs; text and sparse matrices are passed over."""
    rng = np.random.default_rng(3)
    kinds = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8", "?")
    written = {f"k{i}": rng.uniform(0, 99, (9, 9, 4)).astype(k) for i, k in enumerate(kinds)}
    cells = np.empty((2, 3), dtype=object)
    for i, at in enumerate(np.ndindex(2, 3)):
        cells[at] = rng.normal(size=(i, 3)) if i else {"deep": np.arange(2.0)}
    written |= {"none": np.empty((0, 3)), "cells": cells, "sparse": csc_array(np.eye(3))}
    written |= {"struct": {"a": 1.5, "b": {"c": np.arange(4)}}, "text": "a name"}
    path = tmp_path / "t.mat"
    savemat(path, written, do_compression=compressed)
    with path.open("rb") as file:
        found = values_of(file, [*written, "missing"], 1 << 20)
        assert sorted(names_of(file)) == sorted(written)
    expected = loadmat(path)
    for key in (*(f"k{i}" for i in range(len(kinds))), "none"):
        np.testing.assert_array_equal(found[key], expected[key])
    assert found["text"] is None
    assert found["sparse"] is None
    np.testing.assert_array_equal(found["struct"]["b"]["c"], [[0, 1, 2, 3]])
    # cells are counted down the columns
    np.testing.assert_array_equal(found["cells"][0]["deep"], [[0, 1]])
    for i, cell in enumerate(expected["cells"].ravel(order="F")[1:], 1):
        np.testing.assert_array_equal(found["cells"][i], cell)
    if compressed:
        with path.open("rb") as file, pytest.raises(ValueError, match="larger than its file"):
            values_of(file, ["k7"], 1100)


# ---- MATLAB: DuoDIC and MultiDIC ----


def duodic_cells(truth):
    points, vectors = [], []
    for moved in truth.displacement:
        points.append(turned(truth.reference + moved))
        vectors.append(turned(moved).copy())
    points[2][13] = np.nan
    vectors[2][13] = np.nan
    return points, vectors


def write_cells(file, name, cells):
    refs = []
    for i, cell in enumerate(cells):
        dataset = file.create_dataset(f"#refs#/{name.replace('/', '_')}{i}", data=cell.T)
        refs.append(dataset.ref)
    file.create_dataset(name, data=np.array([refs], dtype=object), dtype=h5py.ref_dtype)


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_duodic(truth, tmp_path, log, holds, version, said):
    points, vectors = duodic_cells(truth)
    path = tmp_path / "DIC3D.mat"
    if version == "7.3":

        def write(file):
            write_cells(file, "DIC3D/Points3D", points)
            write_cells(file, "DIC3D/Disp/DispVec", vectors)

        write_newest(path, write)
    else:

        def cells(arrays):
            column = np.empty((len(arrays), 1), dtype=object)
            column[:, 0] = arrays
            return column

        savemat(path, {"DIC3D": {"Points3D": cells(points), "Disp": {"DispVec": cells(vectors)}}})
    table = str(log([str(i) for i in (1, 2, 3, 4)], header="image number,pressure [bar]"))
    holds(read_test(path, pressure=table, say=said.append, **SPECIMEN), lost=((2, 13),))
    assert said[0] == "duodic: 4 frames of DuoDIC, MultiDIC (MATLAB .mat), current positions"


def test_duodic_with_an_empty_cell(truth, tmp_path, log):
    """MATLAB writes the shape of an empty array in its place."""
    points, vectors = duodic_cells(truth)

    def write(file):
        write_cells(file, "DIC3DPPresults/Points3D", points)
        write_cells(file, "DIC3DPPresults/Disp/DispVec", vectors)
        for name in ("DIC3DPPresults_Points3D1", "DIC3DPPresults_Disp_DispVec1"):
            del file[f"#refs#/{name}"]
            file[f"#refs#/{name}"] = np.zeros(2, dtype=np.uint64)
            file[f"#refs#/{name}"].attrs["MATLAB_empty"] = np.uint8(1)
        for name in ("Points3D", "Disp/DispVec"):
            refs = file[f"DIC3DPPresults/{name}"][()]
            kind = name.replace("/", "_")
            refs[0, 1] = file[f"#refs#/DIC3DPPresults_{kind}1"].ref
            file[f"DIC3DPPresults/{name}"][...] = refs

    write_newest(tmp_path / "DIC3DPPresults.mat", write)
    table = str(log([str(i) for i in (1, 2, 3, 4)], header="image number,pressure [bar]"))
    test = read_test(tmp_path / "DIC3DPPresults.mat", pressure=table, **SPECIMEN)
    assert test.blocks[0].measured.sum(axis=1).tolist() == [81, 0, 80, 81]


def test_duodic_without_its_cells(tmp_path):
    write_newest(tmp_path / "DIC3D.mat", lambda file: file.create_group("DIC3D"))
    with pytest.raises(InputError, match=r"DIC3D has no Points3D and Disp.DispVec"):
        read_test(tmp_path / "DIC3D.mat", **SPECIMEN)


# ---- MatchID, HDF5 ----


def matchid_arrays(truth):
    """By their places in the file; one point is lost as NaN, one as zeros."""
    position, moved = (
        turned(values) for values in (truth.reference + truth.displacement, truth.displacement)
    )
    position[2, 13], moved[2, 13] = np.nan, np.nan
    position[3, 8], moved[3, 8] = 0, 0
    names = ("Horizontal Displacement U", "Vertical Displacement V", "Out-Of-Plane: W")
    return {
        "Mapping Data/Spatial - Point Locations": truth.pixels,
        "Temporal Data/Force": truth.pressure[None] * 100,
        "Temporal Data/Time": np.arange(4.0)[None],
        **{f"Point Data/{name}": position[..., i] for i, name in enumerate("XYZ")},
        **{f"Point Data/{name}": moved[..., i] for i, name in enumerate(names)},
    }


def write_matchid(path, arrays):
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[f"DIC Data/{name}"] = values


def test_matchid_hdf5(truth, tmp_path, holds, said):
    path = tmp_path / "test.h5"
    write_matchid(path, matchid_arrays(truth))
    with pytest.raises(InputError, match=r"no pressure found .*'Force', 'Time'"):
        read_test(path, **SPECIMEN)
    options = {"pressure_column": "Force", "pressure_unit": "0.1bar", **SPECIMEN}
    holds(read_test(path, say=said.append, **options), lost=((2, 13), (3, 8)))
    assert said[0] == "matchid-hdf5: 4 frames of MatchID (HDF5, one file a test), current positions"
    assert "y and z change sign: the file's y runs down the image" in said


@pytest.mark.parametrize(
    ("name", "change", "match"),
    [
        ("Point Data/Z", None, "has no 'DIC Data/Point Data/Z'; export it from a stereo"),
        ("Point Data/Z", np.s_[:, :5], r"Z' is \(4, 5\); each must be \(steps, points\)"),
        ("Mapping Data/Spatial - Point Locations", np.s_[:5], "is .5, 2., not two numbers a point"),
    ],
)
def test_matchid_hdf5_that_does_not_fit(truth, tmp_path, name, change, match):
    arrays = matchid_arrays(truth)
    whole = arrays.pop(name)
    if change is not None:
        arrays[name] = whole[change]
    write_matchid(tmp_path / "test.h5", arrays)
    with pytest.raises(InputError, match=match):
        read_test(tmp_path / "test.h5", **SPECIMEN)


# ---- DaVis .vc7 ----


def test_davis_vc7(truth, tmp_path, log, holds):
    lvpyio = pytest.importorskip("lvpyio")
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in range(4):
        field = np.zeros((9, 9), dtype=lvpyio.vec3c)
        # the file keeps v along its rows, which run downwards; lvpyio gives it along y
        for k, (key, sign) in enumerate(zip("uvw", (1, -1, 1), strict=True)):
            field[key] = sign * truth.displacement[i][:, k].reshape(9, 9) * 1e3
        mask = np.zeros((9, 9), dtype=bool)
        mask[0, 5] = i == 3
        buffer = lvpyio.arrays_to_buffer([np.ma.MaskedArray(field, mask=mask)])
        scales = buffer[0].scales
        scales.i.slope, scales.i.unit = 1.0, "um"
        # cells of 8 mm whose first one has its middle at -32 mm; rows run downwards
        scales.x.slope, scales.x.offset, scales.x.unit = 8.0, -36.0, "mm"
        scales.y.slope, scales.y.offset, scales.y.unit = -8.0, 36.0, "mm"
        height = truth.reference[:, 2].reshape(9, 9).astype(np.float32)
        buffer[0].components["TS:Height"] = lvpyio.Component(
            lvpyio.Scale(1.0, 0.0, "mm", "height"), [height]
        )
        lvpyio.write_buffer(buffer, str(folder / f"B{i + 1:04d}.vc7"))
    table = str(log([f"B{i:04d}" for i in (1, 2, 3, 4)]))
    test = read_test(folder, pressure=table, **SPECIMEN)
    # the file keeps single precision of displacements in micrometres
    (block,) = test.blocks
    np.testing.assert_allclose(block.reference, truth.reference, atol=1e-6)
    expected = truth.displacement.copy()
    expected[3, 5] = np.nan
    np.testing.assert_allclose(block.displacement, expected, atol=3e-6, rtol=0)


def test_vc7_that_is_none_or_holds_no_height(tmp_path):
    lvpyio = pytest.importorskip("lvpyio")
    path = tmp_path / "run_1bar.vc7"
    path.write_bytes(b"no such file")
    with pytest.raises(InputError, match=r"run_1bar.vc7: "):
        read_test(path, **SPECIMEN)
    lvpyio.write_buffer(lvpyio.arrays_to_buffer([np.zeros((3, 4), lvpyio.vec3c)]), str(path))
    with pytest.raises(InputError, match=r"holds no displacement in space with its height"):
        read_test(path, **SPECIMEN)


@pytest.mark.parametrize(
    ("program", "match"),
    [
        ("import os; os.abort()", "not a .vc7 file, or damaged"),
        ("while True: pass", r"was not read within 0 s; it is damaged, or the disk"),
        ("print('PK is no archive')", "not a .vc7 file, or damaged"),
        ("print('!lvpyio', end='')", r"install bulgefit\[davis\], or export CSV from DaVis"),
    ],
)
def test_what_ends_the_reader_of_vc7_does_not_end_bulgefit(tmp_path, monkeypatch, program, match):
    (tmp_path / "worker.py").write_text(program)
    (tmp_path / "run_1bar.vc7").touch()
    monkeypatch.setattr(davis_vc7.vc7_worker, "__file__", str(tmp_path / "worker.py"))
    monkeypatch.setattr(davis_vc7, "_PATIENCE", 0.5)
    with pytest.raises(InputError, match=match):
        read_test(tmp_path / "run_1bar.vc7", **SPECIMEN)


def test_the_reader_of_vc7_without_its_package(tmp_path, monkeypatch):
    (tmp_path / "lvpyio.py").write_text("raise ImportError('not here')")
    (tmp_path / "run_1bar.vc7").touch()
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(InputError, match=r"install bulgefit\[davis\]"):
        read_test(tmp_path / "run_1bar.vc7", **SPECIMEN)
