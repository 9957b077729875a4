"""How does the face that the cameras see move, which lies off the middle of the cloth?

The model's membrane has no thickness; its nodes are those of the middle that bears the load. A
point of the face stands off it by h along the normal (Kirchhoff's hypothesis), so it moves by

    w = u + h (n - N)

with the normal n of the moved middle and N of the middle at rest. It is seen, before inflation, h N
beside the place of the middle that it stands on; what is seen at a place is that of the middle h N
back from there, to first order in h

    w = u + h (n - N - N·∇u)
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
        return moved + self.above * self.lean(moved)

    def lean(self, moved: Floats) -> Floats:
        """What is seen beyond the middle's displacement, per mm that the face lies above it."""
        now, rest = self._tangents(self.rest + moved), self._at_rest
        return now.normal - rest.normal - self._beside.along(now.a - rest.a, now.b - rest.b)

    def slope(self, moved: Floats) -> Callable[..., Floats]:
        """What takes changes of the middle to those of what is seen.

        Of the middle's displacement (frames, n, 3), and of its places at rest (n, 3), if they
        change too.

        Parameters
        ----------
        moved : (frames, n, 3) array, mm
            The displacement that changes.
        """
        now, rest, beside = self._tangents(self.rest + moved), self._at_rest, self._beside

        def of(change: Floats, of_rest: Floats | None = None) -> Floats:
            a, b = self._derivatives(change)
            lean = -beside.along(a, b)
            if of_rest is not None:
                rest_a, rest_b = self._derivatives(of_rest[None])
                further = self._beside_changes(rest_a, rest_b)
                back = further.along(now.a - rest.a, now.b - rest.b)
                lean = lean - rest.turn(rest_a, rest_b) - back
                a, b = a + rest_a, b + rest_b
            return change + self.above * (lean + now.turn(a, b))

        return of

    def _derivatives(self, field: Floats) -> tuple[Floats, Floats]:
        """Of a field (frames, n, 3) by each of the mesh's coordinates."""
        both = applied(self.gradients, field)
        return both[:, : len(self.rest)], both[:, len(self.rest) :]

    def _tangents(self, place: Floats) -> _Tangents:
        """Of places (frames, n, 3)."""
        return _Tangents(*self._derivatives(place))

    @cached_property
    def _at_rest(self) -> _Tangents:
        return self._tangents(self.rest[None])

    @cached_property
    def _beside(self) -> _Beside:
        """How far the face stands beside its place at rest, per mm above it."""
        return _Beside(self._in_plane(self._at_rest.normal))

    def _beside_changes(self, a: Floats, b: Floats) -> _Beside:
        """The same of changes (1, n, 3) of the tangents at rest."""
        moved = self._beside.along(a, b)
        return _Beside(self._in_plane(self._at_rest.turn(a, b) - moved))

    def _in_plane(self, step: Floats) -> Floats:
        """A step (1, n, 3) mm at rest, in the mesh's coordinates (n, 2)."""
        tangents = self._at_rest
        jacobian = np.stack([tangents.a[0, :, :2], tangents.b[0, :, :2]], axis=-1)
        return np.asarray(np.linalg.solve(jacobian, step[0, :, :2, None])[..., 0])


class _Tangents:
    """Tangents a and b (frames, n, 3) of a surface, and its unit normal."""

    def __init__(self, a: Floats, b: Floats) -> None:
        self.a, self.b = a, b
        across = np.cross(a, b)
        self.area = np.linalg.norm(across, axis=-1, keepdims=True)
        self.normal = across / self.area

    def turn(self, a: Floats, b: Floats) -> Floats:
        """Change of the unit normal as the tangents change.

        It is -(n·δa) a¹ - (n·δb) a², with the vectors a¹ and a² that are reciprocal to them.
        """
        tilt_a, tilt_b = (np.einsum("fnc,fnc->fn", self.normal, x)[..., None] for x in (a, b))
        reciprocal_a, reciprocal_b = self._reciprocal
        return -tilt_a * reciprocal_a - tilt_b * reciprocal_b

    @cached_property
    def _reciprocal(self) -> tuple[Floats, Floats]:
        return np.cross(self.b, self.normal) / self.area, np.cross(self.normal, self.a) / self.area


@dataclass(frozen=True, eq=False)
class _Beside:
    """A step (n, 2) from each node, in the mesh's coordinates."""

    step: Floats

    def along(self, by_1: Floats, by_2: Floats) -> Floats:
        """Change of a field over the step, by its derivatives (frames, n, 3)."""
        if not self.step.any():
            return np.zeros((1, 1, 3))
        return self.step[:, :1] * by_1 + self.step[:, 1:] * by_2
