"""A clamp that slips: radial springs at the rim, in series with the fabric.

A rim that moves inwards by `compliance` times the radial edge traction (N per mm of rim) is a
rim on radial springs of 1/compliance per mm of rim: energy ½ ∫ q²/compliance ds for the radial
displacement q. Along the rim the clamp holds, by springs so stiff that nothing moves.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.mesh import Mesh

if TYPE_CHECKING:
    from bulgefit.fem.linear import LinearSolver

__all__ = ["LEAST_COMPLIANCE", "Clamp"]

Floats = NDArray[np.float64]

#: A clamp that does not slip, for the springs: mm per N/mm. The rim moves by 1e-5 mm.
LEAST_COMPLIANCE = 1e-6


class Clamp:
    """Rim springs of one membrane.

    Parameters
    ----------
    mesh : Mesh
    positions : (n, 3) array, mm
        Stress-free positions of the nodes.
    linear : LinearSolver
        Of a membrane whose rim is free in its plane.
    compliance : float, mm per N/mm

    Attributes
    ----------
    ends : (rim, 2) array, mm
        Displacement of the springs' outer ends.
    """

    def __init__(
        self, mesh: Mesh, positions: Floats, linear: LinearSolver, compliance: float
    ) -> None:
        self.rim = mesh.rim
        centred = positions[self.rim, :2]
        self.radial = centred / np.linalg.norm(centred, axis=1, keepdims=True)
        self.length = _rim_lengths(mesh, positions)
        self.compliance = compliance
        self.stiffness = self._springs(compliance)
        self.ends = np.zeros_like(centred)
        self._place = _places(mesh, linear, self.rim)

    def _springs(self, compliance: float) -> Floats:
        """Stiffness (rim, 2, 2) N/mm of the rim's springs."""
        soft = self.length / max(compliance, LEAST_COMPLIANCE)
        hard = self.length / LEAST_COMPLIANCE
        along = np.stack([-self.radial[:, 1], self.radial[:, 0]], axis=1)
        return np.asarray(
            soft[:, None, None] * self.radial[:, :, None] * self.radial[:, None, :]
            + hard[:, None, None] * along[:, :, None] * along[:, None, :]
        )

    def pulled_at(self, ends: Floats) -> Clamp:
        """The same springs with their outer ends displaced by (rim, 2) mm."""
        out = copy(self)
        out.ends = ends
        return out

    def at(self, compliance: float) -> Clamp:
        """The same springs with another compliance, mm per N/mm."""
        out = copy(self)
        out.compliance = compliance
        out.stiffness = out._springs(compliance)
        return out

    @property
    def by_compliance(self) -> Floats:
        """∂(stiffness)/∂(compliance), (rim, 2, 2) N²/mm³: of -length/compliance² radially.

        Nothing where the clamp is as hard as it gets.
        """
        gives = self.compliance >= LEAST_COMPLIANCE
        soft = -self.length / self.compliance**2 if gives else np.zeros_like(self.length)
        return np.asarray(soft[:, None, None] * self.radial[:, :, None] * self.radial[:, None, :])

    def stretch(self, displacement: Floats) -> Floats:
        """Of the springs (rim, 2) mm at a displacement (n, 3) mm."""
        return np.asarray(displacement[self.rim, :2] - self.ends)

    def changes(self, fields: Floats) -> Floats:
        """Changes of the springs' forces (..., rim, 2) along fields (..., n, 3)."""
        return np.einsum("nij,...nj->...ni", self.stiffness, fields[..., self.rim, :2])

    def add(self, displacement: Floats, residual: Floats, data: Floats | None) -> float:
        """Add the springs' forces to `residual` and stiffness to `data`; return their energy."""
        stretch = self.stretch(displacement)
        force = np.einsum("nij,nj->ni", self.stiffness, stretch)
        residual[self.rim, :2] += force
        if data is not None:
            data[self._place] += self.stiffness[:, (0, 1, 1), (0, 0, 1)]
        return 0.5 * float((force * stretch).sum())


def _rim_lengths(mesh: Mesh, positions: Floats) -> Floats:
    """Half of each rim node's two edges, mm."""
    outer = mesh.rim_edges
    length = np.linalg.norm(positions[outer[:, 0]] - positions[outer[:, 1]], axis=1)
    total = np.zeros(len(positions))
    np.add.at(total, outer.ravel(), np.repeat(0.5 * length, 2))
    return total[mesh.rim]


def _places(mesh: Mesh, linear: LinearSolver, rim: NDArray[np.int64]) -> NDArray[np.int64]:
    """Where the entries xx, yx, yy of each rim node's block stand in the solver's data."""
    corners = mesh.cells.ravel()
    last = np.empty(len(mesh.nodes), dtype=np.int64)
    last[corners] = np.arange(len(corners))
    cell, corner = np.divmod(last[rim], mesh.cells.shape[1])
    row = 3 * corner
    diagonal = row * (row + 1) // 2 + row
    below = (row + 1) * (row + 2) // 2 + row
    return linear.scatter[cell[:, None], np.stack([diagonal, below, below + 1], axis=1)]
