"""How do clouds of points become one field of fewer, less noisy ones? By a quadratic in each.

In a square bin, displacement is a quadratic in position, by least squares over the points that the
frame has there, and is read at the mean position of all points that any frame has there. A plain
mean would lie below a curved surface, by 0.01 to 0.02 mm for bins of 7 mm, and would move where
points are lost. Images at rest are binned alike, so that they tell the noise that is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.errors import InputError

__all__ = ["binned"]

Floats = NDArray[np.floating]

# A quadratic has six numbers; with twice as many points it still averages.
_FEWEST_POINTS = 12
# A bin's points must spread: the square of the bin's side, over their mean square distance, and
# the condition of the normal equations in such units.
_WORST_CONDITION = 1e6


def binned(test: BulgeTest, side: float) -> BulgeTest:
    """Bin a test in squares of `side` (mm), from the clamp's centre on.

    Bins with fewer than 12 points in a frame are lost in it; those that are lost in all are left
    out.

    Raises
    ------
    InputError
        No bin has enough points.
    """
    points = np.concatenate([block.reference for block in test.blocks])
    bins = np.floor(points[:, :2] / side + 0.5).astype(np.int64)
    cells, cell = np.unique(bins, axis=0, return_inverse=True)
    count = np.bincount(cell.ravel(), minlength=len(cells))
    centre = _sums(cell.ravel(), points, len(cells)) / count[:, None]
    starts = np.cumsum([0] + [len(block.reference) for block in test.blocks])
    moved = np.full((test.n_frames, len(cells), 3), np.nan)
    static = None
    for block, start in zip(test.blocks, starts, strict=False):
        own = cell.ravel()[start : start + len(block.reference)]
        place = (block.reference[:, :2] - centre[own, :2]) / side
        for row, frame in enumerate(block.frames):
            moved[frame] = _read_at_centres(own, place, block.displacement[row], len(cells))
        if test.static_displacement is not None:
            images = [
                _read_at_centres(own, place, image, len(cells))
                for image in test.static_displacement
            ]
            static = np.array(images)
    kept = np.isfinite(moved).any(axis=(0, 2))
    if not kept.any():
        raise InputError(
            f"{test.source or test.name}: no bin of {side:g} mm has {_FEWEST_POINTS} points; give "
            "larger ones"
        )
    return replace(
        test,
        blocks=(Block(centre[kept], np.arange(test.n_frames), moved[:, kept]),),
        static_displacement=None if static is None else static[:, kept],
    )


def _sums(cell: NDArray[np.int64], values: Floats, count: int) -> Floats:
    """Sums of the rows of values (n, m) over each cell."""
    return np.column_stack([np.bincount(cell, column, count) for column in values.T])


def _read_at_centres(
    cell: NDArray[np.int64], place: Floats, displacement: Floats, count: int
) -> Floats:
    """The quadratic of each cell, at place 0."""
    read = np.full((count, 3), np.nan)
    x, y = place.T
    basis = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    for axis in range(3):
        known = np.isfinite(displacement[:, axis])
        own, terms = cell[known], basis[known]
        values = displacement[known, axis].astype(np.float64)
        products = (terms[:, :, None] * terms[:, None, :]).reshape(len(terms), 36)
        normal = _sums(own, products, count).reshape(count, 6, 6)
        right = _sums(own, terms * values[:, None], count)
        good = np.flatnonzero(normal[:, 0, 0] >= _FEWEST_POINTS)
        good = good[np.linalg.cond(normal[good]) < _WORST_CONDITION]
        read[good, axis] = np.linalg.solve(normal[good], right[good][..., None])[:, 0, 0]
    return read
