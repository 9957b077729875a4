"""How does the face that the cameras see move, which lies off the middle of the cloth?

The model's membrane has no thickness; its nodes are those of the middle that bears the load. A
point of the face stands off it by h along the normal (Kirchhoff's hypothesis), so it moves by

    w = u + h (n - N)

with the normal n of the moved middle and N of the middle at rest. It is seen, before inflation, h N
beside the place of the middle that it stands on; what is seen at a place is that of the middle h N
back from there, w - h N·∇w to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.model.observation import applied

__all__ = ["Face"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Face:
    """The seen face of one cloth.

    Attributes
    ----------
    gradients : pair of (n, n) csr_array
        Derivatives of a nodal field by the mesh's two coordinates, at the nodes.
    rest : (n, 3) array, mm
        The nodes before inflation.
    above : float, mm
        By how much the face lies above the middle, along its normal.
    """

    gradients: tuple[sparse.csr_array, sparse.csr_array]
    rest: Floats
    above: float

    def seen(self, moved: Floats) -> Floats:
        """Displacement (frames, n, 3) mm of the face, at the places where the nodes were at rest.

        Parameters
        ----------
        moved : (frames, n, 3) array, mm
            Displacement of the middle.
        """
        _, normal, _ = self._turned(self.rest + moved)
        upright, back = self._at_rest
        return self._from(moved + self.above * (normal - upright), back)

    def slope(self, moved: Floats, change: Floats) -> Floats:
        """Change (frames, n, 3) of what is seen from one of the middle's displacement."""
        (a, b), normal, area = self._turned(self.rest + moved)
        by_1, by_2 = (applied(g, change) for g in self.gradients)
        turned = (np.cross(by_1, b) + np.cross(a, by_2)) / area
        turned -= normal * (turned * normal).sum(axis=-1, keepdims=True)
        _, back = self._at_rest
        return self._from(change + self.above * turned, back)

    def _turned(self, place: Floats) -> tuple[tuple[Floats, Floats], Floats, Floats]:
        """Tangents, unit normal and area (frames, n, 3 or 1) of places (frames, n, 3)."""
        a, b = (applied(g, place) for g in self.gradients)
        normal = np.cross(a, b)
        area = np.linalg.norm(normal, axis=-1, keepdims=True)
        return (a, b), normal / area, area

    @cached_property
    def _at_rest(self) -> tuple[Floats, Floats]:
        """Normal (1, n, 3), and how far (n, 2) the face stands beside its place.

        That is in the mesh's coordinates.
        """
        (a, b), normal, _ = self._turned(self.rest[None])
        jacobian = np.stack([a[0, :, :2], b[0, :, :2]], axis=-1)
        beside = np.linalg.solve(jacobian, self.above * normal[0, :, :2, None])[..., 0]
        return normal, np.asarray(beside, dtype=np.float64)

    def _from(self, field: Floats, back: Floats) -> Floats:
        """A field (frames, n, 3) at the places that lie `back` (n, 2) from the nodes."""
        if not back.any():
            return field
        by_1, by_2 = (applied(g, field) for g in self.gradients)
        return np.asarray(field - back[:, :1] * by_1 - back[:, 1:] * by_2)
