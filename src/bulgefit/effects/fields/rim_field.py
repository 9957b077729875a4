"""The clamp's shape: a rim that is no circle, however it departs from one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Order 1 is a centre that is off, order 2 an oval: both have effects of their own.
ORDERS = (3, 4, 5, 6)
_NAMES = tuple(f"{kind}{order}" for order in ORDERS for kind in "cs")
#: Angles at which the field is looked at.
_LOOK = 360


class RimField(Field):
    """Rim radius a(1 + Σ c_m cos mφ + s_m sin mφ); inside, p (1 + Σ Re((c_m - i s_m) z^m))."""

    id = "rim_field"
    place = "shape"
    meaning = "the clamp's opening is no circle"
    remedy = "measure the opening in several directions; look for burrs and cloth that was folded"
    quantity = "relative change of the rim's radius"
    parameters = several(
        _NAMES,
        "1",
        0.05,
        prior=0.006,
        reason="turned rings are round to some tenths of a millimetre once they are screwed down",
        step=1e-5,
    )
    of_rig = True

    def outline(self, own: Own, unit: Floats) -> Floats:
        """See the class."""
        return unit * (1.0 + _change(own, unit[:, 0] + 1j * unit[:, 1]))[:, None]

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Round the rim."""
        degree = np.arange(_LOOK) * 360.0 / _LOOK
        return Sampled(_change(own, np.exp(1j * np.deg2rad(degree))), {"angle_degree": degree})


def _change(own: Own, turning: NDArray[np.complex128]) -> Floats:
    """Relative change (n,) of the radius at points z = x + iy (n,) of the unit disc."""
    out, power = np.zeros(len(turning)), turning ** (ORDERS[0] - 1)
    for order in ORDERS:
        power = power * turning
        out += own[f"c{order}"] * power.real + own[f"s{order}"] * power.imag
    return out


EFFECT = RimField()
