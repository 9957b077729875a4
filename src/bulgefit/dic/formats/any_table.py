"""How is the text export of another system read? The user says what its columns are called."""

from __future__ import annotations

from pathlib import Path

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.csv_folder import COLUMNS
from bulgefit.dic.formats.frames import Frame
from bulgefit.dic.formats.logs import is_log
from bulgefit.dic.formats.names import column
from bulgefit.dic.formats.source import Head, head_of
from bulgefit.dic.formats.table import find_header
from bulgefit.dic.formats.text import Layout, read_text
from bulgefit.errors import InputError

__all__: list[str] = []


def _may_be_frame(head: Head) -> bool:
    return bool(head.lines) and head.path.suffix != ".json" and not is_log(head)


def _layout(ask: Ask) -> Layout:
    given = ask.columns
    unknown = [key for key in given if key not in COLUMNS]
    if unknown:
        raise InputError(f"--columns: unknown {unknown[0]!r}; known are {', '.join(COLUMNS)}")
    x, y, z, dx, dy, dz = (column(given.get(key, key)).quantity for key in COLUMNS)
    return Layout(position=(x, y, z), displacement=(dx, dy, dz))


def _read(path: Path, ask: Ask) -> list[Frame]:
    layout = _layout(ask)
    head = head_of(path)
    if find_header(head.headers, layout.fits) is None:
        wanted = ", ".join((*layout.position, *(layout.displacement or ())))
        raise InputError(
            f"{path}: has no line with the columns {wanted}; say what they are called with "
            "--columns x=NAME,..."
        )
    return [read_text([layout], path, ask)[0]]


register(
    Format(
        name="table",
        system="any text table, with --format table --columns",
        example="--columns x=NAME,y=NAME,z=NAME,dx=NAME,dy=NAME,dz=NAME",
        recognises=_may_be_frame,
        read=_read,
        lost="empty cells, nan, or row left out",
        positions="reference",
        options=("columns",),
        by_name_only=True,
    )
)
