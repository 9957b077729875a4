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
    "put_in_lane",
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


@merged
def _svk(c11, c22, c12, q):
    """W, S (3) and CC (6) of Green's strain without bends."""
    psi, t1, t2, t3, h11, h22, h33, h12 = straight_potential(
        0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), c12, q
    )
    return psi, t1, t2, t3, h11, h22, h33, h12, 0.0, 0.0


@merged
def _svk_bends(c11, c22, c12, q):
    """What the bends add to `_svk`."""
    psi, t1, t2, t3, h11, h22, h33, h12 = _bent_potential(0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0), q)
    return psi, t1, t2, t3, h11, h22, h33, h12, 0.0, 0.0


@merged
def _hencky(c11, c22, c12, q):
    """W, S (3) and CC (6) of the logarithmic strain without bends."""
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    area, g, g_s, g_ss = _log_terms(m, h * h + c12 * c12)
    at = straight_potential(0.5 * (area + g * h), 0.5 * (area - g * h), g * c12, q)
    return pull_back(m, h, c12, g, g_s, g_ss, at)


@merged
def _hencky_bends(c11, c22, c12, q):
    """What the bends add to `_hencky`."""
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    area, g, g_s, g_ss = _log_terms(m, h * h + c12 * c12)
    at = _bent_potential(0.5 * (area + g * h), 0.5 * (area - g * h), q)
    return pull_back(m, h, c12, g, g_s, g_ss, at)


@merged
def put_in_lane(at, c, weight, found):
    """Lane c of at (10, lanes) becomes W, S (3) and CC (6), times the weight."""
    at[0, c], at[1, c], at[2, c] = weight * found[0], weight * found[1], weight * found[2]
    at[3, c], at[4, c], at[5, c] = weight * found[3], weight * found[4], weight * found[5]
    at[6, c], at[7, c], at[8, c] = weight * found[6], weight * found[7], weight * found[8]
    at[9, c] = weight * found[9]


@merged
def _add_in_lane(at, c, weight, found):
    """As `put_in_lane`, added to what is there."""
    at[0, c] += weight * found[0]
    at[1, c] += weight * found[1]
    at[2, c] += weight * found[2]
    at[3, c] += weight * found[3]
    at[4, c] += weight * found[4]
    at[5, c] += weight * found[5]
    at[6, c] += weight * found[6]
    at[7, c] += weight * found[7]
    at[8, c] += weight * found[8]
    at[9, c] += weight * found[9]


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
    bent = q[8] != 0.0 or q[9] != 0.0
    if law == 1:
        for c in range(LANES):
            put_in_lane(at, c, weight[c], _svk(strain[0, c], strain[1, c], strain[2, c], q))
        if bent:
            for c in range(LANES):
                found = _svk_bends(strain[0, c], strain[1, c], strain[2, c], q)
                _add_in_lane(at, c, weight[c], found)
    else:
        for c in range(LANES):
            put_in_lane(at, c, weight[c], _hencky(strain[0, c], strain[1, c], strain[2, c], q))
        if bent:
            for c in range(LANES):
                found = _hencky_bends(strain[0, c], strain[1, c], strain[2, c], q)
                _add_in_lane(at, c, weight[c], found)
    find_plain(strain, at[1:4], weight, q, relax, natural, plain)


@merged
def _svk_stiffness(c11, c22, c12, q):
    """∂(S11, S22, S12)/∂ each of D11, D22, D12, D33, of Green's strain."""
    e1, e2 = 0.5 * (c11 - 1.0) - q[4], 0.5 * (c22 - 1.0) - q[5]
    return (e1, 0.0, 0.0), (0.0, e2, 0.0), (e2, e1, 0.0), (0.0, 0.0, c12)


@merged
def _hencky_measure(c11, c22, c12):
    """The logarithmic strain and its derivatives, as `laws` has them."""
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    area, g, g_s, _ = _log_terms(m, h * h + c12 * c12)
    return log_strain(m, h, c12, area, g, g_s)


@merged
def _put_stiffness(found, stress, c, weight, by_d, q):
    """Lane c of found (4, 3, lanes), and of the stress (3, lanes) that they make."""
    d11, d22, d12, d33 = by_d
    found[0, 0, c], found[0, 1, c] = weight * d11[0], weight * d11[1]
    found[1, 0, c], found[1, 1, c] = weight * d22[0], weight * d22[1]
    found[2, 0, c], found[2, 1, c] = weight * d12[0], weight * d12[1]
    found[3, 0, c], found[3, 1, c] = weight * d33[0], weight * d33[1]
    found[0, 2, c], found[1, 2, c] = weight * d11[2], weight * d22[2]
    found[2, 2, c], found[3, 2, c] = weight * d12[2], weight * d33[2]
    stress[0, c] = weight * (q[0] * d11[0] + q[1] * d22[0] + q[2] * d12[0] + q[3] * d33[0])
    stress[1, c] = weight * (q[0] * d11[1] + q[1] * d22[1] + q[2] * d12[1] + q[3] * d33[1])
    stress[2, c] = weight * (q[0] * d11[2] + q[1] * d22[2] + q[2] * d12[2] + q[3] * d33[2])


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
            by_d = _svk_stiffness(strain[0, c], strain[1, c], strain[2, c], q)
            _put_stiffness(found, stress, c, weight[c], by_d, q)
    else:
        for c in range(LANES):
            by_d = by_stiffness(_hencky_measure(strain[0, c], strain[1, c], strain[2, c]), q)
            _put_stiffness(found, stress, c, weight[c], by_d, q)
    find_plain(strain, stress, weight, q, relax, natural, plain)
    if q[6] < 0.0 or q[7] < 0.0 or q[8] != 0.0 or q[9] != 0.0:
        plain[:] = 0.0


@inlined
def measure_in_lanes(strain, law, measure):
    """Strain in the law's measure and its derivatives, as `laws` has them, into (12, LANES)."""
    for c in range(LANES):
        c11, c22, c12 = strain[0, c], strain[1, c], strain[2, c]
        if law == 1:
            e1, e2 = 0.5 * (c11 - 1.0), 0.5 * (c22 - 1.0)
            found = e1, e2, c12, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
        else:
            found = _hencky_measure(c11, c22, c12)
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


@merged
def _is_plain(c11, c22, c12, s11, s22, s12, modulus, relax, natural):
    """True where a point is taut (stress and modulus times a weight) and near the natural state."""
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    s = h * h + c12 * c12
    u = _log_argument(m * m - s)
    near = (c11 > 0.0) & (m * m > s) & (s < _NEAR * m * m) & (u * u < _NEAR)
    loose = is_slack(c11, c22, c12, natural) | is_compressed(s11, s22, s12, modulus)
    return near & (not (relax & loose))


@inlined
def find_plain(strain, stress, weight, q, relax, natural, plain):
    """Tell the points that are taut and near the natural state."""
    for c in range(LANES):
        taut = _is_plain(
            strain[0, c], strain[1, c], strain[2, c], stress[0, c], stress[1, c], stress[2, c],
            weight[c] * (q[0] + q[1]), relax, natural,
        )  # fmt: skip
        plain[c] = 1.0 if taut else 0.0
