"""The clamp's place: an edge that rises as pressure opens the clamp, however it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, stiffening
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Clamping

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: An edge that rises as a whole (order 0) or tilts (order 1) moves with its fixture, which has an
#: effect of its own: a clamp that opens and nowhere sinks is these orders beside that.
ORDERS = (2, 3, 4)
_NAMES = tuple(f"{kind}{order}" for order in ORDERS for kind in "cs")
#: Rise (mm/bar) of a ring of 10 mm steel under 3 kN a bar that gives on one side.
_RISE = 0.3
#: Angles at which the field is looked at.
_LOOK = 360


def _mode(name: str) -> Parameter:
    """A wave along the ring, by its order."""
    return Parameter(
        name,
        "mm/bar",
        -1.0,
        1.0,
        prior=_RISE / int(name[1]) ** 2,
        reason="rings rise by 0.3 mm/bar on one side, and less by the square of the order: "
        "they bend as beams, whose modes of equal energy do so",
        step=1e-4,
    )


class LiftField(Field):
    """The rim rises by Σ (c_m cos mφ + s_m sin mφ) (1 - exp(-shape p))/shape, p in bar."""

    id = "lift_field"
    place = "clamp"
    meaning = "the clamp's edge rises by other amounts round the rim"
    remedy = "put dial gauges round the clamp's ring; tighten its screws evenly, or add some"
    quantity = "rise of the rim at the highest pressure"
    unit = "mm"
    parameters = (
        *map(_mode, _NAMES),
        stiffening(),
    )
    forms = (_NAMES, (*_NAMES, "shape"))

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        if not any(own[name] for name in _NAMES):
            return clamping
        rise = clamping.opened(own["shape"])
        return replace(clamping, lift=clamping.lifted(np.outer(rise, _round(own, clamping.angle))))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        degree = np.arange(_LOOK) * 360.0 / _LOOK
        angle = np.deg2rad(degree)
        (rise,) = Clamping(angle, pressure.max(keepdims=True)).opened(own["shape"])
        return Sampled(rise * _round(own, angle), {"angle_degree": degree})


def _round(own: Own, angle: Floats) -> Floats:
    """Rise (n,) mm/bar at angles (n,) rad, at first."""
    waves = (own[f"c{m}"] * np.cos(m * angle) + own[f"s{m}"] * np.sin(m * angle) for m in ORDERS)
    return np.asarray(sum(waves))


EFFECT = LiftField()
