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
#: creeps does, and a creep that dies down or sets in.
_ORDERS, _PACES = range(3), (1, 2)
_WAVES = tuple((kind, m, k) for k in _PACES for m in _ORDERS for kind in ("cs" if m else "c"))
_NAMES = tuple(f"{kind}{m}_{k}" for kind, m, k in _WAVES)
#: Traction (N/mm) under which what gives all round is told: that of a coated fabric at some 2 bar.
_TRACTION = 10.0
#: Angles at which the field is looked at.
_LOOK = 360


class SlowSlipField(Field):
    """The rim moves inwards by Σ (c cos mφ + s sin mφ) t D^k, t its traction, D decades of time.

    D is over its value at the last frame of all that were recorded. All round (m = 0) t is the
    traction that there is, over 10 N/mm: the clamp gives more as time passes. Else it is told by
    pressure, over its value at the highest (`Clamping.loaded`).
    """

    id = "slow_slip_field"
    place = "clamp"
    meaning = "the fabric goes on slipping at the clamp while time passes"
    remedy = "bond the fabric at the clamp, and hold a pressure to see its edge move"
    quantity = "motion of the edge inwards at the last frame, under 10 N/mm"
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
        if clamping.clock is None or not any(own.values()):
            return clamping
        course = clamping.clock.course
        gives = np.sum([own[f"c0_{k}"] * course**k for k in _PACES], axis=0) / _TRACTION
        if gives.any():
            clamping = replace(clamping, eased=clamping.giving(gives))
        waves = [_round(own, clamping.angle, k) for k in _PACES]
        if not any(wave.any() for wave in waves):
            return clamping
        inwards = sum(
            np.outer(clamping.loaded * course**k, wave)
            for k, wave in zip(_PACES, waves, strict=True)
        )
        return replace(clamping, inwards=clamping.pulled(np.asarray(inwards)))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        degree = np.arange(_LOOK) * 360.0 / _LOOK
        motion = sum(own[f"c0_{k}"] + _round(own, np.deg2rad(degree), k) for k in _PACES)
        return Sampled(np.asarray(motion), {"angle_degree": degree})


def _round(own: Own, angle: Floats, pace: int) -> Floats:
    """Waves of one pace, at angles (n,) rad."""
    out = np.zeros(len(angle))
    for name, (kind, m, k) in zip(_NAMES, _WAVES, strict=True):
        if k == pace and m and own[name]:
            out += own[name] * (np.cos(m * angle) if kind == "c" else np.sin(m * angle))
    return out


EFFECT = SlowSlipField()
