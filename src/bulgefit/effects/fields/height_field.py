"""The cloth's shape before inflation: waves that are finer than those that have a name."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import eval_jacobi

from bulgefit.effects.base import Own
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Parameter

__all__ = ["EFFECT", "ORDERS"]

Floats = NDArray[np.float64]

#: Azimuthal order m and radial order k of the waves of degree m + 2k up to six. Without waves along
#: the radius (k = 0), and with one for m = 0, they have an effect of their own.
ORDERS = ((1, 1), (0, 2), (2, 1), (1, 2), (3, 1), (0, 3), (2, 2), (4, 1))
_WAVES = tuple((kind, m, k) for m, k in ORDERS for kind in ("cs" if m else "c"))
_NAMES = tuple(f"{kind}{m}_{k}" for kind, m, k in _WAVES)
#: Height (mm) of a fabric's widest wave over a clamp of 200 mm, which is of second degree.
_WIDEST = 2.5
#: Points at which the field is looked at, along either axis, and at which waves are scaled.
_LOOK, _SCALED = 96, 2001


def _wave(name: str, m: int, k: int) -> Parameter:
    """A wave by its orders; the clamp adds two degrees."""
    return Parameter(
        name,
        "mm",
        -10.0,
        10.0,
        prior=_WIDEST * (2.0 / (m + 2 * k + 2)) ** 2,
        reason="waves of some millimetres over a clamp of 200 mm, and less by the square of the "
        "degree: a sheet's waves of equal bending energy do so",
        step=1e-3,
    )


class HeightField(Field):
    """z0 = Σ (1 - r²) r^m P_k(2r² - 1) (c cos mφ + s sin mφ)/h on the unit disc, mm.

    P_k is Jacobi's polynomial of parameters 2 and m, which makes waves orthogonal over the disc
    (Szegő, 1939, "Orthogonal polynomials", eq. 4.3.3, with x = 2r² - 1), also to those that have a
    name; h is the largest value of the wave, so that a parameter is its height.
    """

    id = "height_field"
    place = "shape"
    meaning = "the fabric stood in fine waves before inflation"
    remedy = "record the height (z) of the points in the reference image, or mount the fabric taut"
    quantity = "height before inflation"
    unit = "mm"
    parameters = tuple(_wave(name, m, k) for name, (_, m, k) in zip(_NAMES, _WAVES, strict=True))

    def height(self, own: Own, unit: Floats) -> Floats:
        """See the class."""
        turning, square = unit[:, 0] + 1j * unit[:, 1], (unit**2).sum(axis=1)
        out = np.zeros(len(unit))
        for name, (kind, m, k) in zip(_NAMES, _WAVES, strict=True):
            if own[name]:
                power = turning**m
                along = (1.0 - square) * eval_jacobi(k, 2, m, 2.0 * square - 1.0)
                round_it = power.real if kind == "c" else power.imag
                out += own[name] / _largest(m, k) * along * round_it
        return out

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Over the disc."""
        line = np.linspace(-1.0, 1.0, _LOOK)
        grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        grid = grid[np.hypot(*grid.T) <= 1.0]
        x, y = radius * grid.T
        return Sampled(self.height(own, grid), {"x_mm": x, "y_mm": y})


@cache
def _largest(m: int, k: int) -> float:
    """Of a wave before it is scaled."""
    r = np.linspace(0.0, 1.0, _SCALED)
    return float(np.abs((1.0 - r**2) * r**m * eval_jacobi(k, 2, m, 2.0 * r**2 - 1.0)).max())


EFFECT = HeightField()
