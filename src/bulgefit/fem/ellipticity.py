"""Is the law elliptic at a shape? Where it is not, nothing keeps the fabric from bands of shear.

Strong ellipticity of the membrane in its surface: with A = ∂P/∂F, every change of F that has rank
one costs energy to second order, m·(N·A·N)·m > 0 for all unit N in the reference and m in the
surface (Knowles and Sternberg, 1976, "On the failure of ellipticity of the equations for finite
elastostatic plane strain"). With m = F ξ and Z_ik = N_j CC_ijkl N_l,

    m·(N·A·N)·m = (N·S·N) ξ·C·ξ + ξ·C Z C·ξ,

so the least of it over unit m is N·S·N + the lower eigenvalue of Z C. Changes that leave the
surface cost N·S·N, which relaxation keeps from being negative.
"""

from __future__ import annotations

import math

import numpy as np

from bulgefit.fem.jit import compiled, merged
from bulgefit.fem.relaxation import respond

__all__ = ["ROUNDING", "acoustic_margin", "least_margin", "point_margin"]

#: A margin over D11 + D22 that is no loss: a wrinkle's energy is flat in one direction, and its
#: condensed tangent is as exact as 1e-12.
ROUNDING = 1e-9

#: Directions N that are tried over a half turn before the lowest is refined.
_DIRECTIONS = 36
#: Golden sections: two steps of the directions shrink to 1e-9.
_SECTIONS = 40
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@merged
def _along(angle, c11, c22, c12, at):
    """The least of m·(N·A·N)·m over unit m, MPa, for N at an angle from the warp axis."""
    n1, n2 = math.cos(angle), math.sin(angle)
    x, y, xy = n1 * n1, n2 * n2, n1 * n2
    z11 = at[4] * x + 2.0 * at[8] * xy + at[6] * y
    z22 = at[6] * x + 2.0 * at[9] * xy + at[5] * y
    z12 = at[8] * x + (at[7] + at[6]) * xy + at[9] * y
    trace = z11 * c11 + z22 * c22 + 2.0 * z12 * c12
    det = (z11 * z22 - z12 * z12) * (c11 * c22 - c12 * c12)
    tension = at[1] * x + at[2] * y + 2.0 * at[3] * xy
    return tension + 0.5 * (trace - math.sqrt(max(trace * trace - 4.0 * det, 0.0)))


@merged
def acoustic_margin(c11, c22, c12, at):
    """The least of m·(N·A·N)·m over unit N and m at a point: elliptic where positive.

    Parameters
    ----------
    c11, c22, c12 : float
        Right Cauchy-Green tensor in material axes.
    at : tuple of 10
        W, S and CC there.

    Returns
    -------
    margin : float, MPa
    angle : float, rad
        Of N from the warp axis.
    """
    step = math.pi / _DIRECTIONS
    lowest, best = math.inf, 0.0
    for i in range(_DIRECTIONS):
        value = _along(i * step, c11, c22, c12, at)
        if value < lowest:
            lowest, best = value, i * step
    low, high = best - step, best + step
    for _ in range(_SECTIONS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if _along(left, c11, c22, c12, at) < _along(right, c11, c22, c12, at):
            high = right
        else:
            low = left
    angle = 0.5 * (low + high)
    value = _along(angle, c11, c22, c12, at)
    return (value, angle) if value < lowest else (lowest, best)


@compiled
def point_margin(c11, c22, c12, q, law, relax):
    """`acoustic_margin` of a law at C: margin (MPa) and angle (rad); NaN where C collapses."""
    state, at = respond(c11, c22, c12, q, law, relax)
    if state < 0:
        return np.nan, np.nan
    return acoustic_margin(c11, c22, c12, at)


@merged
def _is_convex(at):
    """True where S bears no compression and CC is positive definite: elliptic without a search."""
    s11, s22, s12, a, b, c, d, e, f = at[1:]
    first = a * b - d * d
    det = c * first - (a * f * f - 2.0 * d * e * f + b * e * e)
    tense = (s11 >= 0.0) & (s22 >= 0.0) & (s11 * s22 >= s12 * s12)
    return tense & (a > 0.0) & (first > 0.0) & (det > 0.0)


@compiled
def least_margin(x, cells, gradient, q, law, relax, enough):
    """The lowest `acoustic_margin` over the Gauss points of a shape.

    Parameters
    ----------
    x : (n, 3) array, mm
    cells : (m, 4) int array
    gradient : (m, 4, 4, 2) array, 1/mm
    q, law, relax
        As `relaxation.point_response` takes them.
    enough : float, MPa
        The search ends at the first point whose margin is below it.

    Returns
    -------
    margin : float, MPa
        Infinite where the strain energy is convex at every point; NaN where a cell has collapsed,
        unless the search has ended before.
    cell : int
        Where it is lowest; -1 where it is infinite.
    """
    lowest, where = np.inf, -1
    for k in range(len(cells)):
        for g in range(4):
            c11, c22, c12 = 0.0, 0.0, 0.0
            for i in range(3):
                u, v = 0.0, 0.0
                for a in range(4):
                    u += x[cells[k, a], i] * gradient[k, g, a, 0]
                    v += x[cells[k, a], i] * gradient[k, g, a, 1]
                c11, c22, c12 = c11 + u * u, c22 + v * v, c12 + u * v
            state, at = respond(c11, c22, c12, q, law, relax)
            if state < 0:
                return np.nan, k
            if not _is_convex(at):
                margin, _ = acoustic_margin(c11, c22, c12, at)
                if margin < lowest:
                    lowest, where = margin, k
                    if lowest < enough:
                        return lowest, where
    return lowest, where
