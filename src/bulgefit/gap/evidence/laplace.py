"""How well does a model do, over all values that its prior allows? Laplace's approximation.

With the misfit linear near a point (`Linearised`), nulls n and prior widths s, the posterior is
Gaussian with A = H + diag(1/s²), and with b = g - (x - n)/s²

    -2 ln Z = |r|² + Σ((x - n)/s)² - bᵀA⁻¹b + ln det A + 2 Σ ln s

up to a constant of the data (MacKay, 1992, "Bayesian interpolation", eq. 2.5 ff.). Coordinates that
end at a lower bound take only the share of either Gaussian above it. A smaller model needs no new
solve for its forecast: what it lacks is moved to the null in the normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr

from bulgefit.gap.evidence.orthant import log_share_above
from bulgefit.gap.evidence.problem import Columns, Layout, Linearised

__all__ = ["Laplace", "bounded_optimum", "inverted", "laplace", "quadratic"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Laplace:
    """A model's evidence and its optimum by one linear step.

    Attributes
    ----------
    score : float
        -2 ln Z.
    ahead : float
        Part of it that the linear step takes off.
    volume : float
        Part of it that the widths of posterior and prior make up, all of the posterior being above
        the bounds; elsewhere it is more.
    x : (n,) array
        All coordinates at the optimum; those out of the model at their null.
    covariance : (p, p) array
        Of the model's coordinates.
    """

    score: float
    ahead: float
    volume: float
    x: Floats
    covariance: Floats


def quadratic(here: Linearised, layout: Layout, columns: Columns) -> tuple[float, Floats, Floats]:
    """-2 ln(likelihood × prior) of a model near `here`: value, slope b and matrix A at its x.

    What `here` has derivatives by and the model lacks is moved to its null, or stays where it means
    nothing (`Layout.without`).
    """
    own = np.searchsorted(here.columns, columns)
    gone = np.setdiff1d(np.arange(len(here.columns)), own)
    lacked = here.columns[gone]
    change = layout.without(lacked, columns, here.x) - here.x[lacked]
    square = here.square - 2.0 * change @ here.gradient[gone]
    square += change @ here.hessian[np.ix_(gone, gone)] @ change
    gradient = here.gradient[own] - here.hessian[np.ix_(own, gone)] @ change
    away, width = layout.away(columns, here.x[columns]), layout.width[columns]
    value = square + (away**2).sum()
    slope = gradient - away / width
    matrix = here.hessian[np.ix_(own, own)] + np.diag(width**-2)
    return float(value), slope, matrix


def laplace(here: Linearised, layout: Layout, columns: Columns) -> Laplace:
    """Evidence of the model that frees `columns`, by the misfit near `here`."""
    value, slope, matrix = quadratic(here, layout, columns)
    width, lower = layout.width[columns], layout.lower[columns]
    covariance, log_det = inverted(matrix)
    step = covariance @ slope
    volume = log_det + 2.0 * np.log(width).sum()
    bound = np.flatnonzero(np.isfinite(lower))
    mean = here.x[columns] + step
    inside = 0.0
    if len(bound):
        inside = log_share_above(mean[bound], covariance[np.ix_(bound, bound)], lower[bound])
        volume += 2.0 * log_ndtr((layout.null[columns][bound] - lower[bound]) / width[bound]).sum()
    score = value - slope @ step + volume - 2.0 * inside
    x = np.array(layout.null)
    x[columns] = here.x[columns] + bounded_optimum(slope, matrix, lower - here.x[columns])
    return Laplace(float(score), float(slope @ step), float(volume), x, covariance)


def inverted(matrix: Floats) -> tuple[Floats, float]:
    """The inverse of a positive definite matrix whose units differ by decades, and its ln det."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    units = np.outer(scale, scale)
    factor = cho_factor(matrix * units, lower=True)
    log_det = 2.0 * (np.log(np.diag(factor[0])).sum() - np.log(scale).sum())
    return units * cho_solve(factor, np.eye(len(matrix))), float(log_det)


def bounded_optimum(slope: Floats, matrix: Floats, lower: Floats) -> Floats:
    """The step that minimises stepᵀA step - 2 bᵀstep where step ≥ lower, by active sets.

    Units may differ by decades: Cholesky's errors do not depend on them (Higham, 2002, "Accuracy
    and stability of numerical algorithms", section 10.1).

    Parameters
    ----------
    slope : (p,) array
        b.
    matrix : (p, p) array
        A, positive definite.
    lower : (p,) array
        -inf where there is no bound.
    """
    held = np.zeros(len(slope), dtype=bool)
    for _ in range(3 * int(np.isfinite(lower).sum()) + 1):
        free = ~held
        step = np.where(held, lower, 0.0)
        # equations of what is held say that it stays, so that none need be taken out
        right, left = np.where(held, lower, slope - matrix @ step), np.array(matrix, order="F")
        left[held], left[:, held], left[held, held] = 0.0, 0.0, 1.0
        step = cho_solve(cho_factor(left, lower=True, overwrite_a=True), right)
        below = free & (step < lower)
        if below.any():
            held |= below
            continue
        pull = slope - matrix @ step
        inwards = held & (pull > 0.0)
        if not inwards.any():
            break
        held[np.argmax(np.where(inwards, pull, -np.inf))] = False
    return np.maximum(step, lower)
