"""Descend from one start: Gauss-Newton on the residuals, or any scipy minimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear, minimize

from bulgefit.errors import one_of
from bulgefit.fitting.problem import Evaluation, Problem

__all__ = ["GAUSS_NEWTON", "METHODS", "Descent", "Limits", "Stop", "check_method", "descend"]

Floats = NDArray[np.floating]

GAUSS_NEWTON = "gauss-newton"

#: Residuals below these parts of their mean size weigh alike, one after the other in a step.
ROUNDINGS = (1e-1, 1e-2, 1e-3)
#: Reweightings for each of them.
ITERATIONS = 12
#: Part of its standard error by which a step of a likelihood, or of a fit that is polished, may
#: still promise to move a parameter once it has converged.
FINELY = 0.01
#: Part of the objective by which two solves of nearly the same material may differ.
SOLVER_NOISE = 1e-4

#: Steps in a row that move no parameter by this part of its error, after which a descent creeps
#: along a valley in which the data tell no place from another.
CREEPING, SLOWLY = 3, 0.1

#: scipy minimisers that use a gradient and bounds; others are called without a gradient.
_WITH_GRADIENT = ("L-BFGS-B", "TNC", "SLSQP", "trust-constr")
_WITHOUT_GRADIENT = ("Nelder-Mead", "Powell", "COBYLA", "COBYQA")
_OF_SCIPY = {name.lower(): name for name in (*_WITH_GRADIENT, *_WITHOUT_GRADIENT)}
METHODS = (GAUSS_NEWTON, *_WITH_GRADIENT, *_WITHOUT_GRADIENT)


class Stop(Enum):
    """Why a descent stopped."""

    FLAT = "converged: no step lowers the linearised objective"
    SHORT = "converged: steps are below the parameter tolerance"
    RESOLVED = "converged: steps are below what the solver resolves"
    CREEPING = "converged: steps change no parameter by more than a part of its error"
    LIMIT = "evaluation limit reached"
    NO_START = "no equilibrium from this start"
    FAILED = "every evaluation failed"

    def because(self, why: str) -> str:
        """With what brought it about."""
        return f"{self.value}: {why}"


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
    parameter_change: float = 1e-7


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

    def evaluate(self, z: Floats, *, derivatives: bool) -> Evaluation:
        """Evaluate within the limit, and remember."""
        if len(self.history) >= self.limits.evaluations:
            raise _LimitReached
        evaluation = self.problem.evaluate(z, derivatives=derivatives)
        slim = Evaluation(evaluation.values, evaluation.value, evaluation.error)
        self.history.append(slim)
        if np.isfinite(evaluation.value):
            self.worst = max(self.worst, evaluation.value)
            if evaluation.value < self.best.value:
                self.best = slim
        return evaluation

    def told(self, evaluation: Evaluation) -> float:
        """Value to tell the minimiser; for a failure the study's rule: the worst so far."""
        return evaluation.value if np.isfinite(evaluation.value) else self.worst

    def with_gradient(self, z: Floats) -> tuple[float, Floats]:
        evaluation = self.evaluate(np.clip(z, 0.0, 1.0), derivatives=True)
        slope = np.zeros(self.problem.size) if evaluation.slope is None else evaluation.slope
        return self.told(evaluation), slope

    def value_only(self, z: Floats) -> float:
        return self.told(self.evaluate(np.clip(z, 0.0, 1.0), derivatives=False))


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
        reason, converged = Stop.LIMIT.because(f"{recorder.limits.evaluations} paths"), False
    best = recorder.best
    if not best.values:
        best = Evaluation(problem.values(start), float("nan"), recorder.history[-1].error)
        reason, converged = Stop.FAILED.because(best.error), False
    return Descent(problem.values(start), best, reason, converged, recorder.history)


def check_method(method: str) -> None:
    """Refuse a method that is unknown; large and small letters are alike. InputError."""
    if method != GAUSS_NEWTON and method.lower() not in _OF_SCIPY:
        one_of(method, METHODS, "method")


def _scipy(method: str) -> Callable[[_Recorder, Floats], tuple[str, bool]]:
    check_method(method)
    name = _OF_SCIPY[method.lower()]

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
    current = recorder.evaluate(z, derivatives=True)
    while not np.isfinite(current.value):
        # a start without equilibrium: half way to the stiff end, where there is one
        stiff = problem.scattered
        if not len(stiff) or z[stiff].min() > 0.99:
            return Stop.NO_START.because(current.error), False
        z[stiff] = 0.5 * (z[stiff] + 1.0)
        current = recorder.evaluate(z, derivatives=True)
    model = _Model(problem, current, z)
    in_vain, creeping = 0, 0
    while True:
        step, expected = model.minimise(radius)
        length = float(np.abs(step).max())
        enough = limits.objective_change * current.value
        if problem.objective.squared or problem.all_data:
            enough = min(enough, problem.fall_by(FINELY, current.value))
        if expected <= enough:
            return Stop.FLAT.value, True
        if length <= limits.parameter_change:
            return Stop.SHORT.value, True
        trial = np.clip(z + step, 0.0, 1.0)
        new = recorder.evaluate(trial, derivatives=True)
        ratio = (current.value - recorder.told(new)) / expected
        if ratio > 0.0:
            slow = current.value - new.value < problem.fall_by(SLOWLY, new.value)
            creeping = creeping + 1 if slow else 0
            z, current, in_vain = trial, new, 0
            if creeping == CREEPING:
                return Stop.CREEPING.value, True
            model = _Model(problem, current, z)
        else:
            # promises as small as the solver's own error cannot be kept
            in_vain += expected <= SOLVER_NOISE * current.value
            if in_vain == 2 or length <= 10 * limits.parameter_change:
                return Stop.RESOLVED.value, True
        if ratio < 0.25:
            radius = 0.3 * length
        elif ratio > 0.7:
            radius = max(radius, 2.5 * length)


class _Model:
    """The objective near an evaluation, with its residuals linear in the coordinates.

    Its curvature may come from a sample of the data, its value and slope are those of all data:
    F + (g - g_sample) d + F_sample(d) - F_sample(0). What is believed beforehand is a quadratic
    that joins it; where it raises F, the fall that is promised is of what is raised.
    """

    def __init__(self, problem: Problem, at: Evaluation, z: Floats) -> None:
        assert at.slope is not None
        assert at.rows is not None
        self.z, self.rows = z, at.rows
        # weighed by what the data leave, not by the priors' own share of the value
        self.believed, pull = problem.pull(at.rows.value(), z)
        self.raised = problem.raised(z)
        self.linear = at.slope / self.raised - at.rows.slope() if problem.all_data else pull
        self.base = self.rows.value()
        # mm, however the components are weighed
        self.typical = self.base / float(self.rows.scale.sum())

    def minimise(self, radius: float) -> tuple[Floats, float]:
        """Step in the trust region and the bounds, and the fall it promises, mm.

        Iteratively reweighted least squares, with corners of |r| rounded off ever less.
        """
        low, high = np.maximum(-radius, -self.z), np.minimum(radius, 1.0 - self.z)
        # a range that the bounds have closed stays open by a hair for the bounded solver
        low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
        step: Floats = np.zeros(len(self.z))
        best, most = step, 0.0
        for rounding in ROUNDINGS:
            for _ in range(ITERATIONS):
                hessian, gradient = self.rows.normal(step, rounding * self.typical)
                linear = gradient - hessian @ step + self.linear
                new = _bounded_newton(hessian + self.believed, linear, low, high)
                moved = float(np.abs(new - step).max())
                step = new
                if moved <= 1e-3 * max(float(np.abs(step).max()), 1e-6):
                    break
            added = float(self.linear @ step + 0.5 * step @ self.believed @ step)
            fall = self.base - self.rows.value(step) - added
            if fall > most:
                best, most = step, fall
        return best, self.raised * most


def _bounded_newton(hessian: Floats, linear: Floats, low: Floats, high: Floats) -> Floats:
    """Minimise ½ dᵀHd + linearᵀd within bounds."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    scaled = hessian * np.outer(scale, scale) + 1e-12 * np.eye(len(linear))
    root = np.linalg.cholesky(scaled)
    right = np.linalg.solve(root, -linear * scale)
    found = lsq_linear(root.T, right, bounds=(low / scale, high / scale), method="bvls")
    return np.clip(found.x * scale, low, high)
