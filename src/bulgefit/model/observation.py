"""Evaluate nodal fields at measured points: linear operators, built once per point set.

| method | operator | cost per point | exact at nodes |
|---|---|---|---|
| `smooth` | polyharmonic splines (`bulgefit.model.smooth`); the default | 36 nodes | yes |
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

from bulgefit.errors import InputError, one_of
from bulgefit.fem.geometry import shape_functions
from bulgefit.fem.mesh import Mesh
from bulgefit.model.smooth import SmoothField, smooth_field, smooth_value

__all__ = ["METHODS", "Operators", "applied", "operators"]

Floats = NDArray[np.float64]

#: Nodes of a local radial basis function stencil.
NEIGHBOURS = 16
_CANDIDATES = 12  # cells whose centres are nearest to a point


@dataclass(frozen=True, eq=False)
class Operators:
    """Nodal fields to measured points.

    Attributes
    ----------
    value : (points, nodes) csr_array or array, 1
    gradients : pair of csr_array or None, 1/mm
        By x and by y; None where they were not asked for.
    """

    value: sparse.csr_array | Floats
    gradients: tuple[sparse.csr_array, sparse.csr_array] | None

    @classmethod
    def of(cls, field: SmoothField) -> Operators:
        """From value and gradient operators."""
        return cls(field.value, (field.by_x, field.by_y))

    def __call__(self, nodal: NDArray[np.floating]) -> Floats:
        """Field (frames, n, 3) at the nodes to (frames, points, 3)."""
        return applied(self.value, nodal)

    def transposed(self, pull: NDArray[np.floating]) -> tuple[NDArray[np.intp], Floats]:
        """Values (frames, points, 3) back to the nodes that take part: which, (frames, k, 3)."""
        if isinstance(self.value, np.ndarray):
            return np.arange(self.value.shape[1]), applied(self.value.T, pull)
        seen = np.zeros(self.value.shape[1], dtype=bool)
        seen[self.value.indices] = True
        nodes, shape = np.flatnonzero(seen), (self.value.shape[0], int(seen.sum()))
        column = (np.cumsum(seen, dtype=np.int32) - 1)[self.value.indices]
        own = sparse.csr_array((self.value.data, column, self.value.indptr), shape=shape)
        return nodes, applied(own.T, pull)

    def slopes(self, nodal: NDArray[np.floating]) -> tuple[Floats, Floats]:
        """Derivatives by x and by y of a nodal field, each (frames, points, 3)."""
        assert self.gradients is not None
        by_x, by_y = self.gradients
        return applied(by_x, nodal), applied(by_y, nodal)

    def of_points(self, points: slice | NDArray[np.intp]) -> Operators:
        """At some of the points."""
        if isinstance(points, slice) and points == slice(None):
            return self
        some = self.gradients
        return Operators(
            self.value[points], None if some is None else (some[0][points], some[1][points])
        )


def applied(operator: sparse.sparray | Floats, nodal: NDArray[np.floating]) -> Floats:
    """An operator (m, n) on a field (frames, n, components): (frames, m, components)."""
    frames, n, components = nodal.shape
    flat = np.ascontiguousarray(np.moveaxis(nodal, 1, 0)).reshape(n, frames * components)
    return np.moveaxis((operator @ flat).reshape(-1, frames, components), 0, 1)


def operators(
    mesh: Mesh, points: NDArray[np.floating], method: str = "smooth", *, gradients: bool = False
) -> Operators:
    """Operators from nodal fields of `mesh` to `points` (m, 2 or 3) mm.

    Raises
    ------
    InputError
        Unknown method, or gradients of one that has none.
    """
    places = np.asarray(points, dtype=np.float64)[:, :2]
    if method == "smooth":
        if gradients:
            return Operators.of(smooth_field(mesh.nodes, places))
        return Operators(smooth_value(mesh.nodes, places), None)
    one_of(method, METHODS, "evaluation")
    if gradients:
        raise InputError(f"evaluation {method} has no gradients: points may not move over it")
    made = METHODS[method]
    assert made is not None
    return Operators(made(mesh, places), None)


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
METHODS = {"smooth": None, "shape": _shape, "rbf": _rbf, "local-rbf": _local_rbf}
