"""Which points stand at the centre of a bin of which only a part was measured?

A cloud that was averaged in square bins may be given at the bins' centres. Where the rim or a hole
cuts a bin, what was averaged lies to one side of that: an edge that cuts bins anywhere leaves a
part of them whose middle is a quarter of their width away, on average. Beside the rim of a bulge,
where the cloth stands at 40 degrees, heights are then off by more than a millimetre.

Such points show what the field is further inside. So it is told how far: what the three bins before
it continue to, at a bin at the edge, is compared with what that shows.
"""

from __future__ import annotations

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
#: Strips in which points are counted first, and columns over the root of their number that a square
#: grid has at most: it has as many as that on a disc, and rounding spreads each over a few strips.
_STRIPS, _COLUMNS = 10_000, 8.0
#: Places of the grid for each point, at most: a disc has 1.3 times as many in the square about it.
_HOLES = 4.0
#: The eight bins around one, those first that share a side with it, and which lies across.
_AROUND = np.array([(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)])
_ACROSS = (1, 0, 3, 2)
#: Of a parabola through what is 1, 2 and 3 bins inside: its value and its slope by a bin at 0.
_VALUE, _SLOPE = np.array([3.0, -3.0, 1.0]), np.array([-2.5, 4.0, -1.5])
#: Most frames that are looked at.
_FRAMES = 8
#: Bins at the edge that must be there to tell, and standard errors by which they do.
_FEWEST, _SURE = 30, 3.0


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
    """The bins of a block that are cut; None where none or all are, or points are where they say.

    Bins at the edge, one of whose sides is never measured beyond, tell which: they show the field
    half way or more from their centres, where points lie that are no bins, to where cut bins lie on
    average, a quarter of the width; by three standard errors or more.
    """
    points = np.asarray(block.reference[:, :2], dtype=np.float64)
    if (around := _neighbours(points)) is None:
        return None
    width, neighbours = around
    known = block.measured
    shifts = width * _shifts(block, known, neighbours)
    if len(shifts) < _FEWEST:
        return None
    # no part of a bin has its middle farther from the bin's than half the width
    shifts = np.clip(shifts, -0.5 * width, 0.5 * width)
    shift, error = float(shifts.mean()), float(shifts.std() / np.sqrt(len(shifts)))
    if shift < width / 8.0 or shift < _SURE * error:
        return None
    beside = np.concatenate([known, np.zeros((len(known), 1), dtype=bool)], axis=1)[:, neighbours]
    whole: Mask = np.asarray(known & beside.all(axis=2))
    if not whole.any():
        return None
    return CutBins(width, shift, error, whole, int((known.any(axis=0) & ~whole.any(axis=0)).sum()))


def of_whole_bins(test: BulgeTest) -> tuple[BulgeTest, int]:
    """The test without what cut bins show, and how many of its points are not in it at all.

    Bins count as cut in a frame in which any of the eight around them was not measured.
    """
    found = [cut_bins(block) for block in test.blocks]
    if not any(found):
        return test, 0
    whole = [
        block.measured if one is None else one.whole
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
    if len(points) < _FEWEST or not _may_be_grid(points[:, 0]):
        return None
    distance, _ = KDTree(points).query(points, k=2)
    width = float(np.median(distance[:, 1]))
    if width == 0.0:
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # points may be as close as numbers are
        place = (points - points[0]) / width
        cell = np.round(place)
        off, places = np.abs(place - cell).max(), np.prod(np.ptp(cell, axis=0))
    if not (off <= _ROUNDED and places <= _HOLES * len(cell)):
        return None
    cell = cell.astype(np.int64) - cell.min(axis=0).astype(np.int64) + 1
    table = np.full(cell.max(axis=0) + 2, -1)
    table[tuple(cell.T)] = np.arange(len(points))
    return width, np.stack([table[tuple((cell + step).T)] for step in _AROUND], axis=1)


def _may_be_grid(x: Floats) -> bool:
    """Whether the points (n,) mm stand in few columns: a cloud of 40,000 is not looked at twice."""
    strip = (x - x.min()) / max(float(np.ptp(x)), 1e-300) * _STRIPS
    return len(np.unique(strip.astype(np.int64))) <= _COLUMNS * np.sqrt(len(x))


def _shifts(block: Block, known: Mask, neighbours: NDArray[np.int64]) -> Floats:
    """How far inside its centre each bin at the edge shows the field, in widths: (that tell it,).

    A bin tells it by the frames and components in which its three inner neighbours, across from the
    side that is never measured, are known; each component by how straight others go on inside.
    """
    ever = np.append(known.any(axis=0), False)
    inner = ever[:-1] & ever[neighbours].all(axis=1)
    frames, found = _frames(known), []
    measured = np.asarray(block.displacement[frames], dtype=np.float64)
    for side, across in enumerate(_ACROSS):
        chain = _chain(neighbours[:, across])
        there = (chain >= 0).all(axis=0)
        at_edge = there & ever[:-1] & ~ever[neighbours[:, side]]
        off = measured - np.tensordot(_VALUE, measured[:, chain], (0, 1))
        slope = np.tensordot(_SLOPE, measured[:, chain], (0, 1))
        inside = off[:, there & inner & inner[chain].all(axis=0)]
        number = np.isfinite(inside).sum(axis=1, keepdims=True)
        square = np.nansum(inside**2, axis=1, keepdims=True)
        weight = np.where(number > 0, number / np.maximum(square, 1e-300), 0.0)
        told = np.nansum(weight * off * slope, axis=(0, 2))[at_edge]
        weights = np.nansum(weight * np.where(np.isnan(off), 0.0, slope**2), axis=(0, 2))[at_edge]
        found.append(told[weights > 0.0] / weights[weights > 0.0])
    return np.concatenate(found)


def _chain(inward: NDArray[np.int64]) -> NDArray[np.int64]:
    """The bins 1, 2 and 3 inside each, (3, n); -1 where there is none."""
    inward = np.append(inward, -1)
    first = inward[:-1]
    return np.stack([first, inward[first], inward[inward[first]]])


def _frames(known: Mask) -> NDArray[np.int64]:
    """Frames with measured points, evenly among them."""
    some = np.flatnonzero(known.any(axis=1))
    every = np.linspace(0, len(some) - 1, min(_FRAMES, len(some)))
    return np.asarray(some[every.round().astype(int)])
