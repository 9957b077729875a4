"""The clamp's place: an edge that gives along itself, where the cloth pulls askew at it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.fields.edge_waves import motion, round_the_rim, waves
from bulgefit.effects.places import Clamping

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Orders over the angle of each course over pressure: in proportion to traction (0), and what gives
#: the sooner or the later (1). A cloth that is stiffer along warp pulls along the edge by the sines
#: of twice and four times the angle; the orders about them are what bolts make of that. Order 0 has
#: no cause: nothing but the edge would hold the moment of such a traction about the axis.
_ORDERS = {0: range(1, 7), 1: range(1, 7)}


class TangentialSlipField(Field):
    """The rim moves along itself by Σ (c cos mφ + s sin mφ) s cos(kπ s), s = (p/p_max)^(2/3).

    Counter-clockwise seen from +z. A clamp that gives does so wherever it is pulled: inwards
    (`slip_field`), and along the edge, where the tensions of warp and fill that differ by ΔN pull
    with ½ ΔN sin 2φ.
    """

    id = "tangential_slip_field"
    place = "clamp"
    meaning = "the fabric slips along the edge of the clamp"
    remedy = "mark the fabric at the clamp's edge all round; tighten the clamp evenly, or bond it"
    quantity = "motion along the edge at the highest pressure"
    unit = "mm"
    parameters = waves(_ORDERS)

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        if not any(own.values()):
            return clamping
        return replace(clamping, along=clamping.sheared(motion(own, _ORDERS, clamping)))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        return round_the_rim(own, _ORDERS, pressure)


EFFECT = TangentialSlipField()
