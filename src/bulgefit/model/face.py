"""How does the face that the cameras see move, which lies off the middle of the cloth?

The model's membrane has no thickness; its nodes are those of the middle that bears the load. A
point of the face stands off it by h along the normal (Kirchhoff's hypothesis), so it moves by

    w = u + h (n - N)

with the normal n of the moved middle and N of the middle at rest. It is seen, before inflation, h N
beside the place of the middle that it stands on; what is seen at a place is that of the middle h N
back from there, w - h N·∇w to first order.
"""

from __future__ import annotations

from collections.abc import Callable
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
    gradients : (2 n, n) csr_array
        Derivatives of a nodal field at the nodes, by the first of the mesh's coordinates and then
        by the second.
    rest : (n, 3) array, mm
        The nodes before inflation.
    above : float, mm
        By how much the face lies above the middle, along its normal.
    """

    gradients: sparse.csr_array
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

    def slope(self, moved: Floats) -> Callable[[Floats], Floats]:
        """What takes changes (frames, n, 3) of the middle's displacement to those of what is seen.

        As the tangents a₁ and a₂ change, the unit normal does by -(n·δa₁) a¹ - (n·δa₂) a², with the
        vectors a¹ and a² that are reciprocal to them.

        Parameters
        ----------
        moved : (frames, n, 3) array, mm
            The displacement that changes.
        """
        (a, b), normal, area = self._turned(self.rest + moved)
        across_1 = self.above * np.cross(b, normal) / area
        across_2 = self.above * np.cross(normal, a) / area
        _, back = self._at_rest

        def of(change: Floats) -> Floats:
            by_1, by_2 = self._derivatives(change)
            tilt_1 = np.einsum("fnc,fnc->fn", normal, by_1)[..., None]
            tilt_2 = np.einsum("fnc,fnc->fn", normal, by_2)[..., None]
            return self._from(change - tilt_1 * across_1 - tilt_2 * across_2, back)

        return of

    def _derivatives(self, field: Floats) -> tuple[Floats, Floats]:
        """Of a field (frames, n, 3) by each of the mesh's coordinates."""
        both = applied(self.gradients, field)
        return both[:, : len(self.rest)], both[:, len(self.rest) :]

    def _turned(self, place: Floats) -> tuple[tuple[Floats, Floats], Floats, Floats]:
        """Tangents, unit normal and area (frames, n, 3 or 1) of places (frames, n, 3)."""
        a, b = self._derivatives(place)
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
        by_1, by_2 = self._derivatives(field)
        return np.asarray(field - back[:, :1] * by_1 - back[:, 1:] * by_2)
