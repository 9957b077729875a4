"""The clamp's place: an edge that goes on giving while time passes, also while pressure is held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.places import Clamping

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Orders over the angle, and powers of the decades of time: at an even pace per decade, as what
#: creeps does, and a creep that dies down or sets in. Traction of other cloth than a flat, linear
#: one goes with another power of pressure: so "d" has it squared, alike all round.
_ORDERS, _PACES = range(3), (1, 2)
_WAVES = tuple((kind, m, k) for k in _PACES for m in _ORDERS for kind in ("cs" if m else "cd"))
_NAMES = tuple(f"{kind}{m}_{k}" for kind, m, k in _WAVES)
#: Angles at which the field is looked at.
_LOOK = 360


class SlowSlipField(Field):
    """The rim moves inwards by Σ ((c + d t) cos mφ + s sin mφ) t Dᵏ, t traction, D decades of time.

    Both over their values at the last frame.
    """

    id = "slow_slip_field"
    place = "clamp"
    meaning = "the fabric goes on slipping at the clamp while time passes"
    remedy = "bond the fabric at the clamp, and hold a pressure to see its edge move"
    quantity = "motion of the edge inwards at the last frame"
    unit = "mm"
    parameters = several(
        _NAMES,
        "mm",
        5.0,
        prior=0.3,
        reason="clamps give by tenths of a millimetre, whether at once or in the course of a test",
        step=1e-3,
    )
    needs = ("time",)

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        passed = clamping.decades
        if passed is None or not any(own.values()):
            return clamping
        course = passed / max(float(passed.max()), 1e-9)
        inwards = sum(
            np.outer(clamping.loaded * course**k, _round(own, clamping.angle, k))
            + own[f"d0_{k}"] * (clamping.loaded**2 * course**k)[:, None]
            for k in _PACES
        )
        return replace(clamping, inwards=clamping.pulled(np.asarray(inwards)))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        degree = np.arange(_LOOK) * 360.0 / _LOOK
        motion = sum(_round(own, np.deg2rad(degree), k) + own[f"d0_{k}"] for k in _PACES)
        return Sampled(np.asarray(motion), {"angle_degree": degree})


def _round(own: Own, angle: Floats, pace: int) -> Floats:
    """Of one pace, at angles (n,) rad."""
    out = np.zeros(len(angle))
    for name, (kind, m, k) in zip(_NAMES, _WAVES, strict=True):
        if k == pace and kind != "d" and own[name]:
            out += own[name] * (np.cos(m * angle) if kind == "c" else np.sin(m * angle))
    return out


EFFECT = SlowSlipField()
