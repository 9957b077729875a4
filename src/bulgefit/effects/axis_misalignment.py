"""The warp does not run along x."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]


class AxisMisalignment(Effect):
    """The warp lies at `angle` to where it was meant to, counter-clockwise seen from +z.

    That is x, or what the test says (`BulgeTest.warp_angle`).
    """

    id = "axis_misalignment"
    place = "material"
    meaning = "the warp axis is turned from where it was meant to lie"
    remedy = "draw the warp on the fabric and turn the test's axes to it (bulgefit align)"
    parameters = (
        Parameter(
            "angle",
            "degree",
            -45.0,
            45.0,
            prior=10.0,
            reason="fabric cut by eye lies within some degrees of its yarns",
            step=1e-2,
        ),
    )

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        return replace(cloth, angle=cloth.angle + own["angle"])


EFFECT = AxisMisalignment()
