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
#: gives the sooner or the later, as a clamp that creeps (1, 2). Where an edge gives it eases its
#: own traction, so what goes round the rim has a course of its own (1) as finely as it has a size.
#: Order 0 in proportion to traction is a slip all round, which has an effect of its own.
_ORDERS = {0: range(1, 13), 1: range(13), 2: range(3)}
_WAVES = tuple(
    (kind, m, k) for k, orders in _ORDERS.items() for m in orders for kind in ("cs" if m else "c")
)
_NAMES = tuple(f"{kind}{m}_{k}" for kind, m, k in _WAVES)
#: A coated fabric in a serrated clamp gives by tenths of a millimetre at 10 N/mm, alike over some
#: 30 mm of the edge of a clamp of 100 mm radius (rad).
_GIVES, _ALIKE = 0.3, 0.3
#: Angles at which the field is looked at.
_LOOK = 360


def _wave(name: str, m: int) -> Parameter:
    """A wave along the edge, by its order.

    A process over the angle of covariance exp(-|δ|/l), which may begin and end as sharply as a bolt
    holds, has Fourier coefficients of variance (2 l/π)/(1 + m²l²), each for cosine and sine, and
    half of that for m = 0 (Rasmussen and Williams, 2006, "Gaussian processes for machine learning",
    eq. 4.15, of order 1/2).
    """
    share = (2.0 if m else 1.0) * _ALIKE / np.pi / (1.0 + (m * _ALIKE) ** 2)
    return Parameter(
        name,
        "mm",
        -5.0,
        5.0,
        prior=float(_GIVES * np.sqrt(share)),
        reason="clamps give by tenths of a millimetre, alike over some centimetres of their edge",
        step=1e-3,
    )


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
    parameters = tuple(_wave(name, m) for name, (_, m, _) in zip(_NAMES, _WAVES, strict=True))

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """See the class."""
        if not any(own.values()):
            return clamping
        return replace(clamping, inwards=clamping.pulled(_motion(own, clamping)))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        degree = np.arange(_LOOK) * 360.0 / _LOOK
        (motion,) = _motion(own, Clamping(np.deg2rad(degree), pressure.max(keepdims=True)))
        return Sampled(motion, {"angle_degree": degree})


def _motion(own: Own, clamping: Clamping) -> Floats:
    """Inwards (frames, n) mm at the clamp's angles (n,) and pressures (frames,)."""
    load, angle = clamping.loaded[:, None], clamping.angle
    courses = load * np.cos(np.pi * load * list(_ORDERS))
    round_the_rim = np.zeros((len(_ORDERS), len(angle)))
    for k, orders in _ORDERS.items():
        turned = np.outer(orders, angle)
        cosine = [own[f"c{m}_{k}"] for m in orders]
        sine = [own[f"s{m}_{k}"] if m else 0.0 for m in orders]
        round_the_rim[k] = cosine @ np.cos(turned) + sine @ np.sin(turned)
    return np.asarray(courses @ round_the_rim)


EFFECT = SlipField()
