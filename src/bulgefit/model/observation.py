"""Evaluate nodal fields at measured points: linear operators, built once per point set.

| method | operator | cost per point | exact at nodes |
|---|---|---|---|
| `shape` | the cells' own bilinear shape functions | 4 nodes | yes |
| `rbf` | the study's radial basis functions, linear kernel, all nodes | all nodes | yes |
| `local-rbf` | the same kernel on the nearest nodes found by a KD-tree | 16 nodes | yes |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from bulgefit.errors import InputError
from bulgefit.fem.geometry import shape_functions
from bulgefit.fem.mesh import Mesh

__all__ = ["METHODS", "Observation", "observe"]

Floats = NDArray[np.float64]

#: Nodes of a local radial basis function stencil.
NEIGHBOURS = 16
_CANDIDATES = 12  # cells whose centres are nearest to a point


@dataclass(frozen=True, eq=False)
class Observation:
    """Nodal fields to measured points: `matrix` is (points, nodes), sparse CSR or dense."""

    matrix: sparse.csr_array | Floats

    def __call__(self, nodal: NDArray[np.floating]) -> Floats:
        """Field (k, n, 3) at the nodes to (k, points, 3)."""
        k, n, c = nodal.shape
        flat = np.ascontiguousarray(np.moveaxis(nodal, 1, 0)).reshape(n, k * c)
        return np.moveaxis((self.matrix @ flat).reshape(-1, k, c), 0, 1)

    def adjoint(self, cotangent: NDArray[np.floating]) -> Floats:
        """Weights (k, points, 3) of the points to weights (k, n, 3) of the nodes."""
        k, m, c = cotangent.shape
        flat = np.ascontiguousarray(np.moveaxis(cotangent, 1, 0)).reshape(m, k * c)
        return np.moveaxis((self.matrix.T @ flat).reshape(-1, k, c), 0, 1)


def observe(mesh: Mesh, points: NDArray[np.floating], method: str = "shape") -> Observation:
    """Operator from nodal fields of `mesh` to `points` (m, 2 or 3) mm.

    Raises
    ------
    InputError
        Unknown method.
    """
    if method not in METHODS:
        raise InputError(f"evaluation: {method!r} is unknown; choose from {', '.join(METHODS)}")
    return Observation(METHODS[method](mesh, np.asarray(points, dtype=np.float64)[:, :2]))


def _shape(mesh: Mesh, points: Floats) -> sparse.csr_array:
    """Bilinear interpolation in the cell that holds the point; by the nearest cell at the rim."""
    corners = mesh.nodes[mesh.cells]
    tree = KDTree(corners.mean(axis=1))
    count = min(_CANDIDATES, len(corners))
    candidates = tree.query(points, k=count)[1].reshape(len(points), count)
    best_cell = candidates[:, 0].copy()
    best_local = np.zeros((len(points), 2))
    best_excess = np.full(len(points), np.inf)
    for column in candidates.T:
        open_ = best_excess > 1e-9
        if not open_.any():
            break
        local = _inverse_bilinear(corners[column[open_]], points[open_])
        excess = np.abs(local).max(axis=1) - 1.0
        better = excess < best_excess[open_]
        index = np.flatnonzero(open_)[better]
        best_excess[index] = excess[better]
        best_cell[index], best_local[index] = column[index], local[better]
    # between the chord of a rim cell and the rim: extrapolate by less than a cell
    weights = shape_functions(np.clip(best_local, -1.5, 1.5))[0]
    rows = np.repeat(np.arange(len(points)), 4)
    return sparse.csr_array(
        (weights.ravel(), (rows, mesh.cells[best_cell].ravel())),
        shape=(len(points), len(mesh.nodes)),
    )


def _inverse_bilinear(corners: Floats, points: Floats) -> Floats:
    """Cell coordinates (m, 2) of points (m, 2) in cells with corners (m, 4, 2), by Newton."""
    local = np.zeros_like(points)
    for _ in range(12):
        value, by_xi, by_eta = shape_functions(local)
        miss = np.einsum("ma,max->mx", value, corners) - points
        jacobian = np.stack([np.einsum("ma,max->mx", d, corners) for d in (by_xi, by_eta)], axis=-1)
        local = np.clip(local - np.linalg.solve(jacobian, miss[..., None])[..., 0], -3, 3)
    return local


def _rbf(mesh: Mesh, points: Floats) -> Floats:
    """Interpolation by φ(r) = r through all nodes, as the study's: Φ(points) Φ(nodes)⁻¹."""
    kernel = cdist(mesh.nodes, mesh.nodes)
    return linalg.solve(kernel, cdist(mesh.nodes, points), assume_a="sym").T


def _local_rbf(mesh: Mesh, points: Floats) -> sparse.csr_array:
    """Interpolation by φ(r) = r and a constant through the nearest nodes of each point."""
    count = min(NEIGHBOURS, len(mesh.nodes))
    near = KDTree(mesh.nodes).query(points, k=count)[1]
    nodes = mesh.nodes[near]
    system = np.zeros((len(points), count + 1, count + 1))
    system[:, :count, :count] = np.linalg.norm(nodes[:, :, None] - nodes[:, None], axis=-1)
    system[:, count, :count] = system[:, :count, count] = 1.0
    right = np.ones((len(points), count + 1))
    right[:, :count] = np.linalg.norm(nodes - points[:, None], axis=-1)
    weights = np.linalg.solve(system, right[..., None])[:, :count, 0]
    rows = np.repeat(np.arange(len(points)), count)
    return sparse.csr_array(
        (weights.ravel(), (rows, near.ravel())), shape=(len(points), len(mesh.nodes))
    )


#: Ways to evaluate a nodal field at points.
METHODS = {"shape": _shape, "rbf": _rbf, "local-rbf": _local_rbf}
