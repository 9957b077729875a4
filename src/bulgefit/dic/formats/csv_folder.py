"""How is a folder of one CSV file a frame read, with its pressure table?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.source import PRESSURE_TABLE
from bulgefit.dic.formats.specimen import SPECIMEN, specimen_of
from bulgefit.dic.formats.table import Table, read_table
from bulgefit.dic.registry import Recording, file_checksum, reader
from bulgefit.dic.units import LENGTH, PRESSURE, factor
from bulgefit.errors import InputError

__all__ = ["COLUMNS", "read_csv_folder"]

COLUMNS = ("x", "y", "z", "dx", "dy", "dz")


@reader(
    "csv",
    Path.is_dir,
    looks_like=f"a folder with {PRESSURE_TABLE}",
    options=["columns"],
    example="x,y,z,dx,dy,dz",
    lost="empty cell, nan, row left out",
    instead=f"the column of the pressures in {PRESSURE_TABLE} is called pressure_bar, or by "
    "another unit: rename it so; headers state that of lengths, as in 'x [m]'",
)
def read_csv_folder(path: Path, columns: Mapping[str, str] | None = None) -> Recording:
    """Read a folder of frames.

    `pressure.csv` has the columns `file` and `pressure_bar` (or another unit: `pressure_MPa`,
    `pressure_kPa`, ...), and `time_s` if wanted. Each file it names has a header and the columns
    x, y, z, dx, dy, dz in mm, or in the unit that it states; cells that are empty or nan are lost.
    Where the comma is decimal the cells are separated by semicolons or tabs. `test.json`, if there
    is one, may say name, radius (mm), thickness (mm), poisson_ratio and columns.

    Parameters
    ----------
    path : Path
    columns : mapping of str to str, optional
        What x, y, z, dx, dy, dz are called in the headers, where they differ.
    """
    if not path.is_dir():
        raise InputError(f"{path}: not a folder; the format csv is a folder of one file a frame")
    table = path / PRESSURE_TABLE
    if not table.is_file():
        found = ", ".join(sorted(entry.name for entry in path.iterdir())[:5]) or "nothing"
        raise InputError(
            f"{path}: none of its files is of a format that `bulgefit formats` shows, and it has "
            f"no {PRESSURE_TABLE}; found {found}. CSV frames need one, with the columns file and "
            "pressure_bar, a row a frame; --format table reads other text tables"
        )
    specimen = specimen_of(path / SPECIMEN)
    names = _column_names({**specimen.get("columns", {}), **(columns or {})}, path)
    files, pressure, unit, time = _pressures(table)
    _need_listed(path, files)
    frames = []
    for file in files:
        values = _in_mm(read_table(file), [names[key] for key in COLUMNS])
        frames.append((values[:, :3], values[:, 3:]))
    used = [table, *files, *([path / SPECIMEN] if (path / SPECIMEN).is_file() else [])]
    return Recording(
        pressure=pressure,
        checksum=file_checksum(*sorted(used)),
        frames=frames,
        radius=specimen.get("radius"),
        thickness=specimen.get("thickness"),
        poisson_ratio=specimen.get("poisson_ratio"),
        warp_angle=specimen.get("warp_angle"),
        at_rest=int(specimen.get("at_rest", 0)),
        time=time,
        name=specimen.get("name"),
        pressure_unit=unit,
    )


def _in_mm(table: Table, names: Sequence[str]) -> NDArray[np.float64]:
    """Columns (rows, names) in mm, from the unit that a header states, as `X [m]`."""
    units = {column.name: column.unit for column in table.columns}
    values = table.numbers(names)
    for i, name in enumerate(names):
        if (unit := units[name]) is not None:
            values[:, i] *= factor(unit, LENGTH, f"{table.path}: {name}")
    return values


def _column_names(given: Mapping[str, str], path: Path) -> dict[str, str]:
    unknown = [key for key in given if key not in COLUMNS]
    if unknown:
        raise InputError(f"{path}: unknown column {unknown[0]!r}; known are {', '.join(COLUMNS)}")
    names = {key: given.get(key, key) for key in COLUMNS}
    for first, second in combinations(COLUMNS, 2):
        if names[first] == names[second]:
            raise InputError(
                f"{path}: the column {names[first]!r} cannot be both {first} and {second}; say "
                "what each is called"
            )
    return names


def _pressures(path: Path) -> tuple[list[Path], Any, str, Any]:
    table = read_table(path)
    loads = [name for name in table.header if name.startswith("pressure_")]
    if "file" not in table.header or len(loads) != 1:
        raise InputError(
            f"{path}: needs the columns file and pressure_bar (or pressure_MPa, pressure_kPa, "
            f"pressure_mbar, pressure_Pa, pressure_psi); found {', '.join(table.header)}: rename "
            "what holds them so"
        )
    unit = loads[0].removeprefix("pressure_")
    scale = factor(unit, PRESSURE, f"{path}: {loads[0]}")
    pressure = table.numbers(loads)[:, 0] * scale
    time = table.numbers(["time_s"])[:, 0] if "time_s" in table.header else None
    files = [_frame_file(path, name, table) for name in table.texts("file")]
    return files, pressure, unit, time


def _frame_file(path: Path, name: str, table: Table) -> Path:
    file = path.parent / name
    if Path(name).name != name:
        raise InputError(f"{path}: {name!r} is not the name of a file in the folder")
    if not file.is_file():
        raise InputError(
            f"{path}: names {name}, which is not in the folder {path.parent}; export it or "
            "take its row out"
        )
    if file.resolve().parent != path.parent.resolve():
        raise InputError(f"{path}: {name} is a link out of the folder; copy the file into it")
    return file


def _need_listed(folder: Path, files: list[Path]) -> None:
    listed = {file.name for file in files}
    if len(listed) < len(files):
        raise InputError(f"{folder / PRESSURE_TABLE}: names a file twice; one row a frame")
    for file in sorted(folder.glob("*.csv")):
        if file.name not in listed | {PRESSURE_TABLE}:
            raise InputError(
                f"{folder}: {file.name} has no pressure; list it in {PRESSURE_TABLE} or move it "
                "out of the folder"
            )
