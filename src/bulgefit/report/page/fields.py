"""How do measured and modelled fields travel in a page? A few thousand points, as small integers.

Fields are arrays of 16-bit integers in base64, with the millimetres that one step is worth: 40 mm
of displacement are kept to 0.7 µm, a tenth of the noise of good cameras.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.report import _figure

__all__ = ["MOST_TESTS", "packed", "thinned"]

Floats = NDArray[np.floating]

#: Of one page: tests with maps, points of a map, pressures of the slider.
MOST_TESTS, MOST_POINTS, MOST_FRAMES = 12, 1500, 12
#: Numbers of all maps together; each takes 2.7 bytes of the page's three million.
MOST_VALUES = 600_000
#: Fields of a point: three components each of what is measured and of two residuals.
_FIELDS = 9
#: Stands for what was not measured.
_LOST = -32768
#: Edges longer than so many spacings of the points span a hole.
_HOLE = 2.6


def thinned(test: BulgeTest, tests: int, judged_bar: Sequence[float] | None = None) -> BulgeTest:
    """Points and frames for a page that shows so many tests.

    Parameters
    ----------
    test : BulgeTest
    tests : int
    judged_bar : sequence of float, optional
        Pressures of the frames to choose from; default: all frames above zero.
    """
    candidates = np.flatnonzero(test.pressure > 0.0)
    if judged_bar is not None:
        known = np.asarray(judged_bar)
        near = np.abs(10.0 * test.pressure[:, None] - known).min(axis=1)
        candidates = np.flatnonzero(near < 1e-9)
    seen = {int(f) for b in test.blocks for f, row in zip(b.frames, b.measured, strict=True)
            if row.any()}  # fmt: skip
    candidates = np.array([f for f in candidates if f in seen], dtype=np.intp)
    frames = _figure.spread(candidates, test.pressure, MOST_FRAMES)
    most = min(MOST_POINTS, MOST_VALUES // (_FIELDS * MOST_FRAMES * max(tests, 1)))
    masks = [_spread_points(block, test.radius, most) for block in test.blocks]
    return test.select(frames=frames, points=masks if len(masks) > 1 else masks[0])


def _spread_points(block: Block, radius: float, most: int) -> NDArray[np.bool_]:
    """The point nearest each centre of a square grid."""
    plane = np.asarray(block.reference[:, :2], dtype=float)
    kept = np.ones(len(plane), dtype=bool)
    if len(plane) <= most:
        return kept
    side = np.sqrt(np.pi * radius**2 / most)
    cell = np.round(plane / side).astype(int)
    order = np.argsort(np.linalg.norm(plane - cell * side, axis=1), kind="stable")
    _, first = np.unique(cell[order], axis=0, return_index=True)
    kept[:] = False
    kept[order[first][:most]] = True
    return kept


def packed(
    test: BulgeTest, models: Mapping[str, Callable[[BulgeTest], Sequence[Floats]]]
) -> dict[str, Any]:
    """A (thinned) test and what models leave of it, as JSON types.

    Parameters
    ----------
    test : BulgeTest
    models : mapping of label to callable
        Each gives the modelled displacements of every block.
    """
    modelled = {label: of(test) for label, of in models.items()}
    order = np.argsort(test.pressure, kind="stable")
    at = {
        int(frame): (b, row)
        for b, block in enumerate(test.blocks)
        for row, frame in enumerate(block.frames)
    }
    return {
        "name": test.name,
        "rim": test.semi_axes.tolist(),
        "models": list(modelled),
        "frames": [
            {"bar": 10.0 * float(test.pressure[f]), "block": at[int(f)][0], "row": at[int(f)][1]}
            for f in order
            if int(f) in at
        ],
        "blocks": [
            _block(block, [modelled[label][b] for label in modelled])
            for b, block in enumerate(test.blocks)
        ],
    }


def _block(block: Block, modelled: Sequence[Floats]) -> dict[str, Any]:
    reference = np.asarray(block.reference, dtype=float)
    return {
        "count": len(reference),
        "spacing": min(_figure.point_spacing(reference), 1e6),
        "reference": _numbers(reference),
        "triangles": _encoded(_triangles(reference).astype("<u2")),
        "measured": _numbers(block.displacement),
        "residuals": [_numbers(block.displacement - m) for m in modelled],
    }


def _triangles(reference: Floats) -> NDArray[np.intp]:
    """Triangles (k, 3) between the points in the plane, none of them across a hole."""
    from scipy.spatial import Delaunay, QhullError

    plane = reference[:, :2]
    if len(plane) < 3:
        return np.empty((0, 3), dtype=np.intp)
    try:
        found = Delaunay(plane).simplices
    except QhullError:  # points in a line
        return np.empty((0, 3), dtype=np.intp)
    corners = plane[found]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return np.asarray(found[edges.max(axis=1) < _HOLE * _figure.point_spacing(reference)])


def _numbers(values: Floats) -> dict[str, Any]:
    """Integers of two bytes, and what one step is worth."""
    known = np.isfinite(values)
    largest = float(np.abs(values[known]).max()) if known.any() else 0.0
    step = largest / 32767 or 1.0
    steps = np.where(known, np.round(np.where(known, values, 0.0) / step), _LOST)
    return {"step": step, "data": _encoded(steps.astype("<i2"))}


def _encoded(array: NDArray[Any]) -> str:
    return b64encode(np.ascontiguousarray(array).tobytes()).decode()
