"""The edge of the fabric rises as pressure lifts the clamp off on one side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bulgefit.effects.base import Effect, Own, stiffening
from bulgefit.effects.parameter import Parameter, as_wide_as
from bulgefit.effects.places import Clamping

__all__ = ["EFFECT"]


class RimLift(Effect):
    """The rim rises by amplitude max(0, cos(φ - direction)) (1 - exp(-shape p))/shape, p in bar.

    A plate that lifts off on one side: never below its seat, concave in pressure, at first in
    proportion to it.
    """

    id = "rim_lift"
    place = "clamp"
    meaning = "the clamp lifts off on one side as pressure rises"
    remedy = "put marks or a dial gauge on the clamp's ring; tighten its screws evenly"
    parameters = (
        Parameter(
            "amplitude",
            "mm/bar",
            0.0,
            2.0,
            prior=0.3,
            reason="rings of 10 mm steel under 3 kN a bar rise by some tenths of a millimetre",
            step=1e-4,
            start=0.05,
        ),
        Parameter(
            "direction",
            "degree",
            -180.0,
            180.0,
            prior=as_wide_as(360.0),
            reason="any side may lift, each as likely",
            step=1e-3,
            governor="amplitude",
            period=360.0,
        ),
        stiffening("amplitude"),
    )
    forms = (("amplitude", "direction"), ("amplitude", "direction", "shape"))

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        if own["amplitude"] == 0.0:
            return clamping
        rise = own["amplitude"] * clamping.opened(own["shape"])
        side = np.maximum(np.cos(clamping.angle - np.deg2rad(own["direction"])), 0.0)
        return replace(clamping, lift=clamping.lifted(np.outer(rise, side)))


EFFECT = RimLift()
