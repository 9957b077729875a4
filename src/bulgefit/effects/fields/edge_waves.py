"""How does an edge move that a clamp does not hold? In waves round the rim, as it is loaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own
from bulgefit.effects.fields.base import Sampled
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Clamping

__all__ = ["Orders", "motion", "round_the_rim", "waves"]

Floats = NDArray[np.float64]
#: Orders over the angle, by course over pressure.
Orders = Mapping[int, Sequence[int]]

#: A coated fabric in a serrated clamp gives by tenths of a millimetre at 10 N/mm, alike over some
#: 30 mm of the edge of a clamp of 100 mm radius (rad).
_GIVES, _ALIKE = 0.3, 0.3
#: Angles at which a field is looked at.
_LOOK = 360


def waves(orders: Orders) -> tuple[Parameter, ...]:
    """Cosine and sine (mm) of each order and course: `c2_1` is cos 2φ by the course 1."""
    return tuple(
        _wave(f"{kind}{m}_{k}", m)
        for k, each in orders.items()
        for m in each
        for kind in ("cs" if m else "c")
    )


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


def motion(own: Own, orders: Orders, clamping: Clamping) -> Floats:
    """Σ (c cos mφ + s sin mφ) s cos(kπ s), (frames, n) mm, at the clamp's angles and pressures.

    s is the traction at the edge over that at the highest pressure (`Clamping.loaded`).
    """
    load, angle = clamping.loaded[:, None], clamping.angle
    courses = load * np.cos(np.pi * load * list(orders))
    by_course = np.zeros((len(orders), len(angle)))
    for row, (k, each) in zip(by_course, orders.items(), strict=True):
        turned = np.outer(each, angle)
        cosine = [own[f"c{m}_{k}"] for m in each]
        sine = [own[f"s{m}_{k}"] if m else 0.0 for m in each]
        row[:] = cosine @ np.cos(turned) + sine @ np.sin(turned)
    return np.asarray(courses @ by_course)


def round_the_rim(own: Own, orders: Orders, pressure: Floats) -> Sampled:
    """The motion at the highest of the pressures (frames,) MPa."""
    degree = np.arange(_LOOK) * 360.0 / _LOOK
    clamping = Clamping(np.deg2rad(degree), pressure.max(keepdims=True))
    (moved,) = motion(own, orders, clamping)
    return Sampled(moved, {"angle_degree": degree})
