"""How are the text exports of DaVis (StrainMaster) read: its CSV, and its Tecplot .dat?"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.encoding import text_of
from bulgefit.dic.formats.frames import Frame, measured_rows
from bulgefit.dic.formats.names import Column, column
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.formats.text import Layout, fitting_layout, read_text, recognises_text
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError

__all__ = ["LAYOUTS"]

# Cells of the grid outside the mask keep their x and y, and zeros in all else.
LAYOUTS = tuple(
    Layout(position=(x, y, z), displacement=(dx, dy, dz), zeros=(z, dx, dy, dz))
    for x, y, z in (("x", "y", "z"), ("X", "Y", "Z"))
    for dx, dy, dz in (
        ("X-displacement", "Y-displacement", "Z-displacement"),
        ("x-displacement", "y-displacement", "z-displacement"),
        ("X-Displacement", "Y-Displacement", "Z-Displacement"),
        ("Displacement x", "Displacement y", "Displacement z"),
        ("Displacement u", "Displacement v", "Displacement w"),
        ("Displacement X", "Displacement Y", "Displacement Z"),
    )
)
_VARIABLES = re.compile(r"^\s*VARIABLES\s*=", re.IGNORECASE)
_ZONE = re.compile(r"^\s*(TITLE|ZONE|STRANDID|SOLUTIONTIME|DT\s*=|I\s*=|#|$)", re.IGNORECASE)
_VALID = "isValid"


def _read_csv(path: Path, ask: Ask) -> list[Frame]:
    return [read_text(LAYOUTS, path, ask)[0]]


def _is_tecplot(head: Head) -> bool:
    return fitting_layout(LAYOUTS, _variables(head.lines)) is not None


def _variables(lines: Sequence[str]) -> list[Column]:
    """The columns of a Tecplot file; their names may go on over several lines."""
    names: list[str] = []
    inside = False
    for line in lines:
        if _VARIABLES.match(line):
            inside = True
        elif inside and not line.lstrip().startswith('"'):
            break
        if inside:
            names += re.findall(r'"([^"]*)"', line)
    return [column(name) for name in names]


def _read_tecplot(path: Path, ask: Ask) -> list[Frame]:
    lines = text_of(path).split("\n")
    columns = _variables(lines)
    layout = fitting_layout(LAYOUTS, columns)
    if layout is None or layout.displacement is None:
        raise InputError(f"{path}: has no VARIABLES of position and displacement; export them")
    quantities = [column.quantity for column in columns]
    cells = np.array(list(_numbers(lines, len(columns), path))).reshape(-1, len(columns))
    chosen = [quantities.index(name) for name in (*layout.position, *layout.displacement)]
    values = cells[:, chosen]
    for i, at in enumerate(chosen):
        unit = columns[at].unit
        where = f"{path}: {columns[at].name!r}"
        values[:, i] *= ask.length if unit is None else factor(unit, LENGTH, where)
    lost = np.zeros(len(cells), dtype=bool)
    if _VALID in quantities:
        lost = cells[:, quantities.index(_VALID)] == 0
    frame = Frame(path, frame_name(path.name), values[:, :3], values[:, 3:])
    return [measured_rows(frame, lost)]


def _numbers(lines: Sequence[str], count: int, path: Path) -> Iterator[list[float]]:
    inside = False
    for number, line in enumerate(lines, 1):
        if _VARIABLES.match(line):
            inside = True
        elif inside and not _ZONE.match(line) and not line.lstrip().startswith('"'):
            cells = line.split()
            try:
                row = [float(cell) for cell in cells]
            except ValueError:
                raise InputError(
                    f"{path}: line {number} holds something that is not a number; export it with "
                    "points as decimal signs and data by points (F=POINT)"
                ) from None
            if len(row) != count:
                raise InputError(
                    f"{path}: line {number} has {len(row)} numbers for {count} VARIABLES; export "
                    "it with data by points (F=POINT)"
                )
            yield row


register(
    Format(
        name="davis",
        system="DaVis / StrainMaster (CSV)",
        example="x [mm];y [mm];z [mm];X-displacement [mm];Y-displacement [mm];...",
        recognises=recognises_text(*LAYOUTS),
        read=_read_csv,
        lost="row left out, or zeros but for x and y",
        positions="reference",
    )
)
register(
    Format(
        name="davis-tecplot",
        system="DaVis / StrainMaster (Tecplot .dat)",
        example='VARIABLES = "x [mm]", "y [mm]", "z [mm]", "X-displacement [mm]", ..., "isValid"',
        recognises=_is_tecplot,
        read=_read_tecplot,
        lost="isValid 0",
        positions="reference",
    )
)
