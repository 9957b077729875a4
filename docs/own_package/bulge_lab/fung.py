"""A law of one's own: Fung's exponential of the Green-Lagrange strain, for silicone membranes.

W = c/2 (exp(2ψ/c) - 1) with ψ = ½ E : D : E (Fung, Fronek and Patitucci 1979, eq. 2): D is the
stiffness at rest, which bulgefit makes of E1, E2, G12 and nu12, and c says how soon it stiffens.
"""

from __future__ import annotations

import math

import numpy as np

from bulgefit.fem.laws.law import Law

#: c, MPa.
SCALE = 40.0


def _strain(c):
    """Green-Lagrange strain (E11, E22, 2 E12) of C11, C22, C12."""
    return np.array([0.5 * (c[0] - 1.0), 0.5 * (c[1] - 1.0), c[2]])


def _energy(c, q):
    """In plain NumPy, also for complex numbers: what the compiled stress is checked against."""
    e1, e2, e3 = _strain(c)
    psi = 0.5 * (q[0] * e1**2 + q[1] * e2**2 + q[3] * e3**2) + q[2] * e1 * e2
    return 0.5 * SCALE * (np.exp(2.0 * psi / SCALE) - 1.0)


def _response(c11, c22, c12, q):
    """Energy, stress S11, S22, S12 and the six moduli of its tangent: compiled by bulgefit."""
    e1, e2, e3 = 0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12
    t1, t2, t3 = q[0] * e1 + q[2] * e2, q[2] * e1 + q[1] * e2, q[3] * e3
    grown = math.exp((t1 * e1 + t2 * e2 + t3 * e3) / SCALE)
    more = 2.0 * grown / SCALE
    return (
        0.5 * SCALE * (grown - 1.0),
        grown * t1, grown * t2, grown * t3,
        grown * q[0] + more * t1 * t1, grown * q[1] + more * t2 * t2, grown * q[3] + more * t3 * t3,
        grown * q[2] + more * t1 * t2, more * t1 * t3, more * t2 * t3,
    )  # fmt: skip


def _natural(q):
    """Squares of the stretches at rest."""
    return 1.0, 1.0


FUNG = Law(
    name="fung",
    meaning="exponential of the Green-Lagrange strain",
    energy=_energy,
    strain=_strain,
    response=_response,
    natural=_natural,
    parameters=("D11", "D22", "D12", "D33"),
)
