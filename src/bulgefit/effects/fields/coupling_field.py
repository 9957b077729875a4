"""The material's place: a cloth that shears where it is stretched, whatever lies askew in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_NAMES = ("c_x", "c_y")


class CouplingField(Field):
    """D13 = c_x √(E1 G12) and D23 = c_y √(E2 G12) couple shear with extension along warp and fill.

    Orthotropic cloth has none in its own axes. With both, its tangent is any symmetric one.
    """

    id = "coupling_field"
    place = "material"
    meaning = "the cloth shears where it is stretched: part of it lies at an angle to warp and fill"
    remedy = "look at each layer's yarns; test strips cut along warp and fill for skew"
    quantity = "coupling of shear with extension, over the root of both stiffnesses"
    parameters = several(
        _NAMES,
        "1",
        0.95,
        prior=0.2,
        reason="a quarter of a cloth laid at 30 degrees couples by some 0.25",
        step=1e-4,
    )
    shared = True

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        return replace(cloth, coupling=(own["c_x"], own["c_y"]))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Along warp (0 degree) and fill (90 degree)."""
        values = np.array([own[name] for name in _NAMES])
        return Sampled(values, {"from_warp_degree": np.array([0.0, 90.0])})


EFFECT = CouplingField()
