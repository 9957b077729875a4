"""What does a strain cost? The potential ψ(e) that the laws share, each with a strain of its own.

ψ is quadratic in the elastic strain, strain less slack, and along warp and fill the stress may
have a gain, a bend and a curve. Voigt order is 11, 22, 12, strains with engineering shear.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import merged

__all__ = [
    "KNOTS",
    "PARAMETERS",
    "bent_potential",
    "by_stiffness",
    "coupled",
    "energy",
    "is_bent",
    "potential",
    "straight_potential",
]

#: Elastic strains at which a curve's slope is given; between them it is linear, beyond constant.
KNOTS = (0.0, 0.005, 0.01, 0.02, 0.03, 0.05, 0.08)

#: The entries of the tuple q that a law gets, 1 along warp and 2 along fill: stiffness (MPa), slack
#: (1), gains (MPa), bends (MPa), knees (1), the curves' slopes at the knots over the modulus (MPa),
#: what couples shear with extension (MPa), and the strains at which gains end (1).
PARAMETERS = (
    *("D11", "D22", "D12", "D33"),
    *("slack_1", "slack_2", "gain_1", "gain_2", "bend_1", "bend_2", "knee_1", "knee_2"),
    *(f"curve_{axis}_{knot}" for axis in (1, 2) for knot in range(len(KNOTS))),
    *("D13", "D23", "spent_1", "spent_2"),
)

#: A bend's arctangent and logarithm: halvings by roots, after which so many terms leave 1e-17 for
#: strains of up to 200 times the knee.
_HALVED, _LOG_HALVED, _BEND_TERMS = 3, 5, 12
_TURNS, _LOGS = 2.0**_HALVED, 2.0 ** (_LOG_HALVED + 1)


def energy(e: NDArray[Any], q: tuple[float, ...]) -> NDArray[Any]:
    """ψ (MPa) of strains e11, e22, 2 e12 (3, ...), real or complex."""
    d11, d22, d12, d33, *_ = q
    x, y = e[0] - q[4], e[1] - q[5]
    psi = 0.5 * (d11 * x**2 + d22 * y**2 + d33 * e[2] ** 2) + d12 * x * y
    psi = psi + (q[26] * x + q[27] * y) * e[2]
    for axis, along in enumerate((x, y)):
        gain, bend, knee, curve = q[6 + axis], q[8 + axis], q[10 + axis], q[12 + 7 * axis :][:7]
        t = np.where(along.real > 0.0, along, 0.0)
        spent = q[28 + axis]
        on, beyond = np.where(t.real < spent, t, spent), np.where(t.real < spent, 0.0, t - spent)
        psi = psi + gain * (on**3 / 3.0 + on**2 * beyond + on * beyond**2)
        r = t / knee
        psi = psi + bend * knee**2 * (0.5 * r**2 - r * np.arctan(r) + 0.5 * np.log(1.0 + r**2))
        psi = psi + 0.5 * curve[0] * along**2
        for start, end, low, high in zip(KNOTS, KNOTS[1:], curve, curve[1:], strict=False):
            u, v = along - start, along - end
            ramps = np.where(u.real > 0.0, u, 0.0) ** 3 - np.where(v.real > 0.0, v, 0.0) ** 3
            psi = psi + (high - low) / (end - start) * ramps / 6.0
    return psi


@merged
def straight_potential(e1, e2, e3, q):
    """Potential, stress T = ∂ψ/∂e and stiffness H = ∂²ψ/∂e² of the strain (e11, e22, 2 e12).

    `potential` without its bends, curves and couplings.
    """
    e1, e2 = e1 - q[4], e2 - q[5]
    t1 = q[0] * e1 + q[2] * e2
    t2 = q[2] * e1 + q[1] * e2
    t3 = q[3] * e3
    psi = 0.5 * (t1 * e1 + t2 * e2 + t3 * e3)
    p1, p2 = min(max(e1, 0.0), q[28]), min(max(e2, 0.0), q[29])
    b1, b2 = max(e1 - q[28], 0.0), max(e2 - q[29], 0.0)
    psi += (q[6] * p1 * p1 * p1 + q[7] * p2 * p2 * p2) / 3.0
    psi += q[6] * p1 * b1 * (p1 + b1) + q[7] * p2 * b2 * (p2 + b2)
    t1 += q[6] * p1 * p1 + 2.0 * q[6] * p1 * b1
    t2 += q[7] * p2 * p2 + 2.0 * q[7] * p2 * b2
    return psi, t1, t2, t3, q[0] + 2.0 * q[6] * p1, q[1] + 2.0 * q[7] * p2, q[3], q[2]


@merged
def potential(e1, e2, e3, q):
    """Potential, stress T = ∂ψ/∂e and stiffness H = ∂²ψ/∂e² of the strain (e11, e22, 2 e12).

    Elastic strain e - slack. Along warp and fill, in tension, the stress gains a E e², up to the
    strain at which a gain that softens is spent, so that the stress goes on rising; where
    a coating or crimp gives way, s E (e - κ atan(e/κ)): the slope goes from E to (1 + s) E, half
    of the way at the knee κ. A curve's slope is linear between the knots, so the stress is smooth.
    What couples shear with extension is in T; in H it is left to `coupled`.

    `q` holds what `PARAMETERS` names.
    """
    psi, t1, t2, t3, h1, h2, h3, h12 = straight_potential(e1, e2, e3, q)
    if q[8] != 0.0 or q[9] != 0.0:
        psi_1, bent_1, slope_1 = _knee(max(e1 - q[4], 0.0), q[10])
        psi_2, bent_2, slope_2 = _knee(max(e2 - q[5], 0.0), q[11])
        psi += q[8] * psi_1 + q[9] * psi_2
        t1, h1 = t1 + q[8] * bent_1, h1 + q[8] * slope_1
        t2, h2 = t2 + q[9] * bent_2, h2 + q[9] * slope_2
    if _is_curved(q):
        psi_1, curved_1, slope_1 = _curve_1(e1, q)
        psi_2, curved_2, slope_2 = _curve_2(e2, q)
        psi += psi_1 + psi_2
        t1, h1 = t1 + curved_1, h1 + slope_1
        t2, h2 = t2 + curved_2, h2 + slope_2
    along = q[26] * (e1 - q[4]) + q[27] * (e2 - q[5])
    return psi + along * e3, t1 + q[26] * e3, t2 + q[27] * e3, t3 + along, h1, h2, h3, h12


@merged
def coupled(found, measure, q):
    """W, S and CC with ∂²ψ/∂e∂γ of what couples shear with extension.

    Parameters
    ----------
    found : tuple of 10
        Without them.
    measure : tuple of 12
        Strain and, row by row, ∂e_i/∂E_j.
    """
    _, _, _, p11, p12, p13, p21, p22, p23, p31, p32, p33 = measure
    u1, u2, u3 = q[26] * p11 + q[27] * p21, q[26] * p12 + q[27] * p22, q[26] * p13 + q[27] * p23
    w, s1, s2, s3, c11, c22, c33, c12, c13, c23 = found
    return (
        w, s1, s2, s3,
        c11 + 2.0 * u1 * p31, c22 + 2.0 * u2 * p32, c33 + 2.0 * u3 * p33,
        c12 + (u1 * p32 + p31 * u2), c13 + (u1 * p33 + p31 * u3), c23 + (u2 * p33 + p32 * u3),
    )  # fmt: skip


@merged
def _knee(e, knee):
    """Integral, e - κ atan(e/κ), and its slope e²/(e² + κ²)."""
    x = e / knee
    turned = math.atan(x)
    return (
        knee * knee * (0.5 * x * x - x * turned + 0.5 * math.log1p(x * x)),
        knee * (x - turned),
        x * x / (1.0 + x * x),
    )


@merged
def _bend(e, knee):
    """`_knee` without calls.

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
def bent_potential(e1, e2, e3, q):
    """What bends, curves and couplings add to `straight_potential`, without calls or branches."""
    psi_1, bent_1, slope_1 = _bend(max(e1 - q[4], 0.0), q[10])
    psi_2, bent_2, slope_2 = _bend(max(e2 - q[5], 0.0), q[11])
    psi_3, curved_1, rise_1 = _curve_1(e1, q)
    psi_4, curved_2, rise_2 = _curve_2(e2, q)
    along = q[26] * (e1 - q[4]) + q[27] * (e2 - q[5])
    return (
        q[8] * psi_1 + q[9] * psi_2 + psi_3 + psi_4 + along * e3,
        q[8] * bent_1 + curved_1 + q[26] * e3, q[9] * bent_2 + curved_2 + q[27] * e3, along,
        q[8] * slope_1 + rise_1, q[9] * slope_2 + rise_2, 0.0, 0.0,
    )  # fmt: skip


@merged
def _is_curved(q):
    """Whether a curve has another slope than the modulus anywhere."""
    warp = abs(q[12]) + abs(q[13]) + abs(q[14]) + abs(q[15]) + abs(q[16]) + abs(q[17]) + abs(q[18])
    fill = abs(q[19]) + abs(q[20]) + abs(q[21]) + abs(q[22]) + abs(q[23]) + abs(q[24]) + abs(q[25])
    return warp + fill != 0.0


@merged
def is_bent(q):
    """Whether the stress is more than `straight_potential`."""
    return q[8] != 0.0 or q[9] != 0.0 or q[26] != 0.0 or q[27] != 0.0 or _is_curved(q)


@merged
def _curve_1(e1, q):
    return _curve(e1 - q[4], q[12], q[13], q[14], q[15], q[16], q[17], q[18])


@merged
def _curve_2(e2, q):
    return _curve(e2 - q[5], q[19], q[20], q[21], q[22], q[23], q[24], q[25])


@merged
def _curve(e, s0, s1, s2, s3, s4, s5, s6):
    """Energy, stress and slope of a curve with these slopes at the knots; s0 in compression."""
    w1, t1, h1 = _ramp(e, KNOTS[0], KNOTS[1], s0, s1)
    w2, t2, h2 = _ramp(e, KNOTS[1], KNOTS[2], s1, s2)
    w3, t3, h3 = _ramp(e, KNOTS[2], KNOTS[3], s2, s3)
    w4, t4, h4 = _ramp(e, KNOTS[3], KNOTS[4], s3, s4)
    w5, t5, h5 = _ramp(e, KNOTS[4], KNOTS[5], s4, s5)
    w6, t6, h6 = _ramp(e, KNOTS[5], KNOTS[6], s5, s6)
    return (
        0.5 * s0 * e * e + w1 + w2 + w3 + w4 + w5 + w6,
        s0 * e + t1 + t2 + t3 + t4 + t5 + t6,
        s0 + h1 + h2 + h3 + h4 + h5 + h6,
    )


@merged
def _ramp(e, start, end, low, high):
    """Energy, stress and slope of what rises by high - low from start to end."""
    width = end - start
    rate = (high - low) / width
    on, beyond = min(max(e - start, 0.0), width), max(e - end, 0.0)
    return (
        rate * (on * on * on / 6.0 + 0.5 * width * beyond * (width + beyond)),
        rate * (0.5 * on * on + width * beyond),
        rate * on,
    )


@merged
def by_stiffness(strain, q):
    """∂(S11, S22, S12)/∂ each of D11, D22, D12, D33, at a strain and its derivatives (12)."""
    e1, e2, e3, p11, p12, p13, p21, p22, p23, p31, p32, p33 = strain
    e1, e2 = e1 - q[4], e2 - q[5]
    return (
        (e1 * p11, e1 * p12, e1 * p13),
        (e2 * p21, e2 * p22, e2 * p23),
        (e2 * p11 + e1 * p21, e2 * p12 + e1 * p22, e2 * p13 + e1 * p23),
        (e3 * p31, e3 * p32, e3 * p33),
    )
