"""From a start to the most probable values of a model: Gauss-Newton under Gaussian priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.evidence.brink import ROUNDS, SHARE, LostStabilityError, bounded_within
from bulgefit.gap.evidence.laplace import bounded_optimum, laplace, quadratic
from bulgefit.gap.evidence.problem import Columns, Layout, Linearised, Model, Problem
from bulgefit.gap.evidence.sides import best_side, idle

__all__ = ["Fit", "descend"]

Floats = NDArray[np.float64]

STEPS = 40
#: What a step must promise or gain to be worth a solve, on the scale of -2 ln Z, where the noise is
#: all there is (`_misfit`): with less no combination of parameters is off by more than a quarter of
#: its standard error.
_SETTLED = 0.05
#: Prior widths by which a first step may move any coordinate, and where no step is left.
_REACH, _LEAST_REACH = 2.0, 1e-6
#: Share of the reach that a step is to use, and tries to find a damping by which it does.
_USED, _HALVINGS = 0.7, 30
#: Corrections of a landing by the derivatives of the start, as long as each is shorter than this
#: share of the one before, in prior widths (0.75 is Transtrum and Sethna's).
_CORRECTIONS, _CONTRACTED = 3, 0.75
#: Of what a brink lets a step do, what a step may leave over or go beyond that goes as far.
_HELD = 0.05
#: Points in a row from which the gains would not lead down to what is hoped: at one alone they may
#: just have been large.
_HOPELESS = 2


@dataclass(frozen=True, eq=False)
class Fit:
    """A model at its most probable values.

    Attributes
    ----------
    model : Model
    here : Linearised
        By the model's coordinates, where the descent ended.
    score : float
        -2 ln of Z, by Laplace's approximation there, times the model's probability before any data
        (`Layout.believed`); of a descent that did not converge, as if where it ended were the most
        probable.
    covariance : (p, p) array
        Of the model's coordinates.
    converged : bool
    steps : int
        Points with derivatives that it took.
    given_up : bool
        It was on its way to more than was hoped of it.
    short : float
        Standard errors by which the combination of parameters that is worst off lies away from the
        optimum that derivatives promise; 0 of a descent that converged.
    """

    model: Model
    here: Linearised
    score: float
    covariance: Floats
    converged: bool
    steps: int
    given_up: bool = False
    short: float = 0.0

    @property
    def x(self) -> Floats:
        """All coordinates."""
        return self.here.x

    def lighter(self, problem: Problem) -> Fit:
        """The same without what only makes a neighbour's solve sooner."""
        return replace(self, here=replace(self.here, near=problem.lighter(self.here.near)))

    def rounded(self, problem: Problem) -> Fit:
        """The same with what a neighbour starts from in fewer digits."""
        return replace(self, here=replace(self.here, near=problem.rounded(self.here.near)))


def descend(
    problem: Problem,
    layout: Layout,
    model: Model,
    start: Floats,
    near: Any = None,
    steps: int = STEPS,
    *,
    roughly: bool = False,
    share: float = 0.0,
    hope: float | None = None,
    doubted: bool = False,
) -> Fit:
    """Minimise |r|² + Σ((x - n)/s)² over a model's coordinates.

    Steps are held within a trust region of the prior's metric: no coordinate moves by more than so
    many of its prior widths at once, and what the data say little of stays (Levenberg's damping).
    That is a continuation in the prior's width. The region shrinks where a step leads uphill, or
    where nothing balances, and grows where the misfit is as linear as it was taken for (Nocedal and
    Wright, 2006, "Numerical optimization", algorithm 4.1).

    What coordinates hardly tell apart makes a narrow valley, and the valley is bent: a straight
    step ends on its slope. Where it lands, the derivatives of its start lead back to the bottom
    (`_landed`), and only there are they found anew.

    It ends where no step promises to matter beside the standard errors. Those are the noise's times
    the root of the misfit's mean square (Birge, 1932, "The calculation of errors by the method of
    least squares"): what a model lacks keeps its parameters from the truth by as much. What is
    periodic may mean nothing there: it goes on from another side if one leads down (`sides`).

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
        Most points with derivatives.
    roughly : bool
        Stop where others may start. The truth is χ² of p above the optimum of p coordinates: what
        is below that by less than its standard deviation is no nearer to it. Forecasts see to the
        bottom from there. So it is where the trust region lets no step gain as much.
    share : float
        Stop, not converged, where a step gains less than this share of the misfit beyond the noise.
    hope : float, optional
        Stop where |r|² + Σ((x - n)/s)² is on its way to more than this: at two points in a row
        gains that go on falling, as what the next step promises does beside the last gain, would
        not lead down to it (Aitken, 1926, "On Bernoulli's numerical solution of algebraic
        equations").
    doubted : bool
        One point is enough for that: the start is where such a descent was given up.

    Raises
    ------
    SolveError
        Nothing balances at the start.
    """
    columns = layout.columns(model)
    x = np.array(layout.null)
    x[columns] = np.maximum(start[columns], layout.lower[columns])
    until = _Until(steps, roughly, share, hope, doubted)
    # without a name here, what the start takes is let go with the first step
    found = _descended(problem, layout, model, problem.linearise(x, columns, near), until)
    while found.converged and (side := _other_side(problem, layout, found, until)) is not None:
        until = replace(until, steps=steps - found.steps, doubted=False)
        ahead = _descended(problem, layout, model, side, until)
        if ahead.score >= found.score:
            break
        found = replace(ahead, steps=found.steps + ahead.steps)
    return found


@dataclass(frozen=True)
class _Until:
    """When a descent ends: see `descend`."""

    steps: int
    roughly: bool
    share: float
    hope: float | None
    doubted: bool

    def least(self, columns: Columns) -> float:
        """Gain by which a step is worth a solve, where the noise is all there is."""
        rough = float(np.sqrt(2.0 * len(columns))) if self.roughly else 0.0
        return max(_SETTLED, rough)


def _descended(
    problem: Problem, layout: Layout, model: Model, here: Linearised, until: _Until
) -> Fit:
    columns, least = here.columns, until.least(here.columns)
    reach, converged, taken, last = _REACH, False, 1, np.inf
    hopeless, seen = int(until.doubted), 1
    brinks = _Brinks(problem)
    while taken < until.steps and reach > _LEAST_REACH:
        value, slope, matrix = quadratic(here, layout, columns)
        step, damped = _step(slope, matrix, layout, here, reach, brinks.rows)
        promised = float(2.0 * slope @ step - step @ matrix @ step)
        size = float(np.abs(step / layout.width[columns]).max(initial=0.0))
        unheld = size < _USED * reach and not brinks.hold(step)
        if promised < (_misfit(problem, here) * least if unheld or until.roughly else _SETTLED):
            converged = unheld
            break
        if until.hope is not None and taken > seen:
            seen = taken
            hopeless = hopeless + 1 if _ahead(promised, last) < value - until.hope else 0
            if hopeless == _HOPELESS:
                break
        try:
            landed = _landed(problem, layout, here, step, damped)
        except LostStabilityError as lost:
            if brinks.met(lost.brink, here, step):
                continue
            landed = None
        gained, ahead = -np.inf, None
        if landed is not None:
            gained = value - quadratic(landed, layout, columns)[0]
            ahead = _slopes(problem, landed) if gained > 0.0 else None
            gained = gained if ahead is not None else -np.inf
        if gained < 0.25 * promised:
            reach = 0.3 * size
        elif gained > 0.75 * promised and not unheld:
            reach *= 3.0
        if ahead is not None:
            here = ahead
            brinks.seen_from(here)
            taken += 1
            if unheld and 0.25 * promised < gained < _misfit(problem, here) * least:
                converged = True
                break
            value -= gained
            if gained < until.share * (value - problem.noise):
                break
            last = gained
    found = laplace(here, layout, columns)
    # where a step that was not taken would lead is no evidence
    score = found.score if converged else found.score + found.ahead
    score += layout.believed(model)
    given_up = hopeless == _HOPELESS
    short = 0.0 if converged else float(np.sqrt(_promised(problem, layout, here)))
    return Fit(model, here.light(), score, found.covariance, converged, taken, given_up, short)


def _promised(problem: Problem, layout: Layout, here: Linearised) -> float:
    """What a step of any length promises beside the misfit: the square of its standard errors.

    Of the step δ to the optimum it is δᵀAδ, and no combination c of parameters moves by more of its
    own, (c·δ)² ≤ δᵀAδ · cᵀA⁻¹c (Cauchy and Schwarz).
    """
    _, slope, matrix = quadratic(here, layout, here.columns)
    lower = layout.lower[here.columns] - here.x[here.columns]
    step = bounded_optimum(slope, matrix, lower)
    return max(float(2.0 * slope @ step - step @ matrix @ step), 0.0) / _misfit(problem, here)


def _other_side(problem: Problem, layout: Layout, found: Fit, until: _Until) -> Linearised | None:
    """Where a descent goes on that ended in what is periodic and means nothing; None if nowhere.

    The side that it stands at promises no more than its last step did, which was too little.
    """
    here = found.here
    least = _misfit(problem, here) * until.least(here.columns)
    with problem.remembering():
        for at in idle(layout, here.x, found.model):
            x, taken = best_side(problem, layout, here.x, at, here.near)
            if taken > least:
                try:
                    return problem.linearise(x, here.columns, here.near)
                except SolveError:
                    continue
    return None


def _ahead(promised: float, last: float) -> float:
    """What all steps from here on gain, each as large a share of the one before as the next one."""
    share = promised / last
    return promised / (1.0 - share) if 0.0 < share < 1.0 else np.inf


def _slopes(problem: Problem, landed: Linearised) -> Linearised | None:
    """The misfit near a landing with its own derivatives; None where nothing beside it balances."""
    try:
        return problem.linearise(landed.x, landed.columns, landed.near)
    except (SolveError, InputError):
        return None


def _misfit(problem: Problem, here: Linearised) -> float:
    """Mean square of the residual over the noise's before that was raised; 1 or more."""
    return max(here.square / (problem.noise * problem.tempered), 1.0)


class _Brinks:
    """Where a descent lost stability, and what it may do to what keeps its shapes from that.

    Attributes
    ----------
    rows : list of (p,) array
        Of each brink: what a step of 1 along it changes is the most that a step may.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._known, self.rows = problem, list[Any](), list[Floats]()

    def met(self, brink: Any, here: Linearised, step: Floats) -> bool:
        """A step from `here` came to one; whether it went farther than that lets it.

        Of no more than steps are sure to be held within.
        """
        row = None if brink is None else self._problem.kept_from(brink, here)
        if row is None or len(self.rows) == ROUNDS:
            return False
        if abs(float(row @ step)) < (1.0 + _HELD) * SHARE:
            return False
        self._known.append(brink)
        self.rows.append(row / SHARE)
        return True

    def seen_from(self, here: Linearised) -> None:
        """The same from where a step has led; those that are behind are forgotten."""
        rows = [(brink, self._problem.kept_from(brink, here)) for brink in self._known]
        self._known = [brink for brink, row in rows if row is not None]
        self.rows = [row / SHARE for _, row in rows if row is not None]

    def hold(self, step: Floats) -> bool:
        """Whether a step goes as far as one of them lets it."""
        return any(abs(float(row @ step)) > 1.0 - _HELD for row in self.rows)


def _step(
    slope: Floats,
    matrix: Floats,
    layout: Layout,
    here: Linearised,
    reach: float,
    rows: Sequence[Floats] = (),
) -> tuple[Floats, Floats]:
    """The step to the optimum, or as far as the trust region lets it; the matrix that made it."""
    width = layout.width[here.columns]
    lower = layout.lower[here.columns] - here.x[here.columns]

    def to(damping: float) -> tuple[Floats, Floats]:
        return bounded_within(slope, matrix + np.diag(damping / width**2), lower, rows)

    def size(step: Floats) -> float:
        return float(np.abs(step / width).max(initial=0.0))

    found = to(0.0)
    if size(found[0]) <= reach:
        return found
    # damping of |b|/reach is enough; halve its logarithm's range until most of the reach is used
    low, high = 1e-8, float(np.linalg.norm(slope * width)) / reach
    found = to(high)
    for _ in range(_HALVINGS):
        between = np.sqrt(low * high)
        ahead = to(between)
        if size(ahead[0]) > reach:
            low = between
            continue
        high, found = between, ahead
        if size(found[0]) > _USED * reach:
            break
    return found


def _landed(
    problem: Problem, layout: Layout, here: Linearised, step: Floats, damped: Floats
) -> Linearised | None:
    """Where a step leads, corrected by the derivatives `here`; None where nothing balances.

    Raises LostStabilityError where that is lost on the way.

    The slope at the landing departs from the forecast one by what is not linear. The matrix that
    made the step turns that into a correction, to leading order that of the geodesic's acceleration
    (Transtrum and Sethna, 2012, "Improvements to the Levenberg-Marquardt algorithm for nonlinear
    least-squares minimization", eq. 9).
    """
    columns = here.columns
    width, (_, slope, matrix) = layout.width[columns], quadratic(here, layout, columns)
    forecast = slope - matrix @ step
    there = _at(problem, here, here.x[columns] + step)
    if there is None:
        return None
    value, slope, _ = quadratic(there, layout, columns)
    before, settled = float(np.linalg.norm(step / width)), _SETTLED * _misfit(problem, here)
    for _ in range(_CORRECTIONS):
        lower = layout.lower[columns] - there.x[columns]
        turn = bounded_optimum(slope - forecast, damped, lower)
        size = float(np.linalg.norm(turn / width))
        if turn @ damped @ turn < settled or size > _CONTRACTED * before:
            break
        try:
            ahead = _at(problem, here, there.x[columns] + turn)
        except LostStabilityError:
            break
        if ahead is None:
            break
        lowered, slope, _ = quadratic(ahead, layout, columns)
        if lowered >= value:
            break
        there, value, before = ahead, lowered, size
    return there


def _at(problem: Problem, here: Linearised, own: Floats) -> Linearised | None:
    """The misfit at other values of the coordinates; None where nothing balances there."""
    x = np.array(here.x)
    x[here.columns] = own
    try:
        return problem.again(here, x)
    except LostStabilityError:
        raise
    except (SolveError, InputError):
        return None
