"""Elastic constants: which are admissible, and the plane-stress stiffness they give."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError

__all__ = [
    "STIFFEST",
    "STIFFNESS_NAMES",
    "orthotropic_stiffness",
    "orthotropic_stiffness_derivative",
]

#: Components of the plane-stress stiffness as the kernels hold them.
STIFFNESS_NAMES = ("D11", "D22", "D12", "D33")
#: MPa: far beyond any material's, and so that products of some moduli still are numbers.
STIFFEST = 1e30


def _check_modulus(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{name} must be positive, got {value:g} MPa")
    if value > STIFFEST:
        raise InputError(f"{name} must be at most {STIFFEST:g} MPa, got {value:g} MPa")


def check_orthotropic(e1: float, e2: float, g12: float, nu12: float) -> None:
    """Refuse constants whose strain energy is not positive definite.

    Raises
    ------
    InputError
        Naming the constant and the condition (Jones, 1999, eq. 2.136: |nu12| < √(E1/E2)).
    """
    for name, value in (("E1", e1), ("E2", e2), ("G12", g12)):
        _check_modulus(name, value)
    if not math.isfinite(nu12):
        raise InputError(f"nu12 must be finite, got {nu12:g}")
    if not e1 / e2 > nu12**2:
        raise InputError(
            f"E1/E2 must exceed nu12² for a positive strain energy: E1 = {e1:g} MPa, "
            f"E2 = {e2:g} MPa give {e1 / e2:.4g}, nu12 = {nu12:g} gives {nu12**2:.4g}"
        )


def orthotropic_stiffness(e1: float, e2: float, g12: float, nu12: float) -> NDArray[np.float64]:
    """Plane-stress stiffness (D11, D22, D12, D33) in material axes, MPa.

    nu12 is the contraction along 2 under tension along 1; nu21 = nu12 E2/E1.

    Raises
    ------
    InputError
        Constants whose strain energy is not positive definite.
    """
    check_orthotropic(e1, e2, g12, nu12)
    shrink = 1.0 / (1.0 - nu12**2 * e2 / e1)
    return np.array([e1 * shrink, e2 * shrink, nu12 * e2 * shrink, g12])


def orthotropic_stiffness_derivative(
    e1: float, e2: float, g12: float, nu12: float
) -> NDArray[np.float64]:
    """∂(D11, D22, D12, D33)/∂(E1, E2, G12, nu12), (4, 4)."""
    ratio = e2 / e1
    shrink = 1.0 / (1.0 - nu12**2 * ratio)
    # d(shrink)/d(E1, E2, nu12)
    by_e1 = -(shrink**2) * nu12**2 * ratio / e1
    by_e2 = shrink**2 * nu12**2 / e1
    by_nu = 2.0 * shrink**2 * nu12 * ratio
    out = np.zeros((4, 4))
    out[0] = shrink + e1 * by_e1, e1 * by_e2, 0.0, e1 * by_nu
    out[1] = e2 * by_e1, shrink + e2 * by_e2, 0.0, e2 * by_nu
    out[2] = nu12 * e2 * by_e1, nu12 * (shrink + e2 * by_e2), 0.0, e2 * (shrink + nu12 * by_nu)
    out[3, 2] = 1.0
    return out


def isotropic_constants(values: Mapping[str, float]) -> dict[str, float]:
    """E1, E2, G12, nu12 of an isotropic sheet given as (E, nu) or (E, G).

    Raises
    ------
    InputError
        nu outside 0 <= nu < 0.5, also where it follows from E and G as E/2G - 1.
    """
    modulus = values["E"]
    _check_modulus("E", modulus)
    if "G" in values:
        shear = values["G"]
        _check_modulus("G", shear)
        nu = modulus / (2.0 * shear) - 1.0
        origin = f" (E = {modulus:g} MPa and G = {shear:g} MPa give nu = E/2G - 1)"
    else:
        nu, shear = values["nu"], modulus / (2.0 * (1.0 + values["nu"]))
        origin = ""
    if not 0.0 <= nu < 0.5:
        raise InputError(f"nu must lie in 0 <= nu < 0.5, got {nu:.6g}{origin}")
    return {"E1": modulus, "E2": modulus, "G12": shear, "nu12": nu}
