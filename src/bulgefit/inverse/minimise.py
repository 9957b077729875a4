"""Descend from one start: Gauss-Newton on the absolute residuals, or any scipy minimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear, minimize

from bulgefit.errors import InputError
from bulgefit.inverse.problem import Evaluation, Problem

__all__ = ["GAUSS_NEWTON", "Descent", "Limits", "descend"]

Floats = NDArray[np.floating]

GAUSS_NEWTON = "gauss-newton"

#: scipy minimisers that use a gradient and bounds; others are called without a gradient.
_WITH_GRADIENT = ("L-BFGS-B", "TNC", "SLSQP", "trust-constr")
_WITHOUT_GRADIENT = ("Nelder-Mead", "Powell", "COBYLA", "COBYQA")


@dataclass(frozen=True)
class Limits:
    """When a descent stops.

    Attributes
    ----------
    evaluations : int
        Forward solves of one start.
    objective_change : float
        Relative decrease of the objective below which it has converged.
    parameter_change : float
        Step below which it has converged, as a part of the range between the bounds.
    """

    evaluations: int = 100
    objective_change: float = 1e-6
    parameter_change: float = 1e-5


@dataclass(eq=False)
class Descent:
    """What one start did.

    Attributes
    ----------
    start : dict of str to float
    best : Evaluation
        Without fields.
    reason : str
        Why it stopped.
    converged : bool
    history : list of Evaluation
        Every evaluation in order, failures included.
    """

    start: dict[str, float]
    best: Evaluation
    reason: str = ""
    converged: bool = False
    history: list[Evaluation] = field(default_factory=list)

    @property
    def failures(self) -> int:
        """Evaluations whose solve failed."""
        return sum(not np.isfinite(e.value) for e in self.history)


class _LimitReached(Exception):
    """The evaluation limit, thrown through a scipy minimiser."""


class _Recorder:
    """Evaluates, counts, keeps the best, and answers failures with the worst value so far."""

    def __init__(self, problem: Problem, limits: Limits) -> None:
        self.problem, self.limits = problem, limits
        self.history: list[Evaluation] = []
        self.worst = problem.worst()
        self.best = Evaluation({}, float("inf"))
        self.best_z: Floats = np.zeros(problem.size)

    def record(self, z: Floats, evaluation: Evaluation) -> float:
        """Value to tell the minimiser: the study's rule for a failure."""
        slim = Evaluation(evaluation.values, evaluation.value, evaluation.error)
        self.history.append(slim)
        if not np.isfinite(evaluation.value):
            return self.worst
        self.worst = max(self.worst, evaluation.value)
        if evaluation.value < self.best.value:
            self.best, self.best_z = slim, z.copy()
        return evaluation.value

    def check_limit(self) -> None:
        if len(self.history) >= self.limits.evaluations:
            raise _LimitReached

    def with_gradient(self, z: Floats) -> tuple[float, Floats]:
        self.check_limit()
        evaluation, slope = self.problem.gradient(np.clip(z, 0.0, 1.0))
        return self.record(z, evaluation), slope

    def value_only(self, z: Floats) -> float:
        self.check_limit()
        return self.record(z, self.problem.evaluate(np.clip(z, 0.0, 1.0)))


def descend(
    problem: Problem, start: Floats, method: str = GAUSS_NEWTON, limits: Limits | None = None
) -> Descent:
    """Minimise from coordinates `start`.

    Parameters
    ----------
    problem : Problem
    start : (free,) array in [0, 1]
    method : str
        "gauss-newton" or the name of a scipy minimiser that takes bounds.
    limits : Limits, optional

    Raises
    ------
    InputError
        Unknown method.
    """
    recorder = _Recorder(problem, limits or Limits())
    runner = _gauss_newton if method == GAUSS_NEWTON else _scipy(method)
    try:
        reason, converged = runner(recorder, start)
    except _LimitReached:
        reason, converged = f"evaluation limit ({recorder.limits.evaluations}) reached", False
    best = recorder.best
    if not best.values:
        best = Evaluation(problem.values(start), float("nan"), recorder.history[-1].error)
        reason, converged = f"every evaluation failed; the last: {best.error}", False
    return Descent(problem.values(start), best, reason, converged, recorder.history)


def _scipy(method: str) -> Callable[[_Recorder, Floats], tuple[str, bool]]:
    names = {m.lower(): m for m in (*_WITH_GRADIENT, *_WITHOUT_GRADIENT)}
    if method.lower() not in names:
        raise InputError(
            f"method: {method!r} is unknown; choose from {GAUSS_NEWTON}, "
            + ", ".join((*_WITH_GRADIENT, *_WITHOUT_GRADIENT))
        )
    name = names[method.lower()]

    def run(recorder: _Recorder, start: Floats) -> tuple[str, bool]:
        exact = name in _WITH_GRADIENT
        options = {"ftol": recorder.limits.objective_change} if name == "L-BFGS-B" else {}
        found = minimize(
            recorder.with_gradient if exact else recorder.value_only,
            start,
            jac=exact or None,
            method=name,
            bounds=[(0.0, 1.0)] * recorder.problem.size,
            options=options,
        )
        return str(found.message), bool(found.success)

    return run


def _gauss_newton(recorder: _Recorder, start: Floats) -> tuple[str, bool]:
    """Sequence of linearised L1 problems in a trust region (Osborne and Watson, 1971).

    Each step minimises Σ scale |r + J d| within the bounds and the trust region; it is taken
    where the true objective falls.
    """
    problem, limits = recorder.problem, recorder.limits
    z, radius = start.copy(), 0.5
    current = problem.evaluate(z, derivatives=True)
    recorder.record(z, current)
    while not np.isfinite(current.value):
        # a start without equilibrium: half way to the stiff end, where there is one
        recorder.check_limit()
        z = 0.5 * (z + 1.0)
        current = problem.evaluate(z, derivatives=True)
        recorder.record(z, current)
        if z.min() > 0.99:
            return f"no equilibrium from this start: {current.error}", False
    while True:
        step, predicted = _linearised_step(problem, current, z, radius)
        expected = current.value - predicted
        if expected <= limits.objective_change * current.value:
            return "converged: no step lowers the linearised objective", True
        if np.abs(step).max() <= limits.parameter_change:
            return "converged: steps are below the parameter tolerance", True
        recorder.check_limit()
        trial = np.clip(z + step, 0.0, 1.0)
        new = problem.evaluate(trial, derivatives=True)
        told = recorder.record(trial, new)
        ratio = (current.value - told) / expected
        if ratio > 0.0:
            z, current = trial, new
        elif np.abs(step).max() <= 10 * limits.parameter_change:
            return "converged: steps are below what the solver resolves", True
        length = float(np.abs(step).max())
        if ratio < 0.25:
            radius = 0.3 * length
        elif ratio > 0.7:
            radius = max(radius, 2.5 * length)


def _linearised_step(
    problem: Problem, at: Evaluation, z: Floats, radius: float
) -> tuple[Floats, float]:
    """Step that minimises the linearised objective, and the value it promises, mm.

    Iteratively reweighted least squares; residuals below a hundredth of the objective weigh
    alike, which rounds the corners of |r| off.
    """
    assert at.fields is not None
    columns = problem.columns(z)
    low, high = np.maximum(-radius, -z), np.minimum(radius, 1.0 - z)
    # a range that the bounds have closed stays open by a hair for the bounded solver
    low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    step: Floats = np.zeros(problem.size)
    best, best_value = step, at.value
    for _ in range(12):
        hessian, gradient, value = problem.objective.normal(
            at.fields, step, columns, floor=0.01 * at.value
        )
        if value < best_value:
            best, best_value = step, value
        new = _bounded_newton(hessian, gradient - hessian @ step, low, high)
        moved = float(np.abs(new - step).max())
        step = new
        if moved <= 1e-3 * max(float(np.abs(step).max()), 1e-6):
            break
    return best, best_value


def _bounded_newton(hessian: Floats, linear: Floats, low: Floats, high: Floats) -> Floats:
    """Minimise ½ dᵀHd + linearᵀd within bounds."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = hessian * np.outer(scale, scale) + 1e-12 * np.eye(len(linear))
    root = np.linalg.cholesky(scaled)
    right = np.linalg.solve(root, -linear * scale)
    found = lsq_linear(root.T, right, bounds=(low / scale, high / scale), method="bvls")
    return np.clip(found.x * scale, low, high)
