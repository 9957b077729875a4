"""How are VIC-3D's CSV exports read: its points, and its grid?"""

from __future__ import annotations

from pathlib import Path

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame
from bulgefit.dic.formats.text import Layout, read_text, recognises_text

__all__ = ["GRID", "POINTS"]

# X and x, U and u are different columns: mm in space, and pixels of the reference image.
POINTS = Layout(
    position=("X", "Y", "Z"),
    displacement=("U", "V", "W"),
    ids=("x", "y"),
    row="y",
    marks=(("sigma", -1.0),),
    zeros=("X", "Y", "Z", "U", "V", "W"),
    units=False,
)
# Where points are exported with units, as `sigma [pixel]`, they are marked as without.
GRID = Layout(
    position=("X", "Y", "Z"),
    displacement=("U", "V", "W"),
    rows_are_ids=True,
    marks=(("sigma", -1.0),),
    zeros=("X", "Y", "Z", "U", "V", "W"),
    units=True,
)


def _read_points(path: Path, ask: Ask) -> list[Frame]:
    return [read_text([POINTS], path, ask)[0]]


def _read_grid(path: Path, ask: Ask) -> list[Frame]:
    return [read_text([GRID], path, ask)[0]]


register(
    Format(
        name="vic3d",
        system="VIC-3D, points (CSV)",
        example='"X", "Y", "Z", "U", "V", "W", ..., "sigma", "x", "y"',
        recognises=recognises_text(POINTS),
        read=_read_points,
        lost="sigma -1, or a row of zeros",
        positions="reference",
    )
)
register(
    Format(
        name="vic3d-grid",
        system="VIC-3D, grid (CSV)",
        example='"X [mm]","Y [mm]","Z [mm]","U [mm]","V [mm]","W [mm]"',
        recognises=recognises_text(GRID),
        read=_read_grid,
        lost="empty cells, sigma -1, or a row of zeros",
        positions="current",
    )
)
