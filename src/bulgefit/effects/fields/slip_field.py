"""The clamp's place: an edge that gives in its plane, wherever and whenever it does."""

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

#: Orders over the angle of each course over pressure, k: in proportion to traction (0), and what
#: gives the sooner or the later, as a clamp that creeps (1, 2). Where an edge gives it eases its
#: own traction, so what goes round the rim has a course of its own (1) as finely as it has a size.
#: Order 0 in proportion to traction is a slip all round, which has an effect of its own.
_ORDERS = {0: range(1, 13), 1: range(13), 2: range(3)}


class SlipField(Field):
    """The rim moves radially inwards by Σ (c cos mφ + s sin mφ) s cos(kπ s), s = (p/p_max)^(2/3).

    The traction at the edge is in proportion to s (`Clamping.loaded`). The motion stands beside
    what springs at the edge give.
    """

    id = "slip_field"
    place = "clamp"
    meaning = "the fabric slips at the clamp by other amounts round the rim, or as it is loaded"
    remedy = "mark the fabric at the clamp's edge all round; tighten the clamp evenly, or bond it"
    quantity = "motion of the edge inwards at the highest pressure"
    unit = "mm"
    parameters = waves(_ORDERS)

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        if not any(own.values()):
            return clamping
        return replace(clamping, inwards=clamping.pulled(motion(own, _ORDERS, clamping)))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        return round_the_rim(own, _ORDERS, pressure)


EFFECT = SlipField()
