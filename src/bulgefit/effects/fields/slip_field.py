"""The clamp's place: an edge that gives in its plane, wherever and whenever it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Clamping

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Orders over the angle of each course over pressure, k: in proportion to traction (0), and what
#: gives the sooner or the later, as a clamp that creeps (1, 2). Order 0 in proportion to traction
#: is a slip all round, which has an effect of its own.
_ORDERS = {0: range(1, 7), 1: range(3), 2: range(3)}
_WAVES = tuple(
    (kind, m, k) for k, orders in _ORDERS.items() for m in orders for kind in ("cs" if m else "c")
)
_NAMES = tuple(f"{kind}{m}_{k}" for kind, m, k in _WAVES)
#: A coated fabric in a serrated clamp gives by tenths of a millimetre at 10 N/mm, alike over some
#: 30 mm of the edge of a clamp of 100 mm radius (rad).
_GIVES, _ALIKE = 0.3, 0.3
#: Pressure (MPa) of a test that has none.
_NONE = 1e-12
#: Angles at which the field is looked at.
_LOOK = 360


def _wave(name: str, m: int) -> Parameter:
    """A wave along the edge, by its order.

    A Gaussian process over the angle of covariance exp(-δ²/2l²) has the Fourier coefficients
    l/√(2π) exp(-m²l²/2) (Rasmussen and Williams, 2006, "Gaussian processes for machine learning",
    eq. 4.9-4.11), each for cosine and sine, but for m = 0 twice.
    """
    share = _ALIKE / np.sqrt(2.0 * np.pi) * np.exp(-0.5 * (m * _ALIKE) ** 2)
    return Parameter(
        name,
        "mm",
        -5.0,
        5.0,
        prior=float(_GIVES * np.sqrt(2.0 * share if m else share)),
        reason="clamps give by tenths of a millimetre, alike over some centimetres of their edge",
        step=1e-3,
    )


class SlipField(Field):
    """The rim moves radially inwards by Σ (c cos mφ + s sin mφ) s cos(kπ s), s = (p/p_max)^(2/3).

    The traction at the edge of a flat, linear membrane goes with p^(2/3) (Hencky, 1915, "Über den
    Spannungszustand in kreisrunden Platten mit verschwindender Biegungssteifigkeit"). It stands
    beside what springs at the edge give.
    """

    id = "slip_field"
    place = "clamp"
    meaning = "the fabric slips at the clamp by other amounts round the rim, or as it is loaded"
    remedy = "mark the fabric at the clamp's edge all round; tighten the clamp evenly, or bond it"
    quantity = "motion of the edge inwards at the highest pressure"
    unit = "mm"
    parameters = tuple(_wave(name, m) for name, (_, m, _) in zip(_NAMES, _WAVES, strict=True))

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        if not any(own.values()):
            return clamping
        inwards = _motion(own, clamping.angle, clamping.pressure)
        return replace(clamping, inwards=clamping.pulled(inwards))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        degree = np.arange(_LOOK) * 360.0 / _LOOK
        (motion,) = _motion(own, np.deg2rad(degree), pressure.max(keepdims=True))
        return Sampled(motion, {"angle_degree": degree})


def _motion(own: Own, angle: Floats, pressure: Floats) -> Floats:
    """Inwards (frames, n) mm at angles (n,) rad and pressures (frames,)."""
    loaded = np.maximum(pressure, 0.0)
    load = np.cbrt(loaded / max(loaded.max(), _NONE)) ** 2
    out = np.zeros((len(pressure), len(angle)))
    for name, (kind, m, k) in zip(_NAMES, _WAVES, strict=True):
        if own[name]:
            along = np.cos(m * angle) if kind == "c" else np.sin(m * angle)
            out += own[name] * np.outer(load * np.cos(k * np.pi * load), along)
    return out


EFFECT = SlipField()
