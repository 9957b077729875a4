"""How do points that come and go become those of one test? By id, else by position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bulgefit.dic.formats.frames import Frame
from bulgefit.dic.formats.positions import CURRENT, SAME, spacing

__all__ = ["joined"]

Floats = NDArray[np.floating]


def joined(frames: list[Frame], positions: str) -> tuple[list[tuple[Floats, Floats]], str, int]:
    """The (reference, displacement) of each frame, a point at the same place in all of them.

    A point's place is that of the first frame that has it: estimates of later frames differ by
    the rounding of the file, and by what the system measured anew.

    Parameters
    ----------
    frames : list of Frame
    positions : str
        What the positions of the frames are, "reference" or "current".

    Returns
    -------
    list of ((n_i, 3) array, (n_i, 3) array), mm
    str
        By what the points were joined: "id", "position", or "nothing" where frames have points of
        their own.
    int
        How many distinct points there are.
    """
    reference = [
        frame.position - frame.displacement if positions == CURRENT else frame.position
        for frame in frames
    ]
    ids = _usable_ids(frames)
    if ids is not None:
        placed = _by_number(frames, reference, ids)
        if _are_near(placed, reference):
            return placed, "id", _count(ids)
    numbers = _numbers_by_position(reference)
    if numbers is None:
        displacement = [frame.displacement for frame in frames]
        return list(zip(reference, displacement, strict=True)), "nothing", sum(map(len, reference))
    return _by_number(frames, reference, numbers), "position", _count(numbers)


def _count(numbers: list[NDArray[np.intp]]) -> int:
    return max((int(number.max()) + 1 for number in numbers if len(number)), default=0)


def _usable_ids(frames: list[Frame]) -> list[NDArray[np.intp]] | None:
    """A number for each point of each frame, if every frame tells its points apart."""
    if any(frame.ids is None for frame in frames):
        return None
    ids = [frame.ids for frame in frames if frame.ids is not None]
    # one number for each row of ids: comparing rows is many times slower
    keys = np.zeros(sum(map(len, ids)), dtype=np.int64)
    for column in np.concatenate(ids).T:
        _, rank = np.unique(column, return_inverse=True)
        keys = np.unique(keys * (rank.max(initial=0) + 1) + rank, return_inverse=True)[1]
    numbers = np.split(keys, np.cumsum([len(rows) for rows in ids])[:-1])
    if any(len(np.unique(number)) < len(number) for number in numbers):
        return None
    return numbers


def _are_near(placed: list[tuple[Floats, Floats]], reference: list[Floats]) -> bool:
    """Whether the points of one id are nearer to one another than to their neighbours.

    Ids that count anew in each frame, such as rows where lost points are left out, are none.
    """
    for (place, _), points in zip(placed, reference, strict=True):
        off = np.linalg.norm(place - points, axis=1)
        if len(off) and np.median(off) > 0.5 * spacing(points):
            return False
    return True


def _numbers_by_position(reference: list[Floats]) -> list[NDArray[np.intp]] | None:
    """The same from positions; None where most points of a frame are new ones."""
    numbers: list[NDArray[np.intp]] = []
    known = np.empty((0, 3))
    for points in reference:
        number = np.full(len(points), -1, dtype=np.intp)
        if len(known) and len(points):
            near = SAME * spacing(points)
            distance, nearest = cKDTree(known).query(points, distance_upper_bound=near or 1e-9)
            found = np.isfinite(distance)
            if len(np.unique(nearest[found])) < found.sum() or found.mean() < 0.5:
                return None
            number[found] = nearest[found]
        new = number < 0
        number[new] = len(known) + np.arange(new.sum())
        known = np.concatenate([known, points[new]])
        numbers.append(number)
    return numbers


def _by_number(
    frames: list[Frame], reference: list[Floats], numbers: list[NDArray[np.intp]]
) -> list[tuple[Floats, Floats]]:
    place = np.full((_count(numbers), 3), np.nan)
    for points, number in zip(reference, numbers, strict=True):
        new = np.isnan(place[number, 0])
        place[number[new]] = points[new]
    return [
        (place[number], frame.displacement) for frame, number in zip(frames, numbers, strict=True)
    ]
