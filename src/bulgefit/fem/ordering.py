"""Number the nodes so that the tangent's band is narrow.

The cost of a banded factorisation grows with the square of the bandwidth. Cuthill and McKee's
breadth-first numbering (1969) depends on where it starts; for a disc the narrowest band comes
from a small patch of neighbours at the rim, that of an O-grid from the middle, and which cannot be
told beforehand. Numbering takes microseconds a start, so a hundred are tried and the narrowest is
kept.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from bulgefit.fem.jit import compiled

__all__ = ["narrow_order"]

Integers = NDArray[np.int64]

#: Directions in which starts are sought, and how many nodes farthest that way make one.
_DIRECTIONS = 24
_PATCHES = (1, 3, 6, 10)


@compiled
def _cuthill_mckee(
    indptr: Integers,
    indices: Integers,
    start: Integers,
    order: Integers,
    seen: NDArray[np.bool_],
) -> None:
    """Breadth-first order from the nodes `start`, neighbours by degree, into `order`."""
    n = len(order)
    seen[:] = False
    filled = 0
    for node in start:
        order[filled] = node
        seen[node] = True
        filled += 1
    done, fresh = 0, 0
    while filled < n:
        if done == filled:  # a further piece of the mesh
            while seen[fresh]:
                fresh += 1
            order[filled] = fresh
            seen[fresh] = True
            filled += 1
        node = order[done]
        done += 1
        first = filled
        for k in range(indptr[node], indptr[node + 1]):
            other = indices[k]
            if seen[other]:
                continue
            seen[other] = True
            degree = indptr[other + 1] - indptr[other]
            place = filled
            while place > first:
                before = order[place - 1]
                if indptr[before + 1] - indptr[before] <= degree:
                    break
                order[place] = before
                place -= 1
            order[place] = other
            filled += 1


@compiled
def _half_bandwidth(indptr: Integers, indices: Integers, order: Integers, place: Integers) -> int:
    """Largest distance in `order` between neighbours."""
    for k in range(len(order)):
        place[order[k]] = k
    widest = 0
    for node in range(len(order)):
        for k in range(indptr[node], indptr[node + 1]):
            widest = max(widest, abs(place[node] - place[indices[k]]))
    return widest


def narrow_order(
    positions: NDArray[np.float64], cells: Integers, kept: NDArray[np.bool_]
) -> Integers:
    """Nodes of `kept` (n,) in the order of the narrowest band that was found.

    Parameters
    ----------
    positions : (n, 2) array, mm
    cells : (m, 4) int array
    kept : (n,) bool array
        Nodes with an unknown displacement.
    """
    nodes = np.flatnonzero(kept)
    short = np.full(len(kept), -1)
    short[nodes] = np.arange(len(nodes))
    rows = short[np.repeat(cells, 4, axis=1).ravel()]
    columns = short[np.tile(cells, (1, 4)).ravel()]
    pair = (rows >= 0) & (columns >= 0) & (rows != columns)
    graph = coo_matrix(
        (np.ones(int(pair.sum()), dtype=np.int8), (rows[pair], columns[pair])),
        shape=(len(nodes), len(nodes)),
    ).tocsr()
    indptr, indices = graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
    order, place = np.empty((2, len(nodes)), dtype=np.int64)
    seen = np.empty(len(nodes), dtype=np.bool_)
    best, narrowest = np.arange(len(nodes)), len(nodes)
    for start in _starts(positions[nodes]):
        _cuthill_mckee(indptr, indices, start, order, seen)
        width = int(_half_bandwidth(indptr, indices, order, place))
        if width < narrowest:
            best, narrowest = order.copy(), width
    return nodes[best]


def _starts(positions: NDArray[np.float64]) -> Iterator[Integers]:
    """The middle node, then patches at the rim all round."""
    yield np.array([np.argmin((positions**2).sum(axis=1))])
    for turn in np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS):
        along = positions @ np.array([np.cos(turn), np.sin(turn)])
        # rounded, so that symmetric meshes are numbered alike on every machine
        far = np.argsort(np.round(along, 6), kind="stable")
        for patch in _PATCHES:
            yield far[:patch]
