"""Which stress does a strip take that is pulled along warp or fill, and free to narrow?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.laws.law import Law

__all__ = ["kirchhoff", "uniaxial"]

Floats = NDArray[np.float64]

#: Imaginary step: W's derivative without cancellation (Squire and Trapp, 1998).
_STEP = 1e-30
#: Step (strain) of differences of the stress: its slope only has to lead to the root.
_SLOPE_STEP = 1e-6
#: Newton's steps, and share of the stiffness that the stress across may be.
_STEPS, _SETTLED = 50, 1e-12


def uniaxial(law: Law, q: tuple[float, ...], strain: Floats, axis: int) -> Floats:
    """Kirchhoff stress (k,) MPa ∂W/∂e along warp or fill, that across being zero.

    Parameters
    ----------
    law : Law
    q : tuple of float
        As `laws.potential.PARAMETERS` names it.
    strain : (k,) array
        Logarithmic, along the pull; the strip narrows, or widens, until nothing pulls across.
    axis : {0, 1}
        Warp, fill.

    Returns
    -------
    (k,) array
        NaN where nothing balances across.
    """
    across = np.zeros_like(strain)

    def stresses(across: Floats) -> Floats:
        pair = (strain, across) if axis == 0 else (across, strain)
        found = kirchhoff(law, q, np.array(pair))
        return found if axis == 0 else found[::-1]

    for _ in range(_STEPS):
        along, left = stresses(across)
        balanced = np.abs(left) <= _SETTLED * q[1 - axis]
        if balanced.all():
            break
        ahead, behind = stresses(across + _SLOPE_STEP), stresses(across - _SLOPE_STEP)
        across = across - 2.0 * _SLOPE_STEP * left / (ahead[1] - behind[1])
    return np.where(balanced, along, np.nan)


def kirchhoff(law: Law, q: tuple[float, ...], strains: Floats) -> Floats:
    """∂W/∂e (2, k) MPa along warp and fill, of logarithmic strains (2, k) without shear."""
    out = np.empty_like(strains)
    for axis in (0, 1):
        moved = strains.astype(complex)
        moved[axis] += 1j * _STEP
        stretch = np.array([*np.exp(2.0 * moved), np.zeros_like(moved[0])])
        out[axis] = law.energy(stretch, q).imag / _STEP
    return out
