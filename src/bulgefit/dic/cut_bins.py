"""Which points stand at the centre of a bin of which only a part was measured?

A cloud that was averaged in square bins may be given at the bins' centres. Where the rim or a hole
cuts a bin, what was averaged lies to one side of that: an edge that cuts bins anywhere leaves a
part of them whose middle is a quarter of their width away, on average. Beside the rim of a bulge,
where the cloth stands at 40 degrees, heights are then off by more than a millimetre.

Such points show what the field is further inside. So it is told how far: the field through the
whole bins, continued by a polynomial, is compared with what the cut ones show.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.errors import InputError

__all__ = ["CutBins", "cut_bins", "of_whole_bins", "whole_bins"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Share of the width by which points may lie off a square grid: files round to some digits.
_ROUNDED = 0.01
#: The eight bins around one, those first that share a side with it.
_AROUND = np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)])
_SIDES = 4
#: Degree of the polynomial that continues the field, and most frames that are looked at.
_DEGREE, _FRAMES = 6, 8
#: Whole bins and cut ones that must be there to tell, and standard errors by which they do.
_FEWEST, _SURE = 60, 3.0


@dataclass(frozen=True, eq=False)
class CutBins:
    """Bins of one block that are cut and given at their centres.

    Attributes
    ----------
    width : float, mm
        Of a bin.
    shift, error : float, mm
        How far inside its centre a bin at the edge shows the field, on average; standard error.
    whole : (frames, n) bool array
        Measured points all of whose neighbours were measured.
    lost : int
        Points that are cut in every frame.
    """

    width: float
    shift: float
    error: float
    whole: Mask
    lost: int


def cut_bins(block: Block) -> CutBins | None:
    """The bins of a block that are cut; None where there are none, or points are where they say.

    Bins at the edge, one of whose sides is never measured beyond, tell which: they show the field
    half way or more from their centres, where points lie that are no bins, to where cut bins lie on
    average, a quarter of the width; by three standard errors or more.
    """
    points = np.asarray(block.reference[:, :2], dtype=np.float64)
    if len(points) < _FEWEST or (around := _neighbours(points)) is None:
        return None
    width, neighbours = around
    known: Mask = np.asarray(np.isfinite(block.displacement).all(axis=2))
    ever: Mask = np.append(known.any(axis=0), False)[neighbours]
    edge, inner = np.asarray(~ever[:, :_SIDES].all(axis=1)), np.asarray(ever.all(axis=1))
    shifts = _shifts(block, points, known, (edge, inner), ever @ _AROUND.astype(float))
    if len(shifts) < _FEWEST // 2:
        return None
    # no part of a bin has its middle farther from the bin's than half the width
    shifts = np.clip(shifts, -0.5 * width, 0.5 * width)
    shift, error = float(shifts.mean()), float(shifts.std() / np.sqrt(len(shifts)))
    if shift < width / 8.0 or shift < _SURE * error:
        return None
    beside = np.concatenate([known, np.zeros((len(known), 1), dtype=bool)], axis=1)[:, neighbours]
    whole: Mask = np.asarray(known & beside.all(axis=2))
    return CutBins(width, shift, error, whole, int((known.any(axis=0) & ~whole.any(axis=0)).sum()))


def of_whole_bins(test: BulgeTest) -> tuple[BulgeTest, int]:
    """The test without what cut bins show, and how many of its points are not in it at all.

    Bins count as cut in a frame in which any of the eight around them was not measured.

    Raises
    ------
    InputError
        No bin is whole.
    """
    found = [cut_bins(block) for block in test.blocks]
    if not any(found):
        return test, 0
    whole = [
        np.asarray(np.isfinite(block.displacement).any(axis=2)) if one is None else one.whole
        for block, one in zip(test.blocks, found, strict=True)
    ]
    kept = [mask.any(axis=0) for mask in whole]
    test = test.select(points=kept if len(kept) > 1 else kept[0])
    blocks = []
    for block, one, mask, points in zip(test.blocks, found, whole, kept, strict=True):
        measured = mask[:, points, None]
        lost = block.displacement.dtype.type(np.nan)
        shown = block.displacement if one is None else np.where(measured, block.displacement, lost)
        blocks.append(replace(block, displacement=shown))
    return replace(test, blocks=tuple(blocks)), sum(one.lost for one in found if one is not None)


def whole_bins(test: BulgeTest) -> BulgeTest:
    """The same; InputError where no bins are cut, or their points are where they say."""
    found, lost = of_whole_bins(test)
    if not lost:
        raise InputError(
            f"--whole-bins: {test.name}: its points lie on no square grid, or those at its edge "
            "show the field where they say; leave it out"
        )
    return found


def _neighbours(points: Floats) -> tuple[float, NDArray[np.int64]] | None:
    """Width of the square grid that points lie on, and of each its eight neighbours (n, 8).

    -1 where there is none. None where they lie on no such grid.
    """
    distance, _ = KDTree(points).query(points, k=2)
    width = float(np.median(distance[:, 1]))
    if width == 0.0:
        return None
    place = (points - points[0]) / width
    cell = np.round(place)
    if np.abs(place - cell).max() > _ROUNDED:
        return None
    cell = cell.astype(np.int64) - cell.min(axis=0).astype(np.int64) + 1
    table = np.full(cell.max(axis=0) + 2, -1)
    table[tuple(cell.T)] = np.arange(len(points))
    return width, np.stack([table[tuple((cell + step).T)] for step in _AROUND], axis=1)


def _shifts(
    block: Block, points: Floats, known: Mask, bins: tuple[Mask, Mask], inwards: Floats
) -> Floats:
    """How far inside its centre each bin at the edge shows the field, mm: (those that tell it,)."""
    length = np.linalg.norm(inwards, axis=1)
    edge, inner = bins[0] & (length > 0.0), bins[1]
    direction = inwards / np.maximum(length, 1.0)[:, None]
    scale = float(np.abs(points).max())
    value, by_x, by_y = _polynomials(points / scale)
    told, weights = np.zeros(len(points)), np.zeros(len(points))
    for frame in _frames(known & inner):
        inside, cut = known[frame] & inner, known[frame] & edge
        for component in np.asarray(block.displacement[frame], dtype=np.float64).T:
            fit, *_ = np.linalg.lstsq(value[inside], component[inside], rcond=None)
            misfit = float(np.mean((component[inside] - value[inside] @ fit) ** 2))
            slope = (direction[:, 0] * (by_x @ fit) + direction[:, 1] * (by_y @ fit))[cut] / scale
            weight = 1.0 / max(misfit, 1e-300)
            told[cut] += weight * slope * (component[cut] - value[cut] @ fit)
            weights[cut] += weight * slope**2
    return np.asarray(told[weights > 0.0] / weights[weights > 0.0])


def _frames(whole: Mask) -> Iterator[int]:
    """Frames of enough whole bins, evenly among them."""
    enough = np.flatnonzero(whole.sum(axis=1) >= _FEWEST)
    if len(enough):
        for i in np.unique(np.linspace(0, len(enough) - 1, _FRAMES).round().astype(int)):
            yield int(enough[i])


def _polynomials(place: Floats) -> tuple[Floats, Floats, Floats]:
    """Monomials (n, k) of x and y up to the degree, and their derivatives by either."""
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    x, y = (place[:, axis, None] ** np.arange(_DEGREE + 1) for axis in (0, 1))
    value = np.stack([x[:, i] * y[:, j] for i, j in powers], axis=1)
    by_x = np.stack([i * x[:, max(i - 1, 0)] * y[:, j] for i, j in powers], axis=1)
    by_y = np.stack([j * x[:, i] * y[:, max(j - 1, 0)] for i, j in powers], axis=1)
    return value, by_x, by_y
