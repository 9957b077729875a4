"""The yarns' own kinematics: the potential of the strains along warp and fill and of their angle.

With a1, a2 the material axes, e11 = ln |F a1| = ½ ln C11, e22 = ½ ln C22, and the shear strain is
what the angle between warp and fill has lost of a right one, γ = atan(C12/√det C). Strains along
the yarns and the angle between them are what a woven fabric resists (Aimène, Vidal-Sallé, Hagège,
Sidoroff and Boisse, 2010, J. Compos. Mater. 44, 5-26). Under tension along the axes W and S are
those of `hencky`.

Where both yarns bear tension, shear of either raises their strains to second order, so the law
stays elliptic however soft the shear; the logarithm of the other law turns with the principal axes
and does not.

With τ = tan γ, b = 1/√det C, E Green's strain and k = 2 E12:

    ∂γ/∂E11 = -τ/C11,  ∂γ/∂k = b,
    ∂²γ/∂E11² = τ (3 + τ²)/C11²,  ∂²γ/∂E11∂E22 = τ (1 + τ²)/(C11 C22),
    ∂²γ/∂k² = τ b²,  ∂²γ/∂E11∂k = -C22 b³.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import merged
from bulgefit.fem.laws.law import Lanes, Law
from bulgefit.fem.laws.logarithm import half_log
from bulgefit.fem.laws.potential import (
    bent_potential,
    by_stiffness,
    coupled,
    energy,
    potential,
    straight_potential,
)

__all__ = ["YARN"]

#: Where a point is near the natural state, sin² γ < 0.1 and tan²(γ/4) < 0.0065: so many terms of
#: the arctangent leave 1e-17.
_TERMS = 8


def _strain(c: NDArray[Any]) -> NDArray[Any]:
    sine = c[2] / np.sqrt(c[0] * c[1])
    return np.array([0.5 * np.log(c[0]), 0.5 * np.log(c[1]), np.arcsin(sine)])


@merged
def _pull_back(c11, c22, c12, at):
    """W, S and CC from the potential and its derivatives by the strain."""
    psi, t1, t2, t3, h11, h22, h33, h12 = at
    a1, a2, b = 1.0 / c11, 1.0 / c22, 1.0 / math.sqrt(c11 * c22 - c12 * c12)
    tan = c12 * b
    g1, g2 = -tan * a1, -tan * a2
    tan2 = tan * tan
    return (
        psi, t1 * a1 + t3 * g1, t2 * a2 + t3 * g2, t3 * b,
        (h11 - 2.0 * t1) * a1 * a1 + h33 * g1 * g1 + t3 * tan * (3.0 + tan2) * a1 * a1,
        (h22 - 2.0 * t2) * a2 * a2 + h33 * g2 * g2 + t3 * tan * (3.0 + tan2) * a2 * a2,
        (h33 + t3 * tan) * b * b,
        h12 * a1 * a2 + h33 * g1 * g2 + t3 * tan * (1.0 + tan2) * a1 * a2,
        h33 * g1 * b - t3 * c22 * b * b * b,
        h33 * g2 * b - t3 * c11 * b * b * b,
    )  # fmt: skip


@merged
def _response(c11, c22, c12, q):
    angle = math.atan2(c12, math.sqrt(c11 * c22 - c12 * c12))
    strain = 0.5 * math.log(c11), 0.5 * math.log(c22), angle
    found = _pull_back(c11, c22, c12, potential(strain[0], strain[1], angle, q))
    return coupled(found, _with_derivatives(c11, c22, c12, strain), q)


@merged
def _natural(q):
    return math.exp(2.0 * q[4]), math.exp(2.0 * q[5])


@merged
def _by_stiffness(c11, c22, c12, q):
    angle = math.atan2(c12, math.sqrt(c11 * c22 - c12 * c12))
    strain = 0.5 * math.log(c11), 0.5 * math.log(c22), angle
    return by_stiffness(_with_derivatives(c11, c22, c12, strain), q)


@merged
def _with_derivatives(c11, c22, c12, strain):
    """Strain and its derivatives (12)."""
    e1, e2, angle = strain
    a1, a2, b = 1.0 / c11, 1.0 / c22, 1.0 / math.sqrt(c11 * c22 - c12 * c12)
    tan = c12 * b
    return e1, e2, angle, a1, 0.0, 0.0, 0.0, a2, 0.0, -tan * a1, -tan * a2, b


@merged
def _angle(c11, c22, c12):
    """γ without calls: tan(γ/2) = C12/(√(C11 C22) + √det C), halved once more."""
    square = c11 * c22
    t = c12 / (math.sqrt(square) + math.sqrt(square - c12 * c12))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    turned = 0.0
    for n in range(_TERMS - 1, -1, -1):
        turned = 1.0 / (2.0 * n + 1.0) - turned * (t * t)
    return 4.0 * t * turned


@merged
def _straight(c11, c22, c12, q):
    at = straight_potential(half_log(c11), half_log(c22), _angle(c11, c22, c12), q)
    return _pull_back(c11, c22, c12, at)


@merged
def _bends(c11, c22, c12, q):
    strain = half_log(c11), half_log(c22), _angle(c11, c22, c12)
    found = _pull_back(c11, c22, c12, bent_potential(strain[0], strain[1], strain[2], q))
    return coupled(found, _with_derivatives(c11, c22, c12, strain), q)


@merged
def _measure(c11, c22, c12):
    strain = half_log(c11), half_log(c22), _angle(c11, c22, c12)
    return _with_derivatives(c11, c22, c12, strain)


@merged
def _by_stiffness_in_lanes(c11, c22, c12, q):
    return by_stiffness(_measure(c11, c22, c12), q)


YARN = Law(
    name="yarn",
    meaning="stress linear in the logarithmic strains of warp and fill and in their angle",
    energy=lambda c, q: energy(_strain(c), q),
    strain=_strain,
    response=_response,
    natural=_natural,
    by_stiffness=_by_stiffness,
    lanes=Lanes(_straight, _bends, _measure, _by_stiffness_in_lanes),
    logarithmic=True,
)
