"""What does a membrane do that cannot bear compression? It wrinkles, or goes slack.

Relaxation (tension field): a fabric has no stiffness in compression. The relaxed energy is the
least over wrinkles, W_r(C) = min_a W(C + a⊗a), and zero where C fits inside the natural state
(Pipkin, 1994, "Relaxed energy densities for large deformations of membranes"). At the minimum
S a = 0: uniaxial tension. Its tangent is the condensation of a from the Hessian.
"""

from __future__ import annotations

import math

from bulgefit.fem.jit import compiled, merged

__all__ = [
    "BALANCED",
    "SLACK",
    "TAUT",
    "WRINKLED",
    "is_compressed",
    "is_slack",
    "point_response",
    "respond",
    "stress_sensitivity",
]

TAUT, WRINKLED, SLACK = 0, 1, 2

#: Stress along a wrinkle, over D11 + D22, that is none.
BALANCED = 1e-13
#: Of a compression over D11 + D22 that is none: a wrinkle is found to a thousandth of it.
_NO_STRESS = 1e-10
#: Directions of a wrinkle that are tried over a half turn where the first one does not do.
_DIRECTIONS = 36
#: Unit vectors over a half turn, and one more at either end, by this angle apart.
_APART = math.pi / 12
_WAYS = tuple((math.cos(k * _APART), math.sin(k * _APART)) for k in range(-1, 13))

#: W, S and CC of a point without stress.
_NOTHING = (0.0,) * 10


@merged
def is_slack(c11, c22, c12, natural):
    """True where C0 - C is positive semidefinite, C0 the natural state: nothing is stretched."""
    left1, left2 = natural[0] - c11, natural[1] - c22
    return (left1 >= 0.0) & (left2 >= 0.0) & (left1 * left2 >= c12 * c12)


@merged
def is_compressed(s11, s22, s12, modulus):
    """True where the lower principal stress is negative, beyond rounding."""
    slight = 1e-13 * modulus
    s11, s22 = s11 + slight, s22 + slight
    return (s11 < 0.0) | (s22 < 0.0) | (s11 * s22 < s12 * s12)


@merged
def _along(n1, n2, q, at):
    """Snn and CCnnnn (MPa) along a unit vector n."""
    v1, v2, v3 = n1 * n1, n2 * n2, n1 * n2
    snn = at[1] * v1 + at[2] * v2 + 2.0 * at[3] * v3
    cnn = (
        at[4] * v1 * v1 + at[5] * v2 * v2 + 4.0 * at[6] * v3 * v3
        + 2.0 * at[7] * v1 * v2 + 4.0 * at[8] * v1 * v3 + 4.0 * at[9] * v2 * v3
    )  # fmt: skip
    return snn, max(cnn, 1e-12 * q[3])


@merged
def _worth(n1, n2, q, at):
    """Twice the energy (MPa) that a wrinkle along n frees, to first order of the stress.

    With ΔE = ½ a⊗a, W + S ΔE + ½ ΔE CC ΔE is least over the amplitude |a|: by ½ Snn²/CCnnnn,
    where n is compressed. Below zero in tension.
    """
    snn, cnn = _along(n1, n2, q, at)
    return -snn * abs(snn) / cnn


@merged
def _amplitude(n1, n2, c11, c22, c12, q, law, at):
    """The amplitude of that wrinkle; zero in tension.

    To first order |a|² is -2 Snn/CCnnnn. Of a logarithmic strain along n, e = ln λ with λ² = Cnn,
    that is too little by far where compression is great: Snn = T/λ² and CCnnnn = (H - 2 T)/λ⁴ of a
    stress T with the slope H, which is nothing after Δe = -T/H, so that |a|² = λ² (exp 2Δe - 1).
    """
    snn, cnn = _along(n1, n2, q, at)
    if law.logarithmic and snn < 0.0:
        long = c11 * n1 * n1 + c22 * n2 * n2 + 2.0 * c12 * n1 * n2
        slope = cnn * long + 2.0 * snn
        if -snn < slope:  # up to e-fold: far from there nothing is linear
            twice = -2.0 * snn / slope
            # Padé's exp x - 1, to 6 % at most
            return math.sqrt(long * twice / (1.0 + twice * (twice / 12.0 - 0.5)))
    return math.sqrt(2.0 * max(-snn, 0.0) / cnn)


@merged
def _most_compressed(at):
    """The unit vector along which S is least."""
    h, k = 0.5 * (at[1] - at[2]), at[3]
    r = math.hypot(h, k)
    n1, n2 = (-k, h + r) if h > 0.0 else (h - r, k)
    size = math.hypot(n1, n2)
    return (n1 / size, n2 / size) if size > 0.0 else (1.0, 0.0)


@merged
def _by_tangent(q, at):
    """The unit vector along which a wrinkle frees the most energy to first order of the stress.

    Of stiff and soft yarns it is not along the greatest compression: it may be a right angle off.
    """
    most, best = -math.inf, 0
    for i in range(1, len(_WAYS) - 1):
        worth = _worth(_WAYS[i][0], _WAYS[i][1], q, at)
        if worth > most:
            most, best = worth, i
    before = _worth(_WAYS[best - 1][0], _WAYS[best - 1][1], q, at)
    after = _worth(_WAYS[best + 1][0], _WAYS[best + 1][1], q, at)
    bend = 2.0 * most - before - after
    # on to the top of a parabola through the three
    turn = 0.5 * _APART * (after - before) / bend if bend > 0.0 else 0.0
    size = math.sqrt(1.0 + turn * turn)
    n1, n2 = (_WAYS[best][0] - turn * _WAYS[best][1], _WAYS[best][1] + turn * _WAYS[best][0])
    n1, n2 = n1 / size, n2 / size
    # slight compression is all between two of the directions
    m1, m2 = _most_compressed(at)
    return (m1, m2) if _worth(m1, m2, q, at) > _worth(n1, n2, q, at) else (n1, n2)


@merged
def _start(c11, c22, c12, q, law, flat):
    """A wrinkle to start from, and the response there.

    As the tangent says. Where both yarns are short, one that brings both to their natural lengths
    leaves but shear; where that is soft, next to nothing.
    """
    n1, n2 = _by_tangent(q, flat)
    amplitude = _amplitude(n1, n2, c11, c22, c12, q, law, flat)
    a1, a2 = amplitude * n1, amplitude * n2
    at = law.response(c11 + a1 * a1, c22 + a2 * a2, c12 + a1 * a2, q)
    natural = law.natural(q)
    lack1, lack2 = natural[0] - c11, natural[1] - c22
    if lack1 > 0.0 and lack2 > 0.0:
        b1, b2 = math.copysign(math.sqrt(lack1), -c12), math.sqrt(lack2)
        other = law.response(c11 + b1 * b1, c22 + b2 * b2, c12 + b1 * b2, q)
        if other[0] < at[0]:
            return b1, b2, other
    return a1, a2, at


@merged
def _lowest(c11, c22, c12, q, law, flat):
    """The same: the wrinkle of the least energy over directions all round.

    Along each by what frees it to first order, and by what brings it to its natural length, which
    of great strains is the better guess.
    """
    natural = law.natural(q)
    lowest, a1, a2, at = math.inf, 0.0, 0.0, flat
    for i in range(_DIRECTIONS):
        angle = i * math.pi / _DIRECTIONS
        n1, n2 = math.cos(angle), math.sin(angle)
        short = (natural[0] - c11) * n1 * n1 + (natural[1] - c22) * n2 * n2 - 2.0 * c12 * n1 * n2
        freed = _amplitude(n1, n2, c11, c22, c12, q, law, flat)
        for amplitude in (freed, math.sqrt(max(short, 0.0))):
            b1, b2 = amplitude * n1, amplitude * n2
            other = law.response(c11 + b1 * b1, c22 + b2 * b2, c12 + b1 * b2, q)
            if amplitude > 0.0 and other[0] < lowest:
                lowest, a1, a2, at = other[0], b1, b2, other
    return a1, a2, at


@merged
def _wrinkle(c11, c22, c12, q, law, a1, a2, at):
    """Minimise W(C + a⊗a) over a by Newton's method, from a wrinkle and its response.

    Returns
    -------
    converged : bool
    a1, a2 : float
    at : tuple
        `Law.response` at the minimum.
    """
    scale = q[0] + q[1]
    # from a ridge between two minima it takes some sixty steps to leave it
    for _ in range(150):
        r1 = at[1] * a1 + at[3] * a2
        r2 = at[3] * a1 + at[2] * a2
        norm_a = math.sqrt(a1 * a1 + a2 * a2)
        if math.sqrt(r1 * r1 + r2 * r2) <= BALANCED * scale * norm_a:
            return True, a1, a2, at
        m11, m22, m12 = _wrinkle_hessian(a1, a2, at)
        # Newton only where the Hessian is positive definite, else with a shift by which its lower
        # eigenvalue has the absolute value that it has: so steps along a ridge are no shorter
        mean, half = 0.5 * (m11 + m22), 0.5 * (m11 - m22)
        apart = math.sqrt(half * half + m12 * m12)
        low, high = mean - apart, mean + apart
        least = 1e-9 * abs(high)
        shift = max(-2.0 * low, least - low) if low <= least else 0.0
        m11, m22 = m11 + shift, m22 + shift
        det = m11 * m22 - m12 * m12
        d1 = -(m22 * r1 - m12 * r2) / det
        d2 = -(m11 * r2 - m12 * r1) / det
        energy = at[0]
        slope = r1 * d1 + r2 * d2
        step = 1.0
        for _ in range(30):
            b1, b2 = a1 + step * d1, a2 + step * d2
            at = law.response(c11 + b1 * b1, c22 + b2 * b2, c12 + b1 * b2, q)
            # strains carry a rounding error of 1e-16, and the energy with them and of its own
            rounding = 1e-16 * math.sqrt(scale * abs(energy)) + 1e-15 * abs(energy)
            if at[0] <= energy + 1e-4 * step * slope + rounding:
                break
            # a step that frees no more is judged by the slopes at its ends (Hager and Zhang, 2005)
            end = d1 * (at[1] * b1 + at[3] * b2) + d2 * (at[3] * b1 + at[2] * b2)
            if -slope <= rounding and abs(end) <= -slope:
                break
            step *= 0.5
        a1, a2 = b1, b2
        if step * math.sqrt(d1 * d1 + d2 * d2) <= 1e-12 * norm_a:
            return True, a1, a2, at
    return False, a1, a2, at


@merged
def _wrinkle_stiffness(a1, a2, at):
    """CC B with B = ∂E/∂a of E + ½ a⊗a: its columns for a1 and a2, each (3,)."""
    return (
        at[4] * a1 + at[8] * a2, at[7] * a1 + at[9] * a2, at[8] * a1 + at[6] * a2,
        at[7] * a2 + at[8] * a1, at[5] * a2 + at[9] * a1, at[9] * a2 + at[6] * a1,
    )  # fmt: skip


@merged
def _wrinkle_hessian(a1, a2, at):
    """∂²W/∂a∂a = S + BᵀCC B: components 11, 22, 12."""
    x1, y1, z1, _, y2, z2 = _wrinkle_stiffness(a1, a2, at)
    return at[1] + a1 * x1 + a2 * z1, at[2] + a2 * y2 + a1 * z2, at[3] + a2 * y1 + a1 * z1


@merged
def _softness(a1, a2, at):
    """A wrinkle's direction n and |a|² times the inverse of ∂²W/∂a∂a at the minimum.

    There S n = 0, so that S is s t⊗t with t across n and s its trace: without what rounding leaves
    of S n, which a small wrinkle would magnify, ∂²W/∂a∂a over |a|² is BᵀCC B of n plus s/|a|² t⊗t.

    Returns
    -------
    n1, n2 : float
        Zero where there is no wrinkle.
    i11, i22, i12 : float, 1/MPa
    """
    size = math.hypot(a1, a2)
    if size == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    n1, n2 = a1 / size, a2 / size
    x1, y1, z1, _, y2, z2 = _wrinkle_stiffness(n1, n2, at)
    held = max(at[1] + at[2], 0.0) / (size * size)
    m11 = n1 * x1 + n2 * z1 + held * n2 * n2
    m22 = n2 * y2 + n1 * z2 + held * n1 * n1
    m12 = n2 * y1 + n1 * z1 - held * n1 * n2
    det = m11 * m22 - m12 * m12
    return n1, n2, m22 / det, m11 / det, -m12 / det


@merged
def _condense(a1, a2, at):
    """`at` with the wrinkle taken out of the tangent: CC - CC B (∂²W/∂a²)⁻¹ Bᵀ CC."""
    n1, n2, i11, i22, i12 = _softness(a1, a2, at)
    x1, y1, z1, x2, y2, z2 = _wrinkle_stiffness(n1, n2, at)
    return (
        at[0], at[1], at[2], at[3],
        at[4] - (i11 * x1 * x1 + i22 * x2 * x2 + 2.0 * i12 * x1 * x2),
        at[5] - (i11 * y1 * y1 + i22 * y2 * y2 + 2.0 * i12 * y1 * y2),
        at[6] - (i11 * z1 * z1 + i22 * z2 * z2 + 2.0 * i12 * z1 * z2),
        at[7] - (i11 * x1 * y1 + i22 * x2 * y2 + i12 * (x1 * y2 + x2 * y1)),
        at[8] - (i11 * x1 * z1 + i22 * x2 * z2 + i12 * (x1 * z2 + x2 * z1)),
        at[9] - (i11 * y1 * z1 + i22 * y2 * z2 + i12 * (y1 * z2 + y2 * z1)),
    )  # fmt: skip


@merged
def _relaxed(c11, c22, c12, q, law, flat):
    """State, wrinkle (a1, a2) and response there of a compressed point; not condensed.

    From its response `flat` without a wrinkle.

    Where D12 is above D11 or D22 and shear is stiff, W has another minimum over a, at which what
    is left of the stress is compression across the wrinkle; or the way to the minimum is too long.
    """
    state, a1, a2, at = -1, 0.0, 0.0, flat
    for again in (False, True):
        if again:
            a1, a2, at = _lowest(c11, c22, c12, q, law, flat)
        else:
            a1, a2, at = _start(c11, c22, c12, q, law, flat)
        converged, a1, a2, at = _wrinkle(c11, c22, c12, q, law, a1, a2, at)
        state = WRINKLED if converged else -1
        if converged and at[1] + at[2] >= -_NO_STRESS * (q[0] + q[1]):
            break
    return state, a1, a2, at


@merged
def respond(c11, c22, c12, q, law, relax):
    """State of a material point, and W, S (3), CC (6), as `point_response` explains them."""
    if not c11 * c22 - c12 * c12 > 0.0 or not c11 > 0.0:
        return -1, _NOTHING
    if relax and is_slack(c11, c22, c12, law.natural(q)):
        return SLACK, _NOTHING
    at = law.response(c11, c22, c12, q)
    if not relax or not is_compressed(at[1], at[2], at[3], q[0] + q[1]):
        return TAUT, at
    state, a1, a2, at = _relaxed(c11, c22, c12, q, law, at)
    return state, _condense(a1, a2, at)


@compiled
def point_response(c11, c22, c12, q, law, relax, out):
    """Energy, stress and tangent of a material point.

    Parameters
    ----------
    c11, c22, c12 : float
        Right Cauchy-Green tensor in material axes.
    q : tuple of floats
        As `laws.potential.PARAMETERS` names them. A tuple, whose length the compiler checks; an
        array that is too short would be read past its end.
    law : Law
    relax : bool
        Tension-field relaxation.
    out : (10,) array
        Filled with W; S11, S22, S12; CC11, CC22, CC33, CC12, CC13, CC23 (MPa).

    Returns
    -------
    state : int
        TAUT, WRINKLED or SLACK; -1 where C is not positive definite.
    """
    state, at = respond(c11, c22, c12, q, law, relax)
    for i in range(10):
        out[i] = at[i]
    return state


@merged
def stress_sensitivity(c11, c22, c12, q, law, relax):
    """∂S/∂D at fixed C for the four stiffness components.

    With e the elastic strain and P = ∂e/∂E, S = Pᵀ D e. The stress is linear in D at the wrinkled
    state C* = C + a⊗a, which itself moves with D: ∂S_r/∂D = S_D - CC B (∂²W/∂a²)⁻¹ Bᵀ S_D.

    Returns
    -------
    state : int
        As `point_response`.
    sensitivity : tuple of 4 tuples
        ∂(S11, S22, S12)/∂ each of D11, D22, D12, D33, 1.
    """
    zero = (0.0, 0.0, 0.0)
    nothing = (zero, zero, zero, zero)
    if not c11 * c22 - c12 * c12 > 0.0 or not c11 > 0.0:
        return -1, nothing
    if relax and is_slack(c11, c22, c12, law.natural(q)):
        return SLACK, nothing
    at = law.response(c11, c22, c12, q)
    if relax and is_compressed(at[1], at[2], at[3], q[0] + q[1]):
        state, a1, a2, at = _relaxed(c11, c22, c12, q, law, at)
        found = law.by_stiffness(c11 + a1 * a1, c22 + a2 * a2, c12 + a1 * a2, q)
        return state, (
            _take_out(a1, a2, at, found[0]),
            _take_out(a1, a2, at, found[1]),
            _take_out(a1, a2, at, found[2]),
            _take_out(a1, a2, at, found[3]),
        )
    return TAUT, law.by_stiffness(c11, c22, c12, q)


@merged
def _take_out(a1, a2, at, stress):
    """A change of stress at fixed wrinkle, less what the wrinkle's own change relieves."""
    n1, n2, i11, i22, i12 = _softness(a1, a2, at)
    x1, y1, z1, x2, y2, z2 = _wrinkle_stiffness(n1, n2, at)
    s1, s2, s3 = stress
    r1, r2 = s1 * n1 + s3 * n2, s3 * n1 + s2 * n2
    d1, d2 = i11 * r1 + i12 * r2, i12 * r1 + i22 * r2
    return s1 - x1 * d1 - x2 * d2, s2 - y1 * d1 - y2 * d2, s3 - z1 * d1 - z2 * d2
