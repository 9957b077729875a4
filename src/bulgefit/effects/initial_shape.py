"""The fabric is not flat before inflation: a stress-free height that vanishes at the rim."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several, stages
from bulgefit.effects.further import Further, Told

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Azimuthal orders of the further modes (cosine and sine each).
FOLD_ORDERS = (3, 4, 5, 6)
_NAMES = ("h0", "hx", "hy", "c2", "s2", "h2", *(f"{k}{m}" for m in FOLD_ORDERS for k in "cs"))


class InitialShape(Effect):
    """Displacement counts from this surface; what omitting it leaves hardly changes with pressure.

    z0 = (1 - r²)(h0 + hx x + hy y + c2 (x² - y²) + s2 2xy + h2 r² + Σ_m r^m (c_m cos mφ +
    s_m sin mφ)) on the unit disc, mm.
    """

    id = "initial_shape"
    place = "shape"
    meaning = "the fabric was not flat before inflation"
    remedy = "record the height (z) of the points in the reference image, or mount the fabric taut"
    parameters = several(
        _NAMES,
        "mm",
        10.0,
        prior=2.5,
        reason="fabric off a roll keeps waves of some millimetres over a clamp of 200 mm",
        step=1e-3,
    )
    forms = stages(_NAMES, 1, 3, 6, 10, 14)
    # a shape measured without pressure is good to some hundredths of a millimetre
    told = (Told(Further.SHAPE, _NAMES, 0.05),)

    def height(self, own: Own, unit: Floats) -> Floats:
        """See the class."""
        x, y = unit.T
        square = x * x + y * y
        inside = own["h0"] + own["hx"] * x + own["hy"] * y
        inside = inside + own["c2"] * (x * x - y * y) + own["s2"] * 2 * x * y + own["h2"] * square
        turning = x + 1j * y
        for order in FOLD_ORDERS:
            power = turning**order
            inside = inside + own[f"c{order}"] * power.real + own[f"s{order}"] * power.imag
        return np.asarray((1.0 - square) * inside)


EFFECT = InitialShape()
