"""What does one export of a DIC system hold? Points, displacements, and what else was recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError

__all__ = ["Frame", "Signal", "measured_rows", "upright"]

Floats = NDArray[np.floating]

# Farther than this, mm, is no position and no displacement in a bulge test.
_FARTHEST = 1e6
# |cos| of the angle between rows of pixels and y, from which y is nearer to them than to columns.
_ALONG = np.sqrt(0.5)


@dataclass(frozen=True)
class Signal:
    """A number that was recorded with a frame, or one a frame.

    Attributes
    ----------
    name : str
        As the file has it.
    quantity : str
        The name without its unit.
    unit : str or None
        None where the file states none.
    values : (frames,) array
    where : str
        File, for messages.
    """

    name: str
    quantity: str
    unit: str | None
    values: Floats
    where: str


@dataclass(frozen=True)
class Frame:
    """The points of one frame, of which some may be lost.

    Attributes
    ----------
    path : Path
    name : str
        By which a log knows the frame.
    position : (n, 3) array, mm
        As the file has it: before inflation or at the frame, whichever the format declares.
    displacement : (n, 3) array, mm
    ids : (n, k) int array or None
        What tells the points apart through the frames, such as pixels of the reference image.
    lost : int
        Points that the file marks as lost; they are not among the n.
    pixels : (n,) array or None
        Rows of the points in the reference image, counted downwards.
    signals : mapping of str to Signal
        What else was recorded, by name.
    has_units : bool
        Whether the file states the unit of its lengths.
    """

    path: Path
    name: str
    position: Floats
    displacement: Floats
    ids: NDArray[np.int64] | None = None
    lost: int = 0
    pixels: Floats | None = None
    signals: Mapping[str, Signal] = field(default_factory=dict)
    has_units: bool = True


def measured_rows(frame: Frame, lost: NDArray[np.bool_]) -> Frame:
    """The frame without the points that are lost, or that have no position or displacement.

    Raises
    ------
    InputError
        What is left holds a number that is no length in a bulge test.
    """
    known = np.isfinite(frame.position).all(axis=1) & np.isfinite(frame.displacement).all(axis=1)
    kept = known & ~lost
    for values, what in ((frame.position, "position"), (frame.displacement, "displacement")):
        far = (np.abs(values[kept]) > _FARTHEST).any(axis=1)
        if far.any():
            at = int(np.flatnonzero(kept)[np.argmax(far)])
            raise InputError(
                f"{frame.path}: {what} {values[at].tolist()} of point {at} is none in mm; leave "
                "lost points out, or give --length-unit"
            )
    return replace(
        frame,
        position=frame.position[kept],
        displacement=frame.displacement[kept],
        ids=None if frame.ids is None else frame.ids[kept],
        pixels=None if frame.pixels is None else frame.pixels[kept],
        lost=frame.lost + int((~kept).sum()),
    )


def upright(frames: list[Frame], declared_down: bool) -> tuple[list[Frame], bool]:
    """Frames whose y runs up and whose z comes towards the cameras, and whether they were turned.

    Systems that take the camera's own axes let y run down the image and z away from it: half a
    turn about x mends both. Where the rows of the image are known they tell which way y runs,
    since a user may have chosen other axes; where y runs along neither, the format's word counts.

    Parameters
    ----------
    frames : list of Frame
    declared_down : bool
        Whether y of the format runs down the image.
    """
    down = declared_down
    rows = [frame for frame in frames if frame.pixels is not None and len(frame.pixels) > 2]
    if rows:
        y, row = rows[0].position[:, 1], rows[0].pixels
        if row is not None and np.ptp(y) > 0 and np.ptp(row) > 0:
            along = float(np.corrcoef(y, row)[0, 1])
            down = along > 0 if abs(along) > _ALONG else declared_down
    if not down:
        return frames, False
    turn = np.array([1.0, -1.0, -1.0])
    return [
        replace(frame, position=frame.position * turn, displacement=frame.displacement * turn)
        for frame in frames
    ], True
