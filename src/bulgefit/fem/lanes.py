"""The laws at many material points at once, one in each lane of the processor's vectors.

Almost every point of a blown membrane is taut and moderately stretched. There the laws need no
branches, and with series for the logarithms no calls, so the compiler takes several points at a
time. Points that are not so plain are told apart, and left to `relaxation.respond`.

With z = s/m², atanh(√z)/√z =: φ(z) obeys φ + 2 z φ' = 1/(1 - z), and so g and ∂g/∂s follow
from a series of φ'' alone without cancellation (m, s and g as in `laws`).

Bends of the stress are added where there are any: W, S and CC are linear in the potential and its
derivatives by strain.
"""

from __future__ import annotations

import math

from bulgefit.fem.jit import inlined, merged
from bulgefit.fem.laws import (
    by_stiffness,
    log_strain,
    pull_back,
    straight_potential,
)
from bulgefit.fem.relaxation import is_compressed, is_slack

__all__ = [
    "LANES",
    "find_plain",
    "measure_in_lanes",
    "respond_in_lanes",
    "stiffness_in_lanes",
    "stress_in_lanes",
]

#: Points that are taken together: arrays have them last, and the innermost loops run over them.
#: With fewer of them LLVM unrolls these loops instead.
LANES = 16

#: A bend's arctangent and logarithm: halvings by roots, after which so many terms leave 1e-17 for
#: strains of up to 200 times the knee.
_HALVED, _LOG_HALVED, _BEND_TERMS = 3, 5, 12
_TURNS, _LOGS = 2.0**_HALVED, 2.0 ** (_LOG_HALVED + 1)

#: Series are used up to this square of their argument, where as many terms leave 1e-16: areas
#: that are stretched 1.9 times, and stretches of the ratio 1.4.
_NEAR, _TERMS = 0.1, 16


@merged
def _log_argument(det):
    """The u of ½ ln det = 2 atanh u."""
    root = math.sqrt(det)
    return (root - 1.0) / (root + 1.0)


@merged
def _log_terms(m, s):
    """½ ln det, g, ∂g/∂s and ∂²g/∂s²."""
    det = m * m - s
    u = _log_argument(det)
    z = s / (m * m)
    log, phi_2 = 0.0, 0.0
    for n in range(_TERMS - 1, -1, -1):
        log = log * (u * u) + 1.0 / (2.0 * n + 1.0)
        phi_2 = phi_2 * z + (n + 1) * (n + 2) / (2.0 * n + 5.0)
    whole = m * m / det  # 1/(1 - z)
    phi_1 = (whole * whole - 2.0 * z * phi_2) / 3.0
    phi = whole - 2.0 * z * phi_1
    return 2.0 * u * log, phi / m, phi_1 / (m * m * m), phi_2 / (m * m * m * m * m)


@merged
def _bend(e, knee):
    """`laws._knee` without calls.

    atan x = 2 atan(x/(1 + √(1 + x²))) and ln(1 + y) = 2 ln(1 + y/(1 + √(1 + y))).
    """
    x = e / knee
    t, y = x, x * x
    for _ in range(_HALVED):
        t = t / (1.0 + math.sqrt(1.0 + t * t))
    for _ in range(_LOG_HALVED):
        y = y / (1.0 + math.sqrt(1.0 + y))
    u = y / (2.0 + y)
    turned, log = 0.0, 0.0
    for n in range(_BEND_TERMS - 1, -1, -1):
        turned = 1.0 / (2.0 * n + 1.0) - turned * (t * t)
        log = log * (u * u) + 1.0 / (2.0 * n + 1.0)
    turned, log = _TURNS * t * turned, _LOGS * u * log
    return (
        knee * knee * (0.5 * x * x - x * turned + 0.5 * log),
        knee * (x - turned),
        x * x / (1.0 + x * x),
    )


@merged
def _bent_potential(e1, e2, q):
    """What the bends add to `straight_potential`."""
    psi_1, bent_1, slope_1 = _bend(max(e1 - q[4], 0.0), q[10])
    psi_2, bent_2, slope_2 = _bend(max(e2 - q[5], 0.0), q[11])
    psi = q[8] * psi_1 + q[9] * psi_2
    return psi, q[8] * bent_1, q[9] * bent_2, 0.0, q[8] * slope_1, q[9] * slope_2, 0.0, 0.0


@inlined
def _add_bends(strain, weight, q, law, at):
    """What the bends add to W, S and CC, times a weight."""
    if law == 1:
        for c in range(LANES):
            e1, e2 = 0.5 * (strain[0, c] - 1.0), 0.5 * (strain[1, c] - 1.0)
            found = _bent_potential(e1, e2, q)
            at[0, c] += weight[c] * found[0]
            at[1, c] += weight[c] * found[1]
            at[2, c] += weight[c] * found[2]
            at[4, c] += weight[c] * found[4]
            at[5, c] += weight[c] * found[5]
    else:
        for c in range(LANES):
            m, h = 0.5 * (strain[0, c] + strain[1, c]), 0.5 * (strain[0, c] - strain[1, c])
            k, w = strain[2, c], weight[c]
            area, g, g_s, g_ss = _log_terms(m, h * h + k * k)
            e1, e2 = 0.5 * (area + g * h), 0.5 * (area - g * h)
            found = pull_back(m, h, k, g, g_s, g_ss, _bent_potential(e1, e2, q))
            at[0, c] += w * found[0]
            at[1, c] += w * found[1]
            at[2, c] += w * found[2]
            at[3, c] += w * found[3]
            at[4, c] += w * found[4]
            at[5, c] += w * found[5]
            at[6, c] += w * found[6]
            at[7, c] += w * found[7]
            at[8, c] += w * found[8]
            at[9, c] += w * found[9]


@inlined
def respond_in_lanes(strain, weight, q, law, relax, natural, at, plain):
    """W, S (3) and CC (6), times a weight, of taut points that are moderately stretched.

    Parameters
    ----------
    strain : (3, LANES) array
        C11, C22, C12.
    weight : (LANES,) array
    q, law, relax
        As `relaxation.point_response` takes them.
    natural : tuple of 2
        C11 and C22 of the natural state.
    at : (10, LANES) array
        Overwritten; of no meaning at points that are not plain.
    plain : (LANES,) array
        Overwritten with 1, and 0 where `relaxation.respond` has to be asked.
    """
    if law == 1:
        for c in range(LANES):
            e1, e2 = 0.5 * (strain[0, c] - 1.0), 0.5 * (strain[1, c] - 1.0)
            psi, t1, t2, t3, h11, h22, h33, h12 = straight_potential(e1, e2, strain[2, c], q)
            at[0, c], at[1, c], at[2, c] = weight[c] * psi, weight[c] * t1, weight[c] * t2
            at[3, c], at[4, c], at[5, c] = weight[c] * t3, weight[c] * h11, weight[c] * h22
            at[6, c], at[7, c], at[8, c], at[9, c] = weight[c] * h33, weight[c] * h12, 0.0, 0.0
    else:
        for c in range(LANES):
            m, h = 0.5 * (strain[0, c] + strain[1, c]), 0.5 * (strain[0, c] - strain[1, c])
            k, w = strain[2, c], weight[c]
            area, g, g_s, g_ss = _log_terms(m, h * h + k * k)
            e1, e2 = 0.5 * (area + g * h), 0.5 * (area - g * h)
            found = pull_back(m, h, k, g, g_s, g_ss, straight_potential(e1, e2, g * k, q))
            at[0, c], at[1, c], at[2, c] = w * found[0], w * found[1], w * found[2]
            at[3, c], at[4, c], at[5, c] = w * found[3], w * found[4], w * found[5]
            at[6, c], at[7, c], at[8, c] = w * found[6], w * found[7], w * found[8]
            at[9, c] = w * found[9]
    if q[8] != 0.0 or q[9] != 0.0:
        _add_bends(strain, weight, q, law, at)
    find_plain(strain, at[1:4], weight, q, relax, natural, plain)


@inlined
def stiffness_in_lanes(strain, weight, q, law, relax, natural, found, stress, plain):
    """∂S/∂(D11, D22, D12, D33) times a weight, of points such as `respond_in_lanes` takes.

    Parameters
    ----------
    found : (4, 3, LANES) array
        Overwritten.
    stress : (3, LANES) array
        Overwritten with S times the weight, as far as it is due to D. Positive gains only add
        tension, the logarithm being operator monotone; with others, or bends, no point is plain.
    """
    if law == 1:
        for c in range(LANES):
            w = weight[c]
            e1, e2 = 0.5 * (strain[0, c] - 1.0) - q[4], 0.5 * (strain[1, c] - 1.0) - q[5]
            found[0, 0, c], found[0, 1, c], found[0, 2, c] = w * e1, 0.0, 0.0
            found[1, 0, c], found[1, 1, c], found[1, 2, c] = 0.0, w * e2, 0.0
            found[2, 0, c], found[2, 1, c], found[2, 2, c] = w * e2, w * e1, 0.0
            found[3, 0, c], found[3, 1, c], found[3, 2, c] = 0.0, 0.0, w * strain[2, c]
    else:
        for c in range(LANES):
            m, h = 0.5 * (strain[0, c] + strain[1, c]), 0.5 * (strain[0, c] - strain[1, c])
            k, w = strain[2, c], weight[c]
            area, g, g_s, _ = _log_terms(m, h * h + k * k)
            d11, d22, d12, d33 = by_stiffness(log_strain(m, h, k, area, g, g_s), q)
            found[0, 0, c], found[0, 1, c], found[0, 2, c] = w * d11[0], w * d11[1], w * d11[2]
            found[1, 0, c], found[1, 1, c], found[1, 2, c] = w * d22[0], w * d22[1], w * d22[2]
            found[2, 0, c], found[2, 1, c], found[2, 2, c] = w * d12[0], w * d12[1], w * d12[2]
            found[3, 0, c], found[3, 1, c], found[3, 2, c] = w * d33[0], w * d33[1], w * d33[2]
    for i in range(3):
        for c in range(LANES):
            stress[i, c] = (
                q[0] * found[0, i, c] + q[1] * found[1, i, c]
                + q[2] * found[2, i, c] + q[3] * found[3, i, c]
            )  # fmt: skip
    find_plain(strain, stress, weight, q, relax, natural, plain)
    if q[6] < 0.0 or q[7] < 0.0 or q[8] != 0.0 or q[9] != 0.0:
        plain[:] = 0.0


@inlined
def measure_in_lanes(strain, law, measure):
    """Strain in the law's measure and its derivatives, as `laws` has them, into (12, LANES)."""
    for c in range(LANES):
        if law == 1:
            e1, e2, e3 = 0.5 * (strain[0, c] - 1.0), 0.5 * (strain[1, c] - 1.0), strain[2, c]
            found = e1, e2, e3, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
        else:
            m, h = 0.5 * (strain[0, c] + strain[1, c]), 0.5 * (strain[0, c] - strain[1, c])
            k = strain[2, c]
            area, g, g_s, _ = _log_terms(m, h * h + k * k)
            found = log_strain(m, h, k, area, g, g_s)
        measure[0, c], measure[1, c], measure[2, c] = found[0], found[1], found[2]
        measure[3, c], measure[4, c], measure[5, c] = found[3], found[4], found[5]
        measure[6, c], measure[7, c], measure[8, c] = found[6], found[7], found[8]
        measure[9, c], measure[10, c], measure[11, c] = found[9], found[10], found[11]


@inlined
def stress_in_lanes(measure, weight, q, stress):
    """S (3) times a weight, of taut points whose strain is known, into (3, LANES)."""
    bent = q[8] != 0.0 or q[9] != 0.0
    for c in range(LANES):
        _, t1, t2, t3, _, _, _, _ = straight_potential(
            measure[0, c], measure[1, c], measure[2, c], q
        )
        t1, t2, t3 = weight[c] * t1, weight[c] * t2, weight[c] * t3
        for i in range(3):
            stress[i, c] = t1 * measure[3 + i, c] + t2 * measure[6 + i, c] + t3 * measure[9 + i, c]
    if bent:
        for c in range(LANES):
            _, t1, t2, _, _, _, _, _ = _bent_potential(measure[0, c], measure[1, c], q)
            t1, t2 = weight[c] * t1, weight[c] * t2
            for i in range(3):
                stress[i, c] += t1 * measure[3 + i, c] + t2 * measure[6 + i, c]


@inlined
def find_plain(strain, stress, weight, q, relax, natural, plain):
    """Tell the points that are taut and near the natural state."""
    for c in range(LANES):
        c11, c22, c12 = strain[0, c], strain[1, c], strain[2, c]
        m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
        s = h * h + c12 * c12
        u = _log_argument(m * m - s)
        near = (c11 > 0.0) & (m * m > s) & (s < _NEAR * m * m) & (u * u < _NEAR)
        loose = is_slack(c11, c22, c12, natural)
        loose |= is_compressed(stress[0, c], stress[1, c], stress[2, c], weight[c] * (q[0] + q[1]))
        plain[c] = 1.0 if near & (not (relax & loose)) else 0.0
