"""How do raw arrays become the blocks of a bulge test? Shapes are checked, points merged."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.errors import InputError

__all__ = ["common_points", "distinct_points", "own_points", "per_frame"]

Floats = NDArray[np.floating]

# Two positions are one point where they agree to this, mm.
_SAME_POINT = 1e-9
# Frames share a block while the distinct points are at most this many times the largest frame's.
_MERGE_LIMIT = 1.5
# Farther than this from the origin, mm, is no position in a bulge test.
_FARTHEST = 1e6


def per_frame(values: ArrayLike, key: str, where: str) -> Floats:
    """One number a frame, (frames,) float64, copied."""
    array = _numeric(values, key, where).astype(np.float64)
    if array.ndim == 0:
        array = array.reshape(1)
    if array.ndim != 1:
        raise InputError(f"{where}: {key} has shape {array.shape}; it needs one number a frame")
    return array


def common_points(
    reference: ArrayLike,
    displacement: ArrayLike,
    static_displacement: ArrayLike | None,
    where: str,
) -> tuple[Floats, Floats, Floats | None]:
    """Reference (n, 3), displacement (frames, n, 3) and static (m, n, 3) in mm, copied."""
    points = _numeric(reference, "reference", where).astype(np.float64, order="C")
    moved = _kept_precision(displacement, "displacement", where)
    _need_shape(points, "reference", "(points, 3)", where)
    _need_positions(points, where)
    _need_shape(moved, "displacement", "(frames, points, 3)", where)
    _need_as_many(moved, points, "displacement", where)
    if static_displacement is None:
        return points, moved, None
    static = _kept_precision(static_displacement, "static_displacement", where)
    _need_shape(static, "static_displacement", "(images, points, 3)", where)
    _need_as_many(static, points, "static_displacement", where)
    return points, moved, static


def own_points(
    frames: Sequence[tuple[ArrayLike, ArrayLike]], where: str
) -> list[tuple[Floats, NDArray[np.intp], Floats]]:
    """The (reference, frames, displacement) of each block of frames with points of their own."""
    kept = [_measured_points(*frame, f"{where}: frame {i}") for i, frame in enumerate(frames)]
    if not kept:
        return []
    group, count = distinct_points([points for points, _ in kept])
    largest = max(len(points) for points, _ in kept)
    starts = np.cumsum([0] + [len(points) for points, _ in kept])
    members = [group[a:b] for a, b in pairwise(starts)]
    # a frame that holds one point twice would lose one of the two displacements
    repeated = any(len(np.unique(member)) < len(member) for member in members)
    if repeated or count > _MERGE_LIMIT * largest:
        return [
            (points, np.array([i]), moved[None])
            for i, (points, moved) in enumerate(kept)
            if len(points)
        ]
    reference = np.empty((count, 3))
    single = all(moved.dtype == np.float32 for _, moved in kept)
    kind = np.float32 if single else np.float64
    displacement = np.full((len(kept), count, 3), np.nan, dtype=kind)
    for i, (points, moved) in enumerate(kept):
        reference[members[i]] = points
        displacement[i, members[i]] = moved
    return [(reference, np.arange(len(kept)), displacement)]


def distinct_points(references: Sequence[Floats]) -> tuple[NDArray[np.intp], int]:
    """Which of all positions are the same point.

    Parameters
    ----------
    references : sequence of (n_i, 3) arrays, mm

    Returns
    -------
    group : (sum of n_i,) int array
        Number of the distinct point, in the order of first appearance.
    count : int
        Number of distinct points.
    """
    stacked = np.concatenate([np.empty((0, 3)), *references])
    keys = np.rint(stacked / _SAME_POINT).astype(np.int64)
    order = np.lexsort(keys.T)
    ordered = keys[order]
    new = np.ones(len(keys), dtype=bool)
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    # lexsort is stable: the first of each run appeared first
    rank = np.argsort(np.argsort(order[new]))
    group = np.empty(len(keys), dtype=np.intp)
    group[order] = rank[np.cumsum(new) - 1]
    return group, len(rank)


def _measured_points(
    reference: ArrayLike, displacement: ArrayLike, where: str
) -> tuple[Floats, Floats]:
    points = _numeric(reference, "reference", where).astype(np.float64, order="C")
    moved = _kept_precision(displacement, "displacement", where)
    _need_shape(points, "reference", "(points, 3)", where)
    _need_shape(moved, "displacement", "(points, 3)", where)
    _need_as_many(moved, points, "displacement", where)
    kept = np.isfinite(points).all(axis=1) & ~np.isnan(moved).all(axis=1)
    points = points[kept]
    _need_positions(points, where)
    return points, moved[kept]


def _numeric(values: ArrayLike, key: str, where: str) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError(f"{where}: {key} is not a rectangular array of numbers") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{where}: {key} holds {array.dtype}, not real numbers")
    return array


def _kept_precision(values: ArrayLike, key: str, where: str) -> Floats:
    array = _numeric(values, key, where)
    kind = np.float32 if array.dtype == np.float32 else np.float64
    return array.astype(kind, order="C")


def _need_shape(array: Floats, key: str, shape: str, where: str) -> None:
    if array.ndim != shape.count(",") + 1 or array.shape[-1] != 3:
        raise InputError(f"{where}: {key} has shape {array.shape}; it must be {shape}")


def _need_as_many(array: Floats, points: Floats, key: str, where: str) -> None:
    if array.shape[-2] != len(points):
        raise InputError(
            f"{where}: {key} has {array.shape[-2]} points and reference {len(points)}; "
            "they must agree"
        )


def _need_positions(points: Floats, where: str) -> None:
    bad = np.flatnonzero(~(np.abs(points) < _FARTHEST).all(axis=1))
    if len(bad):
        raise InputError(
            f"{where}: reference of {len(bad)} points is no position in mm, first at point "
            f"{bad[0]} {points[bad[0]].tolist()}; leave these points out"
        )
