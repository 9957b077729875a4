"""Evaluate nodal fields, and their gradients, between the nodes more finely than the cells do.

Bilinear cells lie h²/8 w'' off a curved surface between their nodes: 0.04 mm on the default mesh,
several times the noise of good DIC, while the nodes themselves are ten times closer. Here the
field is interpolated through the nodes round the nearest one by φ(r) = r⁵ and cubic polynomials
(polyharmonic splines; Iske, 2004, "Multiresolution Methods in Scattered Data Modelling", ch. 3).
Their systems depend on the mesh alone, so points that move cost no solve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

__all__ = ["SmoothField", "smooth_field", "smooth_value"]

Floats = NDArray[np.float64]

NEIGHBOURS = 36
_TERMS = 10  # of a cubic in x and y
_CHUNK = 500  # points at a time: their systems are 17 kB each
_SYSTEMS = 32  # inverted at a time: with what they are made of they stay in the cache


@dataclass(frozen=True, eq=False)
class SmoothField:
    """Value and gradient operators, each sparse (points, nodes).

    Attributes
    ----------
    value : csr_array, 1
    by_x, by_y : csr_array, 1/mm
    """

    value: sparse.csr_array
    by_x: sparse.csr_array
    by_y: sparse.csr_array


@dataclass(frozen=True, eq=False)
class _Stencils:
    """For each node those round it, and what takes functions at a point to their weights there.

    Attributes
    ----------
    tree : KDTree
        Of the nodes.
    near : (n, k) int array
    place : (n, k, 2) array
        Of the nodes round it, the node as origin, in units of `scale`.
    scale : (n,) array, mm
    inverse : (n, k + _TERMS, k) array
        Of the spline's symmetric system, its first columns; made where it is first asked for.
    made : (n,) bool array
    """

    tree: KDTree
    near: NDArray[np.intp]
    place: Floats
    scale: Floats
    inverse: Floats
    made: NDArray[np.bool_]

    def inverse_of(self, own: NDArray[np.intp]) -> Floats:
        """`inverse` of nodes (m,)."""
        missing = np.unique(own[~self.made[own]])
        for first in range(0, len(missing), _SYSTEMS):
            some = missing[first : first + _SYSTEMS]
            self.inverse[some] = _inverse(self.place[some])
        self.made[missing] = True
        return self.inverse[own]


def smooth_field(nodes: Floats, points: Floats) -> SmoothField:
    """Operators from fields at `nodes` (n, 2) mm to `points` (m, 2) mm."""
    return SmoothField(*_operators(nodes, points, 3))


def smooth_value(nodes: Floats, points: Floats) -> sparse.csr_array:
    """The operator of the value alone: a third of the memory, for many points."""
    (value,) = _operators(nodes, points, 1)
    return value


def _operators(nodes: Floats, points: Floats, count: int) -> list[sparse.csr_array]:
    """Of value, x and y derivative, the first so many."""
    known = _stencils(nodes.tobytes())
    _, own = known.tree.query(points)
    size = known.near.shape[1]
    weights = np.empty((count, len(points), size))
    for first in range(0, len(points), _CHUNK):
        part = slice(first, first + _CHUNK)
        here = _weights(known, own[part], points[part] - nodes[own[part]], count)
        weights[:, part] = here
    rows = np.arange(0, len(points) * size + 1, size, dtype=np.int32)
    columns = known.near[own].ravel().astype(np.int32)
    shape = (len(points), len(nodes))
    return [sparse.csr_array((w.ravel(), columns, rows), shape=shape) for w in weights]


@lru_cache(maxsize=4)
def _stencils(nodes_bytes: bytes) -> _Stencils:
    """Of a mesh's nodes (n, 2), given as bytes."""
    nodes = np.frombuffer(nodes_bytes).reshape(-1, 2)
    tree, k = KDTree(nodes), min(NEIGHBOURS, len(nodes))
    distance, near = tree.query(nodes, k=k)
    scale = distance.max(axis=1)
    place = (nodes[near] - nodes[:, None]) / scale[:, None, None]
    inverse = np.empty((len(nodes), k + _TERMS, k))
    return _Stencils(tree, near, place, scale, inverse, np.zeros(len(nodes), dtype=bool))


def _inverse(place: Floats) -> Floats:
    """First columns of the inverses of the systems of nodes that lie so (m, k, 2) to each other."""
    k = place.shape[1]
    x, y = np.moveaxis(place[:, :, None] - place[:, None], -1, 0)
    square = x * x + y * y
    system = np.zeros((len(place), k + _TERMS, k + _TERMS))
    system[:, :k, :k] = square * square * np.sqrt(square)
    system[:, :k, k:] = _cubics(place)[0]
    system[:, k:, :k] = np.swapaxes(system[:, :k, k:], 1, 2)
    return np.asarray(np.linalg.inv(system)[:, :, :k])


def _weights(known: _Stencils, own: NDArray[np.intp], offset: Floats, count: int) -> Floats:
    """Weights (count, m, k) of value, x and y derivative at so far (m, 2) mm from nodes `own`."""
    scale = known.scale[own]
    here = offset / scale[:, None]
    x, y = np.moveaxis(here[:, None] - known.place[own], -1, 0)
    square = x * x + y * y
    cube = square * np.sqrt(square)
    k = known.near.shape[1]
    functions = np.empty((len(own), count, k + _TERMS))
    for row, factor in enumerate((square, 5.0 * x, 5.0 * y)[:count]):
        functions[:, row, :k] = cube * factor
    functions[:, :, k:] = np.moveaxis(_cubics(here)[:count], 0, 1)
    inverse = known.inverse_of(own)
    # one product each: a value has the same bits with derivatives beside it and without
    found = np.concatenate([functions[:, :1] @ inverse, functions[:, 1:] @ inverse], axis=1)
    found[:, 1:] /= scale[:, None, None]
    return np.moveaxis(found, 1, 0)


def _cubics(place: Floats) -> Floats:
    """Terms of a cubic at places (..., 2), their x and y derivatives, (3, ..., 10)."""
    x, y = place[..., 0], place[..., 1]
    o, i = np.zeros_like(x), np.ones_like(x)
    terms = i, x, y, x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3
    by_x = o, i, o, 2 * x, y, o, 3 * x * x, 2 * x * y, y * y, o
    by_y = o, o, i, o, x, 2 * y, o, x * x, 2 * x * y, 3 * y * y
    return np.stack([np.stack(rows, axis=-1) for rows in (terms, by_x, by_y)])
