"""Hencky's law: the potential of the logarithmic strain e = ½ ln C.

The membrane thins as t0/(λ1 λ2). The logarithm of a symmetric 2x2 tensor needs no eigenvectors:
with m = tr C/2, h = (C11-C22)/2, k = C12, s = h² + k² and g(m, s) = atanh(√s/m)/√s,

    ln C = ½ ln(m² - s) I + g (C - m I)                        (Sylvester's formula, n = 2)

and g has closed derivatives: ∂g/∂m = -1/det C, ∂g/∂s = (m/det C - g)/(2s). Near equal stretches
the latter cancel and a series in s/m² takes over.

In the lanes, with z = s/m², atanh(√z)/√z =: φ(z) obeys φ + 2 z φ' = 1/(1 - z), and so g and ∂g/∂s
follow from a series of φ'' alone without cancellation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import merged
from bulgefit.fem.laws.law import Lanes, Law
from bulgefit.fem.laws.logarithm import TERMS, half_log
from bulgefit.fem.laws.potential import (
    bent_potential,
    by_stiffness,
    coupled,
    energy,
    potential,
    straight_potential,
)

__all__ = ["HENCKY"]

_SERIES_BELOW = 0.01  # in z = s/m²; eight terms leave 1e-17


def _strain(c: NDArray[Any]) -> NDArray[Any]:
    """By the eigenvalues m ± d."""
    m, h, k = 0.5 * (c[0] + c[1]), 0.5 * (c[0] - c[1]), c[2]
    d = np.sqrt(h * h + k * k)
    alike = np.abs(d) < 1e-9 * np.abs(m)
    g = np.where(alike, 1.0 / m, np.arctanh(d / m) / np.where(alike, 1.0, d))
    area = 0.5 * np.log(m * m - d * d)
    return np.array([0.5 * (area + g * h), 0.5 * (area - g * h), g * k])


@merged
def _log_coefficient(m, s):
    """g(m, s) = atanh(√s/m)/√s and g_s."""
    z = s / (m * m)
    if z < _SERIES_BELOW:
        # g = φ(z)/m, φ = Σ zⁿ/(2n+1)
        phi, phi_1 = 0.0, 0.0
        for n in range(9, -1, -1):
            phi_1 = phi_1 * z + (n + 1) / (2.0 * n + 3.0)
            phi = phi * z + 1.0 / (2.0 * n + 1.0)
        return phi / m, phi_1 / m**3
    d = math.sqrt(s)
    g = 0.5 * math.log((m + d) / (m - d)) / d
    return g, (m / (m * m - s) - g) / (2.0 * s)


@merged
def _log_curvature(m, s, g_s):
    """g_ss of `_log_coefficient`."""
    det = m * m - s
    z = s / (m * m)
    if z < _SERIES_BELOW:
        phi_2 = 0.0
        for n in range(9, -1, -1):
            phi_2 = phi_2 * z + (n + 1) * (n + 2) / (2.0 * n + 5.0)
        return phi_2 / m**5
    return (m / (det * det) - 3.0 * g_s) / (2.0 * s)


@merged
def _response(c11, c22, c12, q):
    m, h, k = 0.5 * (c11 + c22), 0.5 * (c11 - c22), c12
    s = h * h + k * k
    g, g_s = _log_coefficient(m, s)
    area = 0.5 * math.log(m * m - s)
    at = potential(0.5 * (area + g * h), 0.5 * (area - g * h), g * k, q)
    found = _pull_back(m, h, k, g, g_s, _log_curvature(m, s, g_s), at)
    if q[26] == 0.0 and q[27] == 0.0:  # D13 and D23: most cloth has none, and is spared the work
        return found
    return coupled(found, _with_derivatives(m, h, k, area, g, g_s), q)


@merged
def _natural(q):
    return math.exp(2.0 * q[4]), math.exp(2.0 * q[5])


@merged
def _by_stiffness(c11, c22, c12, q):
    m, h, k = 0.5 * (c11 + c22), 0.5 * (c11 - c22), c12
    s = h * h + k * k
    g, g_s = _log_coefficient(m, s)
    return by_stiffness(_with_derivatives(m, h, k, 0.5 * math.log(m * m - s), g, g_s), q)


@merged
def _with_derivatives(m, h, k, area, g, g_s):
    """Strain (e11, e22, 2 e12) and its derivatives ∂e_i/∂E_j, row by row.

    They take a stress T that is conjugate to e to S_j = Σ T_i ∂e_i/∂E_j; E is Green's strain, its
    shear the engineering one.
    """
    det = m * m - (h * h + k * k)
    g_m = -1.0 / det
    # derivatives of A, B, G as in `_pull_back`, in m, h and k
    gh, gk = 2.0 * h * g_s, 2.0 * k * g_s
    a_m, a_h, a_k = m / det, -h / det, -k / det
    b_m, b_h, b_k = g_m * h, g + gh * h, gk * h
    c_m, c_h, c_k = g_m * k, gh * k, g + gk * k
    return (
        0.5 * (area + g * h), 0.5 * (area - g * h), g * k,
        0.5 * (a_m + a_h + b_m + b_h), 0.5 * (a_m - a_h + b_m - b_h), 0.5 * (a_k + b_k),
        0.5 * (a_m + a_h - b_m - b_h), 0.5 * (a_m - a_h - b_m + b_h), 0.5 * (a_k - b_k),
        c_m + c_h, c_m - c_h, c_k,
    )  # fmt: skip


@merged
def _pull_back(m, h, k, g, g_s, g_ss, at):
    """W, S and CC from the potential and its derivatives by the strain."""
    psi, t1, t2, t3, h11, h22, h33, h12 = at
    s = h * h + k * k
    det = m * m - s
    g_m = -1.0 / det
    # In y = (m, h, k): e11 + e22 = ½ ln det =: A, e11 - e22 = g h =: B, 2 e12 = g k =: G.
    ta, tb = 0.5 * (t1 + t2), 0.5 * (t1 - t2)  # conjugate to A and B
    haa = 0.25 * (h11 + h22 + 2.0 * h12)
    hbb = 0.25 * (h11 + h22 - 2.0 * h12)
    hab = 0.25 * (h11 - h22)
    # first derivatives; ∂s = (0, 2h, 2k)
    a_m, a_h, a_k = m / det, -h / det, -k / det
    gh, gk = 2.0 * h * g_s, 2.0 * k * g_s
    b_m, b_h, b_k = g_m * h, g + gh * h, gk * h
    c_m, c_h, c_k = g_m * k, gh * k, g + gk * k
    w_m = ta * a_m + tb * b_m + t3 * c_m
    w_h = ta * a_h + tb * b_h + t3 * c_h
    w_k = ta * a_k + tb * b_k + t3 * c_k
    # second derivatives
    det2 = det * det
    g_mm, g_ms = 2.0 * m / det2, -1.0 / det2
    a_mm, a_hh, a_kk = -(m * m + s) / det2, -(det + 2 * h * h) / det2, -(det + 2 * k * k) / det2
    a_mh, a_mk, a_hk = 2 * m * h / det2, 2 * m * k / det2, -2 * h * k / det2
    g_mh, g_mk = 2.0 * h * g_ms, 2.0 * k * g_ms
    g_hh = 2.0 * g_s + 4.0 * h * h * g_ss
    g_kk = 2.0 * g_s + 4.0 * k * k * g_ss
    g_hk = 4.0 * h * k * g_ss
    b_mm, b_mh, b_mk = g_mm * h, g_m + g_mh * h, g_mk * h
    b_hh, b_kk, b_hk = 2.0 * gh + g_hh * h, g_kk * h, gk + g_hk * h
    c_mm, c_mh, c_mk = g_mm * k, g_mh * k, g_m + g_mk * k
    c_hh, c_kk, c_hk = g_hh * k, 2.0 * gk + g_kk * k, gh + g_hk * k

    pa_m = haa * a_m + hab * b_m
    pb_m = hab * a_m + hbb * b_m
    pa_h = haa * a_h + hab * b_h
    pb_h = hab * a_h + hbb * b_h
    pa_k = haa * a_k + hab * b_k
    pb_k = hab * a_k + hbb * b_k
    w_mm = a_m * pa_m + b_m * pb_m + h33 * c_m * c_m + ta * a_mm + tb * b_mm + t3 * c_mm
    w_hh = a_h * pa_h + b_h * pb_h + h33 * c_h * c_h + ta * a_hh + tb * b_hh + t3 * c_hh
    w_kk = a_k * pa_k + b_k * pb_k + h33 * c_k * c_k + ta * a_kk + tb * b_kk + t3 * c_kk
    w_mh = a_m * pa_h + b_m * pb_h + h33 * c_m * c_h + ta * a_mh + tb * b_mh + t3 * c_mh
    w_mk = a_m * pa_k + b_m * pb_k + h33 * c_m * c_k + ta * a_mk + tb * b_mk + t3 * c_mk
    w_hk = a_h * pa_k + b_h * pb_k + h33 * c_h * c_k + ta * a_hk + tb * b_hk + t3 * c_hk

    # dm = dE11 + dE22, dh = dE11 - dE22, dk = 2 dE12
    return (
        psi, w_m + w_h, w_m - w_h, w_k,
        w_mm + w_hh + 2.0 * w_mh, w_mm + w_hh - 2.0 * w_mh, w_kk,
        w_mm - w_hh, w_mk + w_hk, w_mk - w_hk,
    )  # fmt: skip


@merged
def _log_terms(m, s):
    """½ ln det, g, ∂g/∂s and ∂²g/∂s²."""
    det = m * m - s
    z = s / (m * m)
    phi_2 = 0.0
    for n in range(TERMS - 1, -1, -1):
        phi_2 = phi_2 * z + (n + 1) * (n + 2) / (2.0 * n + 5.0)
    whole = m * m / det  # 1/(1 - z)
    phi_1 = (whole * whole - 2.0 * z * phi_2) / 3.0
    phi = whole - 2.0 * z * phi_1
    return half_log(det), phi / m, phi_1 / (m * m * m), phi_2 / (m * m * m * m * m)


@merged
def _straight(c11, c22, c12, q):
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    area, g, g_s, g_ss = _log_terms(m, h * h + c12 * c12)
    at = straight_potential(0.5 * (area + g * h), 0.5 * (area - g * h), g * c12, q)
    return _pull_back(m, h, c12, g, g_s, g_ss, at)


@merged
def _bends(c11, c22, c12, q):
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    area, g, g_s, g_ss = _log_terms(m, h * h + c12 * c12)
    at = bent_potential(0.5 * (area + g * h), 0.5 * (area - g * h), g * c12, q)
    found = _pull_back(m, h, c12, g, g_s, g_ss, at)
    return coupled(found, _with_derivatives(m, h, c12, area, g, g_s), q)


@merged
def _measure(c11, c22, c12):
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    area, g, g_s, _ = _log_terms(m, h * h + c12 * c12)
    return _with_derivatives(m, h, c12, area, g, g_s)


@merged
def _by_stiffness_in_lanes(c11, c22, c12, q):
    return by_stiffness(_measure(c11, c22, c12), q)


HENCKY = Law(
    name="hencky",
    meaning="stress linear in the logarithmic strain",
    energy=lambda c, q: energy(_strain(c), q),
    strain=_strain,
    response=_response,
    natural=_natural,
    by_stiffness=_by_stiffness,
    lanes=Lanes(_straight, _bends, _measure, _by_stiffness_in_lanes),
    logarithmic=True,
)
