"""How are MatchID's stereo exports read, of 2023 and of 2024?"""

from __future__ import annotations

from pathlib import Path

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame
from bulgefit.dic.formats.text import Layout, read_text, recognises_text

__all__ = ["DISPLACEMENT", "LAYOUTS"]

#: What the three components are called.
DISPLACEMENT = ("Horizontal Displacement U", "Vertical Displacement V", "Out-Of-Plane: W")
_PREFIXED = (f"disp.{DISPLACEMENT[0]}", f"disp.{DISPLACEMENT[1]}", f"disp.{DISPLACEMENT[2]}")
LAYOUTS = (
    Layout(
        position=("x", "y", "z"),
        displacement=("u", "v", "w"),
        ids=("x_pic", "y_pic"),
        row="y_pic",
        zeros=("x", "y", "z", "u", "v", "w"),
        also=("x_pic", "y_pic"),
    ),
    Layout(
        position=("coor.X", "coor.Y", "coor.Z"),
        displacement=_PREFIXED,
        ids=("Coordinates.Image X", "Coordinates.Image Y"),
        row="Coordinates.Image Y",
        zeros=("coor.X", "coor.Y", "coor.Z", *_PREFIXED),
    ),
    Layout(
        position=("X", "Y", "Z"),
        displacement=DISPLACEMENT,
        ids=("Image X", "Image Y"),
        row="Image Y",
        zeros=("X", "Y", "Z", *DISPLACEMENT),
    ),
)


def _read(path: Path, ask: Ask) -> list[Frame]:
    return [read_text(LAYOUTS, path, ask)[0]]


register(
    Format(
        name="matchid",
        system="MatchID 2023 and 2024 (CSV)",
        example="x_pic,y_pic,x,y,z,u,v,w or coor.X [mm],...,disp.Out-Of-Plane: W [mm]",
        recognises=recognises_text(*LAYOUTS),
        read=_read,
        lost="row left out, or a row of zeros",
        positions="current",
        y_down=True,
    )
)
