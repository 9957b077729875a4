"""How are exports of ARAMIS and of GOM Correlate read: nodemaps, sections, surfaces?"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, Signal
from bulgefit.dic.formats.names import column
from bulgefit.dic.formats.text import Layout, Three, read_text, recognises_text

__all__ = ["CORRELATE", "LAYOUTS"]

_UNDEFORMED = ("x_undef", "y_undef", "z_undef")
_IDS: tuple[tuple[str, ...], ...] = (("ID",), ("id",), ("Index",), ("index_x", "index_y"), ())
# Sections give the displacement, or where the points are at the frame.
_MOVED: tuple[tuple[Three | None, Three | None], ...] = (
    (("u", "v", "w"), None),
    (("dx", "dy", "dz"), None),
    (("disp_x", "disp_y", "disp_z"), None),
    (("displacement_x", "displacement_y", "displacement_z"), None),
    (None, ("x", "y", "z")),
    (None, ("x_def", "y_def", "z_def")),
)
LAYOUTS = tuple(
    Layout(_UNDEFORMED, displacement, deformed, ids=ids, also=ids)
    for ids in _IDS
    for displacement, deformed in _MOVED
)
CORRELATE = tuple(
    Layout(position=(x, y, z), displacement=(dx, dy, dz), ids=("id",))
    for x, y, z in (("x", "y", "z"), ("X", "Y", "Z"))
    for dx, dy, dz in (
        ("displacement_x", "displacement_y", "displacement_z"),
        ("dX", "dY", "dZ"),
        ("Verschiebung X", "Verschiebung Y", "Verschiebung Z"),
    )
)
# Lines of a nodemap such as `# Druck : analog_input : 1.25`.
_RECORDED = re.compile(r"^#\s*(.+?)\s*:\s*(analog_input|value_element)\s*:\s*(\S+)\s*$")


def _read(path: Path, ask: Ask) -> list[Frame]:
    frame, table = read_text(LAYOUTS, path, ask)
    signals = {**frame.signals}
    for line in table.preamble.split("\n"):
        if found := _RECORDED.match(line):
            try:
                value = float(found[3])
            except ValueError:  # text, such as the type of the specimen
                continue
            known = column(found[1])
            signals[known.name] = Signal(
                known.name, known.quantity, known.unit, np.array([value]), str(path)
            )
    return [replace(frame, signals=signals)]


def _read_correlate(path: Path, ask: Ask) -> list[Frame]:
    return [read_text(CORRELATE, path, ask)[0]]


register(
    Format(
        name="aramis",
        system="ARAMIS, nodemap and section (text)",
        example="# ID; x_undef [mm]; y_undef [mm]; z_undef [mm]; u [mm]; v [mm]; w [mm]",
        recognises=recognises_text(*LAYOUTS),
        read=_read,
        lost="nan",
        positions="reference",
    )
)
register(
    Format(
        name="gom",
        system="GOM Correlate (CSV)",
        example="id,x,y,z,displacement_x,displacement_y,displacement_z",
        recognises=recognises_text(*CORRELATE),
        read=_read_correlate,
        lost="empty cells, or row left out",
        positions="current",
    )
)
