"""From a start to the most probable values of a model: Gauss-Newton under Gaussian priors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.evidence.laplace import bounded_optimum, laplace, quadratic
from bulgefit.gap.evidence.problem import Layout, Linearised, Model, Problem

__all__ = ["Fit", "descend"]

Floats = NDArray[np.float64]

STEPS = 40
#: What a step must promise to be worth a solve, on the scale of -2 ln Z, where 1 is nothing.
_SETTLED = 0.05
#: Prior widths by which a first step may move any coordinate, and where no step is left.
_REACH, _LEAST_REACH = 2.0, 1e-6
#: Share of the reach that a step is to use, and tries to find a damping by which it does.
_USED, _HALVINGS = 0.7, 30


@dataclass(frozen=True, eq=False)
class Fit:
    """A model at its most probable values.

    Attributes
    ----------
    model : Model
    here : Linearised
        By the model's coordinates, where the descent ended.
    score : float
        -2 ln Z by Laplace's approximation there.
    covariance : (p, p) array
        Of the model's coordinates.
    converged : bool
    steps : int
        Solves that it took.
    """

    model: Model
    here: Linearised
    score: float
    covariance: Floats
    converged: bool
    steps: int

    @property
    def x(self) -> Floats:
        """All coordinates."""
        return self.here.x


def descend(
    problem: Problem,
    layout: Layout,
    model: Model,
    start: Floats,
    near: Any = None,
    steps: int = STEPS,
) -> Fit:
    """Minimise |r|²/v + Σ((x - n)/s)² over a model's coordinates.

    Steps are held within a trust region of the prior's metric: no coordinate moves by more than so
    many of its prior widths at once, and what the data say little of stays (Levenberg's damping).
    That is a continuation in the prior's width. The region shrinks where a step leads uphill, or
    where nothing balances, and grows where the misfit is as linear as it was taken for (Nocedal and
    Wright, 2006, "Numerical optimization", algorithm 4.1).

    Parameters
    ----------
    problem : Problem
    layout : Layout
    model : Model
    start : (n,) array
        What is not in the model goes to its null.
    near : object, optional
        Of a neighbouring `Linearised`.
    steps : int
        Most solves.

    Raises
    ------
    SolveError
        Nothing balances at the start.
    """
    columns = layout.columns(model)
    x = np.array(layout.null)
    x[columns] = np.maximum(start[columns], layout.lower[columns])
    here = problem.linearise(x, columns, near)
    reach, converged, taken = _REACH, False, 1
    while taken < steps and reach > _LEAST_REACH:
        value, slope, matrix = quadratic(here, layout, columns, problem.inflation)
        step = _step(slope, matrix, layout, here, reach)
        promised = 2.0 * slope @ step - step @ matrix @ step
        size = float(np.abs(step / layout.width[columns]).max(initial=0.0))
        if promised < _SETTLED:
            converged = size < _USED * reach
            break
        there = _stepped(problem, here, step)
        taken += 1
        gained = -np.inf
        if there is not None:
            gained = value - quadratic(there, layout, columns, problem.inflation)[0]
        if gained < 0.25 * promised:
            reach = 0.3 * size
        elif gained > 0.75 * promised and size > _USED * reach:
            reach *= 3.0
        if there is not None and gained > 0.0:
            here = there
    found = laplace(here, layout, columns, problem.inflation)
    return Fit(model, here, found.score, found.covariance, converged, taken)


def _step(slope: Floats, matrix: Floats, layout: Layout, here: Linearised, reach: float) -> Floats:
    """The step to the optimum, or as far as the trust region lets it."""
    columns = here.columns
    width = layout.width[columns]
    lower = (layout.lower[columns] - here.x[columns]) / width
    push, scaled = slope * width, matrix * np.outer(width, width)

    def damped(damping: float) -> Floats:
        return bounded_optimum(push, scaled + damping * np.eye(len(push)), lower)

    step = damped(0.0)
    if np.abs(step).max(initial=0.0) <= reach:
        return step * width
    # damping of |b|/reach is enough; halve its logarithm's range until most of the reach is used
    low, high = 1e-8, float(np.linalg.norm(push)) / reach
    step = damped(high)
    for _ in range(_HALVINGS):
        between = np.sqrt(low * high)
        ahead = damped(between)
        if np.abs(ahead).max() > reach:
            low = between
            continue
        high, step = between, ahead
        if np.abs(step).max() > _USED * reach:
            break
    return step * width


def _stepped(problem: Problem, here: Linearised, step: Floats) -> Linearised | None:
    """The point a step ahead; None where nothing balances there."""
    x = np.array(here.x)
    x[here.columns] += step
    try:
        return problem.linearise(x, here.columns, here.near)
    except (SolveError, InputError):
        return None
