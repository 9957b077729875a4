"""What was written twice, frames or tests? Noise is never the same twice: a copy tells nothing."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.reference_image import shows_nothing, without_reference

__all__ = ["copied_frames", "repeated_frames", "same_data", "without_copies"]


def copied_frames(test: BulgeTest) -> dict[int, int]:
    """Frames that are bit for bit another one at the same pressure, each with the first of them.

    Images at rest in which nothing has moved at all are references, and no copies.
    """
    return _same(test, _of_one_pressure(test), lambda frame: float(test.pressure[frame]))


def repeated_frames(test: BulgeTest) -> dict[int, int]:
    """Frames that are bit for bit another one at another pressure, each with the first of them."""
    same = _same(test, range(test.n_frames), lambda _: None)
    return {k: first for k, first in same.items() if test.pressure[k] != test.pressure[first]}


def _same(
    test: BulgeTest, frames: Iterable[int], apart: Callable[[int], Hashable]
) -> dict[int, int]:
    """Frames that hold what one before them does, and are not set apart from it, with the first."""
    first: dict[tuple[Hashable, bytes], int] = {}
    same = {}
    for frame in frames:
        content = _content(test, frame)
        if content is None:
            continue
        if (found := first.setdefault((apart(frame), content), frame)) != frame:
            same[frame] = found
    return same


def without_copies(test: BulgeTest) -> BulgeTest:
    """The test with each frame once; itself where none is a copy."""
    copies = copied_frames(test)
    if not copies:
        return test
    return test.select(frames=[k for k in range(test.n_frames) if k not in copies])


def same_data(one: BulgeTest, other: BulgeTest) -> bool:
    """Whether two tests hold the same measurement, whatever their files are called.

    Frames that were written twice, or the reference image beside them, do not tell them apart: the
    former are counted once, the latter is no measurement.
    """
    one, other = (without_reference(without_copies(test)) for test in (one, other))
    return (
        np.array_equal(one.pressure, other.pressure)
        and len(one.blocks) == len(other.blocks)
        and all(
            np.array_equal(mine.displacement, theirs.displacement, equal_nan=True)
            for mine, theirs in zip(one.blocks, other.blocks, strict=True)
        )
    )


def _of_one_pressure(test: BulgeTest) -> list[int]:
    """Frames whose pressure another one has too."""
    _, which, count = np.unique(test.pressure, return_inverse=True, return_counts=True)
    return np.flatnonzero(count[which] > 1).tolist()


def _content(test: BulgeTest, frame: int) -> bytes | None:
    """Points and displacement of a frame; None where nothing has moved."""
    for block in test.blocks:
        for row in np.flatnonzero(block.frames == frame):
            moved = block.displacement[row]
            if shows_nothing(moved):
                return None
            return block.reference.tobytes() + moved.tobytes()
    return None
