"""Does a damaged export end in one line, whatever is damaged?"""

from __future__ import annotations

import random

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from bulgefit.dic import read_test
from bulgefit.errors import InputError

SPECIMEN = {"radius": 100.0, "thickness": 1.0}
TRIES = 60
BITS = (b"nan", b"inf", b"1e999", b"-", b'"', b"\0", b",", b";", b"\n", b"\xff\xfe", b"#", b"[mm]")


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Cut, overwritten, shortened, shuffled, in another encoding, or with something put in."""
    at = rng.randrange(len(data))
    kind = rng.randrange(6)
    if kind == 0:
        return data[:at]
    if kind == 1:
        changed = bytearray(data)
        for _ in range(rng.randrange(1, 30)):
            changed[rng.randrange(len(data))] = rng.randrange(256)
        return bytes(changed)
    if kind == 2:
        return data[:at] + data[at + rng.randrange(1, 2000) :]
    if kind == 3:
        lines = data.split(b"\n")
        rng.shuffle(lines)
        return b"\n".join(lines)
    if kind == 4:
        return data.decode("latin-1").encode(rng.choice(["utf-16", "utf-16-be", "utf-32", "utf-8"]))
    at = rng.randrange(min(len(data), 600))
    return data[:at] + rng.choice(BITS) + data[at:]


def refusal(folder, **options) -> str:
    """What is said of a folder that is refused; nothing where it could be read."""
    try:
        read_test(folder, **SPECIMEN, **options)
    except InputError as error:
        return str(error)
    return ""


def text_frame(header, *blocks, separator=","):
    rows = np.column_stack(blocks)
    lines = [separator.join(f"{value:.6g}" for value in row) for row in rows]
    return "\n".join([header, *lines]).encode("latin-1")


def made(kind, truth, path, frame):
    point, moved = truth.reference, truth.displacement[frame]
    if kind == "vic3d":
        path.write_bytes(text_frame("X,Y,Z,U,V,W,x,y", point, moved, truth.pixels))
    elif kind == "aramis":
        header = "# Prüfung\n# Druck : analog_input : 1.5\n# ID;x_undef [mm];y_undef [mm];"
        header += "z_undef [mm];u [mm];v [mm];w [mm]"
        numbers = np.arange(len(point))
        path.write_bytes(text_frame(header, numbers, point, moved, separator=";"))
    elif kind == "tecplot":
        names = "xyz", ("X-displacement", "Y-displacement", "Z-displacement")
        header = 'TITLE = "a"\nVARIABLES = '
        header += ", ".join(f'"{name} [mm]"' for group in names for name in group)
        header += '\nZONE T="a", F=POINT'
        path.write_bytes(text_frame(header, point, moved, separator=" "))
    elif kind == "matlab":
        savemat(path, dict(zip("XYZUVW", np.hstack([point, moved]).T, strict=True)))
    elif kind == "matlab areas":
        names, columns = "XYZUVW", np.hstack([point, moved]).T
        areas = {"_0": slice(0, 20), "_1": slice(20, None)}
        savemat(
            path,
            {
                f"{name}{end}": column[rows]
                for name, column in zip(names, columns, strict=True)
                for end, rows in areas.items()
            },
            do_compression=True,
        )
    else:
        with h5py.File(path, "w") as file:
            for group, name, vectors in (
                ("coordinates", "coordinate", point),
                ("displacements", "displacement", moved),
            ):
                for axis, values in zip("xyz", vectors.T, strict=True):
                    file[f"{group}/{name}_{axis}"] = values
                file[f"{group}/mask"] = np.ones(len(values), np.uint8)


@pytest.mark.parametrize(
    ("kind", "suffix"),
    [
        ("vic3d", ".csv"),
        ("aramis", ".txt"),
        ("tecplot", ".dat"),
        ("matlab", ".mat"),
        ("matlab areas", ".mat"),
        ("istra4d", ".hdf5"),
    ],
)
def test_damaged_exports_end_in_one_line(truth, tmp_path, kind, suffix):
    rng = random.Random(kind)
    paths = [tmp_path / f"run_{i}bar{suffix}" for i in (1, 2)]
    for i, path in enumerate(paths):
        made(kind, truth, path, i + 1)
    assert read_test(tmp_path, **SPECIMEN, pressure="names").n_points == 81
    whole = paths[1].read_bytes()
    for _ in range(TRIES):
        paths[1].write_bytes(damaged(whole, rng))
        line = refusal(tmp_path, pressure="names")
        assert "\n" not in line
        assert len(line) < 2000


def test_a_damaged_matchid_test_ends_in_one_line(truth, tmp_path):
    path, options = tmp_path / "test.h5", {"pressure_column": "Force", "pressure_unit": "bar"}
    names = ("X", "Y", "Z", "Horizontal Displacement U", "Vertical Displacement V")
    position = truth.reference + truth.displacement
    columns = np.concatenate([position, truth.displacement], axis=2)
    with h5py.File(path, "w") as file:
        for i, name in enumerate((*names, "Out-Of-Plane: W")):
            file[f"DIC Data/Point Data/{name}"] = columns[..., i]
        file["DIC Data/Mapping Data/Spatial - Point Locations"] = truth.pixels
        file["DIC Data/Temporal Data/Force"] = 10 * truth.pressure[None]
    assert read_test(path, **SPECIMEN, **options).n_points == 81
    whole, rng = path.read_bytes(), random.Random("matchid")
    for _ in range(TRIES // 6):  # each is read in a process of its own
        path.write_bytes(damaged(whole, rng))
        line = refusal(path, **options)
        assert "\n" not in line
        assert len(line) < 2000


@pytest.mark.parametrize("seed", range(3))
def test_damaged_logs_end_in_one_line(truth, tmp_path, seed):
    rng = random.Random(seed)
    for i in range(3):
        made("vic3d", truth, tmp_path / f"run_{i}.csv", i)
    log = tmp_path / "log.csv"
    whole = b"Count,File,ai0 [V],p [bar]\n0,a-cal-1.tif,1,2\n" + b"".join(
        f"{i},run_{i}.tif,{i},{i * 0.4}\n".encode() for i in range(3)
    )
    for _ in range(TRIES):
        log.write_bytes(damaged(whole, rng))
        assert "\n" not in refusal(tmp_path)
