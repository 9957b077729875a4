"""How are DICe's stereo solutions read?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame
from bulgefit.dic.formats.names import Column
from bulgefit.dic.formats.source import Head, head_of
from bulgefit.dic.formats.table import find_header
from bulgefit.dic.formats.text import Layout, read_text
from bulgefit.errors import InputError

__all__ = ["STEREO"]

STEREO = Layout(
    position=("MODEL_COORDINATES_X", "MODEL_COORDINATES_Y", "MODEL_COORDINATES_Z"),
    displacement=("MODEL_DISPLACEMENT_X", "MODEL_DISPLACEMENT_Y", "MODEL_DISPLACEMENT_Z"),
    ids=("SUBSET_ID",),
    row="COORDINATE_Y",
    marks=(("SIGMA", -1.0), ("MATCH", -1.0)),
)


def _is_dice(head: Head) -> bool:
    """Whether these are columns of DICe, of a stereo solution or not."""

    def is_of_dice(columns: Sequence[Column]) -> bool:
        return any(column.quantity == "COORDINATE_X" for column in columns)

    return find_header(head.headers, is_of_dice) is not None


def _read(path: Path, ask: Ask) -> list[Frame]:
    if find_header(head_of(path).headers, STEREO.fits) is None:
        raise InputError(
            f"{path}: has no MODEL_COORDINATES and MODEL_DISPLACEMENT, so it is a solution in the "
            "plane of the image, in pixels; a bulge needs a stereo solution with both among its "
            "output fields"
        )
    return [read_text([STEREO], path, ask)[0]]


register(
    Format(
        name="dice",
        system="DICe, stereo (text)",
        example="SUBSET_ID,COORDINATE_X,...,MODEL_COORDINATES_X,...,MODEL_DISPLACEMENT_X,...,SIGMA",
        recognises=_is_dice,
        read=_read,
        lost="SIGMA or MATCH -1",
        positions="reference",
        y_down=True,
    )
)
