"""The clamp's opening: what the unit disc becomes, where a point is on that, where the rim is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bulgefit.errors import InputError
from bulgefit.model.description import Active

__all__ = ["Opening"]

Floats = NDArray[np.float64]

#: Fixed-point corrections that undo the outline: each leaves its size times the last.
_CORRECTIONS, _SETTLED = 60, 1e-14
#: Of the radius: what may be left where they shrink slowly.
_TOLD = 1e-9
#: Places at which the rim is looked at: less than a millimetre apart on a usual one.
_LOOK = 720
#: Least curvature of a rim over that of a circle of its size: beyond, it is straight.
_STRAIGHT = 1e-3


@dataclass(eq=False)
class Opening:
    """The unit disc, bent by the outlines of effects and stretched to the clamp's size.

    Parameters
    ----------
    semi_axes : (2,) array, mm
        Of the clamp as it was stated, along x and y.
    active : list of (Effect, values)
        Effects without an outline change nothing.
    """

    semi_axes: Floats
    active: Active = field(default_factory=list)
    _circles: tuple[KDTree, Floats, Floats] | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        self.semi_axes = np.broadcast_to(np.asarray(self.semi_axes, dtype=np.float64), 2)
        self.active = [(effect, own) for effect, own in self.active if effect.uses("outline")]

    def fabric(self, unit: Floats) -> Floats:
        """Places (n, 2) mm from the clamp's centre of points (n, 2) of the unit disc."""
        return np.asarray(self._bent(unit) * self.semi_axes)

    def unit(self, fabric: Floats) -> Floats:
        """Points (n, 2) of the unit disc that stand at places (n, 2) mm.

        Raises
        ------
        InputError
            The rim is bent so far that this does not tell them to a ten-millionth of a millimetre.
        """
        target = unit = fabric / self.semi_axes
        left = 0.0
        for _ in range(_CORRECTIONS if self.active else 0):
            miss = target - self._bent(unit)
            unit = unit + miss
            left = float(np.abs(miss).max(initial=0.0))
            if left < _SETTLED or not left < 1.0:
                break
        if not left < _TOLD:
            bent = ", ".join(effect.id for effect, _ in self.active)
            raise InputError(f"the rim is bent too far by {bent}: places on it are not told apart")
        return np.asarray(unit)

    def _bent(self, unit: Floats) -> Floats:
        for effect, own in self.active:
            unit = effect.outline(own, unit)
        return unit

    def rim_circles(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """The rim beside each place (n, 2) mm as a circle: distance of its centre, radius, way out.

        (n,), (n,), (n, 2). Through the nearest of many points of the rim and its neighbours: the
        rim leaves it by the cube of the distance along it.
        """
        if self._circles is None:
            self._circles = self._looked()
        tree, centres, radii = self._circles
        nearest = tree.query(places)[1]
        away = places - centres[nearest]
        distance = np.hypot(*away.T)
        return distance, radii[nearest], away / np.maximum(distance, 1e-9)[:, None]

    def _looked(self) -> tuple[KDTree, Floats, Floats]:
        """Points of the rim, and centres (k, 2) and radii (k,) mm of the circles beside them."""
        angle = 2 * np.pi * np.arange(_LOOK) / _LOOK
        rim = self.fabric(np.stack([np.cos(angle), np.sin(angle)], axis=1))
        ahead, behind = np.roll(rim, -1, axis=0) - rim, np.roll(rim, 1, axis=0) - rim
        along = ahead - behind
        span = np.hypot(*along.T)
        inwards = np.stack([-along[:, 1], along[:, 0]], axis=1) / span[:, None]
        # twice the triangle's area over the product of its sides (Menger)
        twice = ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0]
        curvature = 2.0 * twice / (np.hypot(*ahead.T) * np.hypot(*behind.T) * span)
        radius = 1.0 / np.maximum(curvature, _STRAIGHT / self.semi_axes.mean())
        return KDTree(rim), rim + radius[:, None] * inwards, radius
