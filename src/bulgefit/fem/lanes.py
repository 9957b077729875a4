"""The laws at many material points at once, one in each lane of the processor's vectors.

Almost every point of a blown membrane is taut and moderately stretched. There the laws need no
branches, and with series for the logarithms no calls, so the compiler takes several points at a
time. Points that are not so plain are told apart, and left to `relaxation.respond`, and so are all
points of a law that has no functions for the lanes.

Bends, curves and couplings of the stress are added where there are any: W, S and CC are linear in
the potential and its derivatives by strain.
"""

from __future__ import annotations

from bulgefit.fem.jit import inlined, merged
from bulgefit.fem.laws.logarithm import NEAR, log_argument
from bulgefit.fem.laws.potential import bent_potential, is_bent, straight_potential
from bulgefit.fem.relaxation import TAUT, is_compressed, is_slack, respond

__all__ = [
    "LANES",
    "find_plain",
    "measure_in_lanes",
    "respond_at_points",
    "stiffness_in_lanes",
    "stress_in_lanes",
]

#: Points that are taken together: arrays have them last, and the innermost loops run over them.
#: With fewer of them LLVM unrolls these loops instead.
LANES = 16


@merged
def _put_in_lane(at, c, weight, found):
    """Lane c of at (10, lanes) becomes W, S (3) and CC (6), times the weight."""
    at[0, c], at[1, c], at[2, c] = weight * found[0], weight * found[1], weight * found[2]
    at[3, c], at[4, c], at[5, c] = weight * found[3], weight * found[4], weight * found[5]
    at[6, c], at[7, c], at[8, c] = weight * found[6], weight * found[7], weight * found[8]
    at[9, c] = weight * found[9]


@merged
def _add_in_lane(at, c, weight, found):
    """As `_put_in_lane`, added to what is there."""
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
def _respond_in_lanes(strain, weight, q, law, relax, natural, at, plain):
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
    if law.vectorised:
        for c in range(LANES):
            found = law.straight_in_lanes(strain[0, c], strain[1, c], strain[2, c], q)
            _put_in_lane(at, c, weight[c], found)
        if is_bent(q):
            for c in range(LANES):
                found = law.bends_in_lanes(strain[0, c], strain[1, c], strain[2, c], q)
                _add_in_lane(at, c, weight[c], found)
        find_plain(strain, at[1:4], weight, q, relax, natural, plain)
    else:
        plain[:] = 0.0


@inlined
def respond_at_points(strain, weight, count, q, law, relax, natural, at, plain):
    """W, S (3) and CC (6), times a weight, of the first `count` lanes, plain or not.

    Parameters are those of `_respond_in_lanes`.

    Returns
    -------
    relaxed : int
        How many are in tension-field relaxation; -1 where one has no response.
    """
    _respond_in_lanes(strain, weight, q, law, relax, natural, at, plain)
    relaxed = 0
    for c in range(count):
        if plain[c] == 0.0:
            state, found = respond(strain[0, c], strain[1, c], strain[2, c], q, law, relax)
            if state < 0:
                return -1
            relaxed += state != TAUT
            _put_in_lane(at, c, weight[c], found)
    return relaxed


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
    """∂S/∂(D11, D22, D12, D33) times a weight, of points that are plain.

    Parameters
    ----------
    found : (4, 3, LANES) array
        Overwritten.
    stress : (3, LANES) array
        Overwritten with S times the weight, as far as it is due to D. Positive gains only add
        tension, the logarithm being operator monotone; with others, or bends, no point is plain.
    """
    for c in range(LANES):
        by_d = law.by_stiffness_in_lanes(strain[0, c], strain[1, c], strain[2, c], q)
        _put_stiffness(found, stress, c, weight[c], by_d, q)
    find_plain(strain, stress, weight, q, relax, natural, plain)
    if q[6] < 0.0 or q[7] < 0.0 or is_bent(q):
        plain[:] = 0.0


@inlined
def measure_in_lanes(strain, law, measure):
    """Strain in the law's measure and its derivatives, as `laws` has them, into (12, LANES)."""
    for c in range(LANES):
        found = law.measure_in_lanes(strain[0, c], strain[1, c], strain[2, c])
        measure[0, c], measure[1, c], measure[2, c] = found[0], found[1], found[2]
        measure[3, c], measure[4, c], measure[5, c] = found[3], found[4], found[5]
        measure[6, c], measure[7, c], measure[8, c] = found[6], found[7], found[8]
        measure[9, c], measure[10, c], measure[11, c] = found[9], found[10], found[11]


@inlined
def stress_in_lanes(measure, weight, q, stress):
    """S (3) times a weight, of taut points whose strain is known, into (3, LANES)."""
    for c in range(LANES):
        _, t1, t2, t3, _, _, _, _ = straight_potential(
            measure[0, c], measure[1, c], measure[2, c], q
        )
        t1, t2, t3 = weight[c] * t1, weight[c] * t2, weight[c] * t3
        for i in range(3):
            stress[i, c] = t1 * measure[3 + i, c] + t2 * measure[6 + i, c] + t3 * measure[9 + i, c]
    if is_bent(q):
        for c in range(LANES):
            _, t1, t2, t3, _, _, _, _ = bent_potential(
                measure[0, c], measure[1, c], measure[2, c], q
            )
            t1, t2, t3 = weight[c] * t1, weight[c] * t2, weight[c] * t3
            for i in range(3):
                stress[i, c] += (
                    t1 * measure[3 + i, c] + t2 * measure[6 + i, c] + t3 * measure[9 + i, c]
                )


@merged
def _is_plain(c11, c22, c12, s11, s22, s12, modulus, relax, natural):
    """True where a point is taut (stress and modulus times a weight) and near the natural state."""
    m, h = 0.5 * (c11 + c22), 0.5 * (c11 - c22)
    s = h * h + c12 * c12
    u = log_argument(m * m - s)
    near = (c11 > 0.0) & (m * m > s) & (s < NEAR * m * m) & (u * u < NEAR)
    loose = is_slack(c11, c22, c12, natural) | is_compressed(s11, s22, s12, modulus)
    return near & (not (relax & loose))


@inlined
def find_plain(strain, stress, weight, q, relax, natural, plain):
    """Tell the points that are taut and near the natural state, where the lanes' series hold."""
    for c in range(LANES):
        taut = _is_plain(
            strain[0, c], strain[1, c], strain[2, c], stress[0, c], stress[1, c], stress[2, c],
            weight[c] * (q[0] + q[1]), relax, natural,
        )  # fmt: skip
        plain[c] = 1.0 if taut else 0.0
