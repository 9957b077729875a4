"""The share of a Gaussian that lies above lower bounds, also far out in its tail.

Expectation propagation (Minka, 2001, "Expectation propagation for approximate Bayesian inference";
Cunningham, Hennig and Lacoste-Julien, 2011, "Gaussian probabilities and expectation propagation"):
each bound is replaced by a Gaussian factor that gives the same mass, mean and variance beside the
others. Exact for one bound, and for bounds on independent variables.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

__all__ = ["log_share_above"]

Floats = NDArray[np.float64]

#: Rounds over all bounds; the change of a factor's precision (relative) at which they are settled.
_ROUNDS, _SETTLED = 200, 1e-10
#: Standard deviations above a bound from which less than rounding lies below it.
_FAR = 8.5


def log_share_above(mean: Floats, covariance: Floats, lower: Floats) -> float:
    """Logarithm of the probability that x > lower for x normal.

    Parameters
    ----------
    mean, lower : (k,) array
    covariance : (k, k) array
    """
    scale = np.sqrt(np.diag(covariance))
    near = mean - lower < _FAR * scale
    if not near.any():
        return 0.0
    scale, covariance = scale[near], covariance[np.ix_(near, near)]
    centre = (mean - lower)[near] / scale
    prior = covariance / np.outer(scale, scale)
    pull = np.linalg.solve(prior, centre)
    precision, shift = np.zeros(len(centre)), np.zeros(len(centre))
    for _ in range(_ROUNDS):
        before = precision.copy()
        spread = np.linalg.inv(np.linalg.inv(prior) + np.diag(precision))
        for i in range(len(centre)):
            own, at = spread[i, i], spread[i] @ (pull + shift)
            rest = 1.0 / own - precision[i]
            push = at / own - shift[i]
            _, first, second = _cut(push / rest, 1.0 / rest)
            known = precision[i]
            precision[i] = max(1.0 / second - rest, 0.0)
            shift[i] = first * (precision[i] + rest) - push
            # a factor of one variable changes the inverse by a product (Sherman and Morrison, 1950)
            more = precision[i] - known
            spread = spread - more / (1.0 + more * own) * np.outer(spread[:, i], spread[i])
        if np.abs(precision - before).max() <= _SETTLED * max(1.0, precision.max()):
            break
    return _mass(centre, prior, precision, shift)


def _cut(mean: float, variance: float) -> tuple[float, float, float]:
    """Log mass, mean and variance of a normal variable above zero."""
    root = np.sqrt(variance)
    z = mean / root
    mass = float(log_ndtr(z))
    ratio = float(np.exp(-0.5 * z * z - 0.5 * np.log(2 * np.pi) - mass))
    # far below zero 1 - ratio (z + ratio) is a difference of large numbers; it goes to 1/z²
    left = 1.0 - ratio * (z + ratio) if z > -30.0 else (1.0 - 6.0 / z**2) / z**2
    first = mean + root * ratio if z > -1e4 else -variance / mean
    return mass, first, variance * left


def _mass(centre: Floats, prior: Floats, precision: Floats, shift: Floats) -> float:
    """Log mass of the Gaussian times the factors, each scaled to its bound's mass."""
    inverse = np.linalg.inv(prior)
    whole = inverse + np.diag(precision)
    spread = np.linalg.inv(whole)
    at = spread @ (inverse @ centre + shift)
    total = -0.5 * np.linalg.slogdet(prior)[1] - 0.5 * np.linalg.slogdet(whole)[1]
    total += 0.5 * at @ whole @ at - 0.5 * centre @ inverse @ centre
    for i in range(len(centre)):
        rest = 1.0 / spread[i, i] - precision[i]
        push = at[i] / spread[i, i] - shift[i]
        mass, _, _ = _cut(push / rest, 1.0 / rest)
        total += mass - 0.5 * np.log(rest / (rest + precision[i]))
        total += 0.5 * push**2 / rest - 0.5 * (push + shift[i]) ** 2 / (rest + precision[i])
    return float(total)
