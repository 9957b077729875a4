"""Saint Venant-Kirchhoff: the potential of Green's strain e = ½ (C - I)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import merged
from bulgefit.fem.laws.law import Lanes, Law
from bulgefit.fem.laws.potential import (
    bent_potential,
    coupled,
    energy,
    potential,
    straight_potential,
)

__all__ = ["SVK"]


def _strain(c: NDArray[Any]) -> NDArray[Any]:
    return np.array([0.5 * (c[0] - 1.0), 0.5 * (c[1] - 1.0), c[2]])


@merged
def _response(c11, c22, c12, q):
    psi, t1, t2, t3, h11, h22, h33, h12 = potential(0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12, q)
    found = psi, t1, t2, t3, h11, h22, h33, h12, 0.0, 0.0
    return coupled(found, _measure(c11, c22, c12), q)


@merged
def _natural(q):
    return 1.0 + 2.0 * q[4], 1.0 + 2.0 * q[5]


@merged
def _straight(c11, c22, c12, q):
    psi, t1, t2, t3, h11, h22, h33, h12 = straight_potential(
        0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12, q
    )
    return psi, t1, t2, t3, h11, h22, h33, h12, 0.0, 0.0


@merged
def _bends(c11, c22, c12, q):
    psi, t1, t2, t3, h11, h22, h33, h12 = bent_potential(
        0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12, q
    )
    found = psi, t1, t2, t3, h11, h22, h33, h12, 0.0, 0.0
    return coupled(found, _measure(c11, c22, c12), q)


@merged
def _measure(c11, c22, c12):
    return (
        0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12,
        1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0,
    )  # fmt: skip


@merged
def _by_stiffness(c11, c22, c12, q):
    e1, e2 = 0.5 * (c11 - 1.0) - q[4], 0.5 * (c22 - 1.0) - q[5]
    return (e1, 0.0, 0.0), (0.0, e2, 0.0), (e2, e1, 0.0), (0.0, 0.0, c12)


SVK = Law(
    name="svk",
    meaning="stress linear in the Green-Lagrange strain",
    energy=lambda c, q: energy(_strain(c), q),
    strain=_strain,
    response=_response,
    natural=_natural,
    by_stiffness=_by_stiffness,
    lanes=Lanes(_straight, _bends, _measure, _by_stiffness),
)
