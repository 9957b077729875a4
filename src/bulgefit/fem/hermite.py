"""Hermite's interpolation between levels that carry values and slopes, with mirror images.

With Lagrange's basis l_i of the knots s_i, values weigh (1 - 2 (x - s_i) l_i'(s_i)) l_i² and slopes
(x - s_i) l_i².
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import compiled

__all__ = ["STENCIL", "combine", "hermite_weights", "stencil_at"]

Floats = NDArray[np.float64]

#: Levels in a stencil: values and slopes make a polynomial of degree 7.
STENCIL = 4

#: Parity of (dx, dy, dz) under blowing from the other side.
PARITY = np.array([1.0, 1.0, -1.0])


@compiled
def _first(knots: Floats, width: int, k: int) -> int:
    """First of the `width` consecutive knots closest to the interval between knots k and k + 1.

    The choice depends on the interval alone, so the dense output is continuous.
    """
    count = len(knots)
    if count <= width:
        return 0
    middle = 0.5 * (knots[k] + knots[k + 1])
    best, reach = 0, np.inf
    for i in range(max(0, k + 2 - width), min(k, count - width) + 1):
        far = max(middle - knots[i], knots[i + width - 1] - middle)
        if far < reach:
            best, reach = i, far
    return best


def _interval(knots: Floats, at: Floats) -> NDArray[np.int64]:
    """k of the knots k and k + 1 between which each of `at` lies; the ends' beyond them."""
    return np.asarray(np.searchsorted(knots[1:-1], at, side="right"))


@compiled
def _weigh(
    knots: Floats,
    images: int,
    stencil: int,
    at: Floats,
    interval: NDArray[np.int64],
    value: Floats,
    slope: Floats,
) -> None:
    """Add the weights at each of `at` to value and slope (3, k, levels).

    The first `images` knots are mirror images, from the highest level down. They fold back on
    their levels: u(-s) = ±u(s), ∂u/∂s(-s) = ∓∂u/∂s(s).
    """
    width = min(stencil, len(knots))
    for j in range(len(at)):
        first = _first(knots, width, interval[j])
        for a in range(first, first + width):
            basis, derivative = 1.0, 0.0
            for b in range(first, first + width):
                if b != a:
                    gap = knots[a] - knots[b]
                    basis *= (at[j] - knots[b]) / gap
                    derivative += 1.0 / gap
            away = at[j] - knots[a]
            of_value = (1.0 - 2.0 * away * derivative) * basis * basis
            of_slope = away * basis * basis
            for i in range(3):
                if a >= images:
                    value[i, j, a - images] += of_value
                    slope[i, j, a - images] += of_slope
                else:
                    value[i, j, images - 1 - a] += PARITY[i] * of_value
                    slope[i, j, images - 1 - a] -= PARITY[i] * of_slope


def _mirror(s: Floats, mirrored: bool, stencil: int) -> tuple[Floats, int]:
    """Levels with the mirror images that a stencil may need in front; how many those are."""
    images = min(len(s), stencil // 2) if mirrored else 0
    return np.concatenate([-s[:images][::-1], s]), images


def stencil_at(s: Floats, at: float, *, mirrored: bool) -> tuple[float, ...]:
    """The levels and mirror images that the dense output goes through at `at`."""
    knots, _ = _mirror(s, mirrored, STENCIL)
    first = _first(knots, STENCIL, int(_interval(knots, np.array(at))))
    return tuple(knots[first : first + STENCIL].tolist())


def hermite_weights(
    s: Floats, at: Floats, *, mirrored: bool, stencil: int = STENCIL
) -> tuple[Floats, Floats]:
    """Weights of level values and slopes in the dense output, each (3, k, levels).

    Parameters
    ----------
    s : (levels,) array
        Where the levels lie, ascending.
    at : (k,) array
        Where the output is wanted.
    mirrored : bool
        The levels have mirror images at -s.
    stencil : int
        Levels that one polynomial goes through.
    """
    knots, images = _mirror(s, mirrored, stencil)
    value, slope = np.zeros((2, 3, len(at), len(s)))
    _weigh(knots, images, stencil, at, _interval(knots, at), value, slope)
    return value, slope


def combine(weights: tuple[Floats, Floats], values: Floats, slopes: Floats) -> Floats:
    """Σ over levels of weights (3, k, levels) times values and slopes (levels, n, 3): (k, n, 3)."""
    both = np.concatenate(weights, axis=2)
    levels = np.concatenate([values, slopes])
    # the weights of dx and dy are the same: they have one parity
    out = both[0] @ levels.reshape(len(levels), -1)
    out = out.reshape(len(out), *levels.shape[1:])
    out[:, :, 2] = both[2] @ levels[:, :, 2]
    return out
