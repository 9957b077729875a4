"""Evidence, its forecasts and the search by it, on problems whose answers are known otherwise."""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.optimize import minimize, minimize_scalar
from scipy.stats import multivariate_normal, norm

from bulgefit.effects.parameter import Owned, as_wide_as
from bulgefit.errors import InputError, SolveError
from bulgefit.gap.evidence.amplitude import amplitudes
from bulgefit.gap.evidence.brink import LostStabilityError, bounded_within
from bulgefit.gap.evidence.closely import _without, closely
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.forecast import Forecast
from bulgefit.gap.evidence.hidden import handed_over
from bulgefit.gap.evidence.improve import _of_each_specimen, _thinned, improved, promise
from bulgefit.gap.evidence.laplace import bounded_optimum, laplace, quadratic
from bulgefit.gap.evidence.neighbours import smaller
from bulgefit.gap.evidence.orthant import _cut, log_share_above
from bulgefit.gap.evidence.probability import weighed
from bulgefit.gap.evidence.problem import Group, Layout, Linearised, Model
from bulgefit.gap.evidence.search import Search
from bulgefit.gap.evidence.shares import scores
from bulgefit.gap.evidence.sides import best_side
from bulgefit.gap.evidence.ways import Ways
from bulgefit.parallel.journal import journaled

Curve = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def owned(name: str | Owned) -> Owned:
    return name if isinstance(name, Owned) else Owned.read(name)


def group(name: str | Owned, width: list[float], null: float = 0.0, **more: Any) -> Group:
    """A group without bounds, unless told."""
    count = len(width)
    lower = more.pop("lower", np.full(count, -np.inf))
    return Group(owned(name), "", np.full(count, null), np.array(width), lower, **more)


def freeze(forms: Mapping[Any, int]) -> Model:
    """A model from the form of each group."""
    return frozenset((owned(name), form) for name, form in forms.items())


class Known:
    """Measured values against `curve`, which gives a model's values and their derivatives.

    Noise has a variance. Beyond `end` in any coordinate nothing balances.
    """

    def __init__(
        self,
        groups: list[Group],
        measured: np.ndarray,
        curve: Curve,
        variance: float = 1.0,
        end: float = np.inf,
    ) -> None:
        self.groups, self.variance, self.noise = groups, variance, float(len(measured))
        self.tempered = 1.0
        self._measured, self._of, self._end = measured, curve, end
        self.solves = 0

    def _seen(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and derivatives, over the noise."""
        value, rows = self._of(x)
        root = np.sqrt(self.variance)
        return (self._measured - value) / root, rows / root

    def linearise(self, x: np.ndarray, columns: np.ndarray, near: Any = None) -> Linearised:
        self.solves += 1
        if (np.abs(x) > self._end).any():
            raise SolveError(
                "nothing balances", pressure=0.1, reached=0.1, iteration=1, residual_norm=1.0,
                parameters={},
            )  # fmt: skip
        residual, rows = self._seen(x)
        rows = rows[:, columns]
        return Linearised(
            np.array(x), columns, residual @ residual, rows.T @ residual, rows.T @ rows, rows=rows
        )

    def along(self, x: np.ndarray, column: int, near: Any = None) -> tuple[float, float]:
        here = self.linearise(x, np.array([column]))
        return float(here.gradient[0]), float(here.hessian[0, 0])

    def afresh(self) -> Known:
        return self

    def remembering(self) -> AbstractContextManager[None]:
        return nullcontext()

    def lighter(self, near: Any) -> Any:
        return near

    def rounded(self, near: Any) -> Any:
        return near

    def again(self, here: Linearised, x: np.ndarray) -> Linearised:
        there = self.linearise(x, here.columns[:0])
        gradient = here.rows.T @ self._seen(x)[0]
        return replace(here, x=there.x, square=there.square, gradient=gradient)

    def kept_from(self, brink: Any, here: Linearised) -> np.ndarray | None:
        return None


def linear(groups: list[Group], rows: np.ndarray, measured: np.ndarray, **more: Any) -> Known:
    return Known(groups, measured, lambda x: (rows @ x, rows), **more)


def marginal(problem: Known, rows: np.ndarray, columns: np.ndarray, measured: np.ndarray) -> float:
    """-2 ln of a linear model's marginal likelihood, as a Gaussian of the data alone.

    Up to what every model has: the logarithm of the noise's determinant.
    """
    layout = Layout.of(problem.groups)
    own, v = rows[:, columns], problem.variance
    covariance = np.eye(len(measured)) + own @ np.diag(layout.width[columns] ** 2 / v) @ own.T
    away = measured - rows @ layout.null
    return float(away @ np.linalg.solve(covariance, away) / v + np.linalg.slogdet(covariance)[1])


@pytest.fixture
def random_linear() -> tuple[Known, np.ndarray, np.ndarray]:
    """Three groups of 1, 2 and 3 coordinates with nulls off zero, 40 values, inflated noise."""
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(40, 6)) * [3.0, 1.0, 10.0, 0.3, 1.0, 1.0]
    measured = rows @ [0.5, 1.0, 0.0, -1.0, 0.2, 0.4] + rng.normal(size=40)
    groups = [
        group("a", [0.7], null=0.2, always=True),
        group("b", [2.0, 0.1]),
        group("c", [1.0, 1.0, 3.0], null=-0.3, forms=((0,), (0, 2), (0, 1, 2))),
    ]
    return linear(groups, rows, measured, variance=2.5), rows, measured


MODELS = [freeze(m) for m in ({}, {"b": 0}, {"c": 0}, {"b": 0, "c": 1}, {"b": 0, "c": 2})]


@pytest.mark.parametrize("model", MODELS)
def test_evidence_of_a_linear_model_is_its_marginal_likelihood(random_linear, model):
    problem, rows, measured = random_linear
    layout = Layout.of(problem.groups)
    columns = layout.columns(model)
    x = np.array(layout.null)
    x[columns] += np.linspace(-1.0, 2.0, len(columns))  # wherever it is linearised
    found = laplace(problem.linearise(x, columns), layout, columns)
    assert found.score == pytest.approx(marginal(problem, rows, columns, measured), rel=1e-10)


@pytest.mark.parametrize("model", MODELS)
def test_a_forecast_from_all_is_the_smaller_models_own_evidence(random_linear, model):
    problem, rows, measured = random_linear
    layout = Layout.of(problem.groups)
    everything = layout.columns(layout.whole())
    around = problem.linearise(np.linspace(-1.0, 1.0, 6), everything)
    columns = layout.columns(model)
    found = laplace(around, layout, columns)
    assert found.score == pytest.approx(marginal(problem, rows, columns, measured), rel=1e-10)
    left = np.setdiff1d(everything, columns)
    np.testing.assert_array_equal(found.x[left], layout.null[left])


def turned(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A slope, and a wave by its size and its turn, which means nothing without a size."""
    t = np.linspace(0.0, 6.0, 30)
    value = x[0] * t + x[1] * np.sin(t + x[2])
    return value, np.stack([t, np.sin(t + x[2]), x[1] * np.cos(t + x[2])], axis=1)


def test_what_means_nothing_without_another_is_no_loss_where_that_goes():
    """The forecast of a model without the wave is that model's evidence, whatever its turn was."""
    measured = turned(np.array([0.3, 0.8, 2.6]))[0] + np.random.default_rng(8).normal(size=30)
    groups = [group("a", [1.0], always=True), group("wave", [1.0, 3.0], governor=(0, 0))]
    problem = Known(groups, measured, turned)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.array([0.3, 0.8, 2.6]))
    assert fit.converged
    assert abs(fit.x[2]) > 2.0
    alone = descend(problem, layout, freeze({}), layout.null)
    evidence = alone.score - layout.believed(freeze({}))
    around = problem.linearise(fit.x, layout.columns(layout.whole()))
    columns = layout.columns(freeze({}))
    by_all = laplace(around, layout, columns)
    assert by_all.score == pytest.approx(evidence, rel=1e-9)
    blocks = Forecast.of(around, layout, layout.columns(layout.whole()))
    assert blocks.score(columns) == pytest.approx(evidence, rel=1e-9)


@pytest.mark.parametrize("base", [{}, {"a": 0, "c": 1}, {"a": 0, "b": 1, "c": 1, "d": 0}])
def test_a_forecast_by_blocks_is_that_by_the_whole_matrix(base):
    """Groups go, come and are swapped, bounded ones and forms among them."""
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(30, 8)) @ (np.eye(8) + 0.6 * rng.normal(size=(8, 8)))
    groups = [
        group("m", [2.0], always=True),
        group("a", [1.0, 1.5], lower=[0.0, -np.inf]),
        group("b", [0.7, 2.0], lower=[-0.1, -0.2], forms=((0,), (0, 1))),
        group("c", [1.0, 0.3], forms=((1,), (0, 1))),
        group("d", [0.5], lower=[0.0]),
    ]
    measured = rows @ rng.normal(size=8) + rng.normal(size=30)
    problem = linear(groups, rows, measured, variance=2.5)
    layout = Layout.of(problem.groups)
    here = problem.linearise(rng.uniform(0.1, 0.4, 8), layout.columns(layout.whole()))
    found = Forecast.of(here, layout, layout.columns(freeze(base)))
    forms = {"a": (None, 0), "b": (None, 0, 1), "c": (None, 0, 1), "d": (None, 0)}
    for chosen in itertools.product(*forms.values()):
        model = {n: f for n, f in zip(forms, chosen, strict=True) if f is not None}
        columns = layout.columns(freeze(model))
        exact = laplace(here, layout, columns).score
        assert found.score(columns) == pytest.approx(exact, rel=1e-9)


def test_forms_choose_coordinates():
    layout = Layout.of([group("a", [1.0, 1.0], always=True), group("b", [1.0] * 3, forms=((2,),))])
    assert layout.columns(freeze({"b": 0})).tolist() == [0, 1, 4]
    assert layout.columns(freeze({})).tolist() == [0, 1]


@pytest.mark.parametrize("mean", [3.0, 0.0, -2.0, -40.0, -1e5])
def test_share_above_one_bound(mean):
    found = log_share_above(np.array([2.0 * mean + 1.0]), np.array([[4.0]]), np.array([1.0]))
    assert found == pytest.approx(norm.logcdf(mean), rel=1e-10)


@pytest.mark.parametrize("correlation", [-0.7, 0.0, 0.5, 0.95])
@pytest.mark.parametrize("mean", [(1.0, 0.5), (-1.0, 0.3), (-2.0, -2.5)])
def test_share_above_two_bounds(mean, correlation):
    covariance = np.array([[1.0, correlation], [correlation, 1.0]])
    exact = np.log(multivariate_normal(np.zeros(2), covariance).cdf(mean))
    found = log_share_above(np.array(mean), covariance, np.zeros(2))
    # a factor of 1.05 on a probability is 0.1 on the scale of -2 ln Z
    assert found == pytest.approx(exact, abs=0.05)


@pytest.mark.parametrize("z", [3.0, 0.0, -5.0, -29.0, -31.0, -300.0])
def test_moments_above_a_bound(z):
    """Far below it the variance is a difference of large numbers, and a series is taken."""
    unit = 1.0 / max(1.0, -z)

    def moment(power):
        return quad(lambda y: y**power * np.exp(-0.5 * (unit * y) ** 2 + z * unit * y), 0, 40)[0]

    whole, first, second = (moment(power) for power in range(3))
    mean = first / whole
    mass, found, variance = _cut(2.0 * z, 4.0)
    assert mass == pytest.approx(norm.logcdf(z), rel=1e-12)
    assert found == pytest.approx(2.0 * unit * mean, rel=1e-6)
    left = 50.0 / z**4 if z < -30.0 else 1e-6  # the series' next term
    assert variance == pytest.approx((2.0 * unit) ** 2 * (second / whole - mean**2), rel=left)


def test_shares_of_independent_bounds_multiply():
    mean, sd = np.array([1.0, -3.0, 0.2]), np.array([1.0, 2.0, 0.1])
    found = log_share_above(mean, np.diag(sd**2), np.zeros(3))
    assert found == pytest.approx(norm.logcdf(mean / sd).sum(), rel=1e-9)


@pytest.mark.parametrize("truth", [0.8, 0.0, -0.6])
def test_evidence_above_a_bound_against_quadrature(truth):
    """A coordinate that cannot be negative: half a Gaussian as prior, and as posterior."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(30, 1))
    measured = rows[:, 0] * truth + rng.normal(size=30)
    problem = linear([group("a", [0.5], lower=np.zeros(1))], rows, measured)
    layout = Layout.of(problem.groups)
    columns = layout.columns(layout.whole())
    found = laplace(problem.linearise(np.array([0.1]), columns), layout, columns)
    least = float(((measured - rows[:, 0] * max(truth, 0.0)) ** 2).sum())

    def density(a: float) -> float:
        miss = ((measured - rows[:, 0] * a) ** 2).sum() - least
        return float(np.exp(-0.5 * miss) * 2.0 * norm.pdf(a, scale=0.5))

    exact = least - 2.0 * np.log(quad(density, 0.0, 4.0, epsabs=0, epsrel=1e-10)[0])
    assert found.score == pytest.approx(exact, abs=1e-7)
    assert found.x[0] >= 0.0


def test_bounded_optimum_against_enumeration():
    rng = np.random.default_rng(2)
    for _ in range(20):
        root = rng.normal(size=(5, 5))
        matrix, slope = root @ root.T + 0.1 * np.eye(5), rng.normal(size=5)
        lower = np.where([True, True, True, False, False], -0.1, -np.inf)
        found = bounded_optimum(slope, matrix, lower)
        best = np.inf
        for mask in range(8):
            held = np.array([bool(mask >> i & 1) for i in range(3)] + [False, False])
            step = np.where(held, lower, 0.0)
            rest = slope[~held] - matrix[np.ix_(~held, held)] @ step[held]
            step[~held] = np.linalg.solve(matrix[np.ix_(~held, ~held)], rest)
            if (step >= lower - 1e-12).all():
                best = min(best, step @ matrix @ step - 2.0 * slope @ step)
        assert found @ matrix @ found - 2.0 * slope @ found == pytest.approx(best, abs=1e-9)
        assert (found >= lower).all()


def bent(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two coordinates in a mildly bent way, 25 values."""
    t = np.linspace(0.1, 1.0, 25)
    value = 30.0 * (t * x[0] + 0.08 * (t * x[0]) ** 2 + np.sin(3 * t) * np.expm1(0.2 * x[1]))
    by = np.stack([t + 0.16 * t**2 * x[0], 0.2 * np.sin(3 * t) * np.exp(0.2 * x[1])], axis=1)
    return value, 30.0 * by


def test_evidence_of_a_bent_model_against_quadrature():
    measured = bent(np.array([0.4, -0.8]))[0] + np.random.default_rng(3).normal(size=25)
    problem = Known([group("a", [1.0]), group("b", [1.0])], measured, bent)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.zeros(2))
    assert fit.converged
    least = fit.here.square

    def density(b: float, a: float) -> float:
        miss = measured - bent(np.array([a, b]))[0]
        return float(np.exp(-0.5 * (miss @ miss - least)) * norm.pdf(a) * norm.pdf(b))

    sd = np.sqrt(np.diag(fit.covariance))
    (a, b), wide = fit.x, 9.0 * sd
    total, _ = dblquad(
        density, a - wide[0], a + wide[0], b - wide[1], b + wide[1], epsabs=0, epsrel=1e-7
    )
    evidence = fit.score - layout.believed(fit.model)
    assert evidence == pytest.approx(least - 2.0 * np.log(total), abs=0.05)


def rosenbrock(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A bent valley along which a straight step leads uphill."""
    value = np.array([100.0 * (x[1] - x[0] ** 2), 10.0 * x[0]])
    return value, np.array([[-200.0 * x[0], 100.0], [10.0, 0.0]])


@pytest.mark.parametrize("end", [np.inf, 1.2])
def test_descends_a_bent_valley_within_what_balances(end):
    problem = Known([group("a", [5.0, 5.0])], np.array([0.0, 10.0]), rosenbrock, end=end)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.array([-1.0, 1.0]))
    assert fit.converged

    def misfit(x: np.ndarray) -> float:
        return float(((rosenbrock(x)[0] - [0.0, 10.0]) ** 2).sum() + (x**2).sum() / 25.0)

    least = minimize(misfit, [1.0, 1.0], method="Nelder-Mead", options={"xatol": 1e-9}).fun
    assert misfit(fit.x) == pytest.approx(least, abs=0.01)  # of -2 ln Z
    assert fit.steps <= 30


def test_a_descent_holds_one_point_while_it_looks_at_the_next():
    """With hundreds of coordinates and all points of a test each is 300 MB."""
    rows, held = list[Any](), list[int]()

    class Watched(Known):
        def linearise(self, x: np.ndarray, columns: np.ndarray, near: Any = None) -> Linearised:
            here = super().linearise(x, columns, near)
            if len(columns):  # it is no landing
                held.append(sum(other() is not None for other in rows))
                rows.append(weakref.ref(here.rows))
            return here

    problem = Watched([group("a", [5.0, 5.0])], np.array([0.0, 10.0]), rosenbrock)
    layout = Layout.of(problem.groups)
    descend(problem, layout, layout.whole(), np.array([-1.0, 1.0]))
    assert len(held) > 3
    assert max(held) == 1


def parabola(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A narrow valley with a parabola as its floor."""
    value = np.array([1000.0 * (x[1] - 0.3 * x[0] ** 2), x[0]])
    return value, np.array([[-600.0 * x[0], 1000.0], [1.0, 0.0]])


def test_landings_beside_a_valleys_floor_are_corrected_by_the_same_derivatives():
    """A straight step to the far end of the valley costs a million units: corrected, it is one."""
    problem = Known([group("a", [5.0, 5.0])], np.array([0.0, 2.0]), parabola)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.zeros(2))
    assert fit.converged
    assert fit.x[0] == pytest.approx(2.0 / (1.0 + 1.0 / 25.0), abs=0.1)
    assert fit.here.square == pytest.approx((2.0 - fit.x[0]) ** 2, abs=1e-3)
    assert fit.steps <= 3


def waves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two coordinates in a strongly bent way, 25 values."""
    t = np.linspace(0.1, 1.0, 25)
    value = np.sin(2 * t * x[0]) + x[1] * t * np.cos(t * x[0])
    by = [2 * t * np.cos(2 * t * x[0]) - x[1] * t**2 * np.sin(t * x[0]), t * np.cos(t * x[0])]
    return 0.3 * value, 0.3 * np.stack(by, axis=1)


def test_a_rough_descent_ends_where_what_is_left_is_nothing():
    """Within the standard deviation √(2 p) of χ² of the optimum, and short of it."""
    noise = np.random.default_rng(3).normal(size=25)
    measured = waves(np.array([1.4, 0.5]))[0] + noise
    problem = Known([group("a", [1.0, 1.0])], measured, waves, variance=1.0 / 3.0)
    layout = Layout.of(problem.groups)
    fits = [
        descend(problem, layout, layout.whole(), np.array([2.5, 1.0]), roughly=roughly)
        for roughly in (False, True)
    ]
    exact, rough = (f.here.square + (f.x**2).sum() for f in fits)
    assert fits[1].steps < fits[0].steps
    assert exact < rough < exact + 2.0


def test_a_rough_descent_does_not_feel_its_way_to_where_nothing_balances():
    """The optimum is beyond: steps that may go no further than gains nothing are not tried."""
    solves = {}
    for roughly in (False, True):
        measured = 10.0 * np.arange(1.0, 51.0) / 25.0
        problem = linear([group("a", [1.0])], np.full((50, 1), 10.0), measured, end=0.5)
        layout = Layout.of(problem.groups)
        fit = descend(problem, layout, layout.whole(), np.zeros(1), roughly=roughly)
        assert not fit.converged
        assert 0.4 < fit.x[0] <= 0.5
        # the optimum, and its standard error by what is left, which is more than the noise
        away, curvature = 5000.0 / 5001.0 * 1.02 - fit.x[0], 5001.0
        spread = np.sqrt(fit.here.square / problem.noise / curvature)
        assert fit.short == pytest.approx(away / spread, rel=1e-9)
        solves[roughly] = problem.solves
    assert solves[True] < solves[False] - 2


def test_a_landing_without_derivatives_is_refused():
    """As beside a modulus of nothing: the descent stays where it has some."""

    class Flat(Known):
        def linearise(self, x: np.ndarray, columns: np.ndarray, near: Any = None) -> Linearised:
            if len(columns) and x[0] > 0.5:
                raise InputError("G12 must be positive")
            return super().linearise(x, columns, near)

    problem = Flat([group("a", [1.0])], np.full(5, 10.0), lambda x: (x[0] * np.full(5, 10.0),
                   np.full((5, 1), 10.0)))  # fmt: skip
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.zeros(1))
    assert 0.4 < fit.x[0] <= 0.5
    assert not fit.converged


def test_a_descent_may_end_where_a_step_gains_no_share_that_is_told():
    """Along a bent valley, beside something that no coordinate follows: all it gains is a share."""

    def valley(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, rows = rosenbrock(x)
        return np.append(value, 0.0), np.vstack([rows, np.zeros(2)])

    start = np.array([-8.0, 1.0])
    problem = Known([group("a", [5.0, 5.0])], np.array([0.0, 10.0, 100.0]), valley)
    layout = Layout.of(problem.groups)
    whole, part = (
        descend(problem, layout, layout.whole(), start, share=share) for share in (0.0, 0.9)
    )
    assert whole.converged
    assert whole.short == 0.0
    assert not part.converged
    assert part.steps < whole.steps
    assert whole.here.square < part.here.square < (problem._measured - valley(start)[0])[0] ** 2
    assert part.score > part.here.square  # what it did not go is no evidence


@pytest.mark.parametrize("lacking", [0.0, 300.0])
def test_a_descent_ends_within_the_standard_errors_that_the_misfit_leaves(lacking):
    """As soon beside something that no coordinate follows, and beside its errors as near."""
    measured = waves(np.array([1.4, 0.5]))[0] + np.random.default_rng(3).normal(size=25)
    rows = waves(np.array([1.4, 0.5]))[1]
    unlike = np.linalg.qr(np.column_stack([rows, np.ones(25)]))[0][:, 2]
    problem = Known([group("a", [1.0, 1.0])], measured + lacking * unlike, waves)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.array([2.5, 1.0]))
    assert fit.converged
    assert fit.steps <= 4
    best = minimize(
        lambda x: float(((problem._measured - waves(x)[0]) ** 2).sum() + x @ x),
        fit.x,
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-9},
    ).x
    birge = max(1.0, fit.here.square / 25)
    away = (fit.x - best) @ np.linalg.solve(fit.covariance, fit.x - best)
    assert away < 0.05 * birge


def test_a_soft_direction_among_stiff_ones_is_held_within_reach():
    """All 50 slopes are alike, and together they push along what hardly resists.

    A step along it is many times what the largest slope by itself would make.
    """
    soft = np.array([0.7, *[0.1] * 49])
    soft /= np.linalg.norm(soft)
    across = np.eye(50) - np.outer(soft, soft)
    rows = np.vstack([100.0 * across, 0.1 * soft])
    truth = 300.0 * soft + across @ np.ones(50) * (0.01 * 300.0 / soft.sum()) / 1e4
    problem = linear([group("a", [100.0] * 50)], rows, rows @ truth)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.zeros(50))
    assert fit.converged
    # the prior, a hundred wide, beside what is seen: 1e-4 beside 1e-2
    assert fit.x @ soft == pytest.approx(300.0 / 1.01, rel=1e-3)


@pytest.mark.parametrize("missed", [0.0, 2000.0])
def test_a_descent_that_cannot_reach_the_noise_is_given_up(missed: float):
    """A flat bottom, to which steps come ever less near, beside a value that nothing changes."""

    def curve(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, rows = np.zeros(200_000), np.zeros((200_000, 1))
        value[:2], rows[0] = [x[0] ** 4, missed], 4.0 * x[0] ** 3
        return value, rows

    problem = Known([group("a", [1e2])], np.zeros(200_000), curve)
    layout = Layout.of(problem.groups)
    plain, fit = (
        descend(problem, layout, layout.whole(), np.array([-8.0]), hope=hope)
        for hope in (None, problem.noise)
    )
    assert plain.here.square - missed**2 < 2000.0
    assert fit.given_up == (missed > 0.0)
    if missed:
        assert 1 < fit.steps < plain.steps
        # where one was given up, another is sooner; what does reach the noise is not
        again = descend(
            problem,
            layout,
            layout.whole(),
            fit.x,
            hope=problem.noise,
            doubted=True,
        )
        assert again.given_up
        assert again.steps == 2
    else:
        np.testing.assert_array_equal(fit.x, plain.x)


def test_a_descent_that_starts_where_nothing_balances_says_so():
    problem = Known([group("a", [5.0, 5.0])], np.zeros(2), rosenbrock, end=0.5)
    layout = Layout.of(problem.groups)
    with pytest.raises(SolveError, match="nothing balances"):
        descend(problem, layout, layout.whole(), np.array([1.0, 1.0]))


def explore(search: Search, start: np.ndarray) -> Fit:
    """The best model by every way."""
    Ways(search, start).every()
    return search.best


def searched(problem: Known) -> Search:
    layout = Layout.of(problem.groups)
    return Search(problem, layout, tuple(g.id for g in problem.groups if not g.always))


def test_what_is_hoped_of_a_model_is_a_thousandth_of_the_probability():
    """Where the misfit is linear, and so what it comes down to is known beforehand."""
    rng = np.random.default_rng(12)
    rows = rng.normal(size=(40, 4))
    measured = rows @ [0.0, 1.0, -0.5, 0.4] + rng.normal(size=40)
    groups = [group("moduli", [3.0], always=True), group("a", [2.0]), group("b", [1.0, 2.0])]
    search = searched(linear(groups, rows, measured))
    whole, less = (search.layout.whole(map(owned, names)) for names in ("ab", "a"))
    fit, smaller_fit = (search.fit(model, np.zeros(4)) for model in (whole, less))
    assert fit is not None
    assert smaller_fit is not None
    columns = search.layout.columns(less)
    value, _, _ = quadratic(smaller_fit.here, search.layout, columns)
    beyond = value - search.hoped(fit, less, fit.here)
    share = np.exp(-0.5 * (smaller_fit.score - fit.score)) / 1e-3
    assert beyond == pytest.approx(-2.0 * np.log(share), abs=1e-6)


def test_what_ends_on_its_bound_without_a_group_is_hoped_of_as_there():
    """A linear step leads many standard errors below; the optimum on the bound is near."""
    rng = np.random.default_rng(13)
    rows = rng.normal(size=(400, 2)) @ np.array([[1.0, -0.5], [0.0, 0.1]])
    measured = rows @ [0.01, 6.0] + rng.normal(size=400)
    groups = [group("a", [1.0], lower=np.zeros(1)), group("b", [6.0])]
    search = searched(linear(groups, rows, measured))
    whole, less = (search.layout.whole(map(owned, names)) for names in ("ab", "a"))
    fit = search.fit(whole, np.array([0.1, 0.0]))
    assert fit is not None
    smaller_fit = search.fit(less, fit.x)
    assert smaller_fit is not None
    assert smaller_fit.x[0] == 0.0
    columns = search.layout.columns(less)
    step = laplace(fit.here, search.layout, columns)
    before, _, _ = quadratic(fit.here, search.layout, columns)
    # what the share above the bound would make of a width
    assert step.score + step.ahead - before - step.volume > 1e3
    value, _, _ = quadratic(smaller_fit.here, search.layout, columns)
    hoped = search.hoped(fit, less, fit.here)
    # no more is asked than a thousandth of the probability
    assert value - hoped <= smaller_fit.score - fit.score - 2.0 * np.log(1e3) + 1e-6
    assert hoped > fit.here.square - 50.0


def test_all_models_are_found_as_enumeration_ranks_them():
    """Eight groups, correlated; every one of the 256 models is weighed by its marginal."""
    rng = np.random.default_rng(11)
    rows = rng.normal(size=(60, 8)) @ (np.eye(8) + 0.4 * rng.normal(size=(8, 8)))
    measured = rows @ [1.0, 0.0, -0.6, 0.0, 0.0, 0.5, 0.0, 0.0] + rng.normal(size=60)
    problem = linear([group(f"g{i}", [1.0]) for i in range(8)], rows, measured)
    search = searched(problem)
    best = explore(search, np.zeros(8))
    of_each = {}
    for mask in range(256):
        columns = np.array([i for i in range(8) if mask >> i & 1], dtype=np.intp)
        model = freeze({f"g{i}": 0 for i in columns})
        before = search.layout.believed(model)
        of_each[model] = marginal(problem, rows, columns, measured) + before
    assert best.model == min(of_each, key=lambda m: of_each[m])
    exact = weighed(of_each, search.names)
    found = weighed(scores(search, 1.0), search.names)
    for name in search.names:
        assert found.groups[name] == pytest.approx(exact.groups[name], abs=0.01)


def of_all(layout: Layout, worths: list[float]) -> list[float]:
    """Probabilities of independent groups over all models: each gains so much of -2 ln Z.

    By the sums of products of their odds, one for each number of groups.
    """
    odds = np.exp(0.5 * np.array(worths))
    names = [name for name, _ in layout.whole()]
    before = [
        np.exp(-0.5 * layout.believed(freeze(dict.fromkeys(names[:k], 0))))
        for k in range(len(odds) + 1)
    ]
    whole = before @ np.poly(-odds)
    return [
        float(before[1:] @ np.poly(-np.delete(odds, i))) * odds[i] / whole for i in range(len(odds))
    ]


def test_what_is_believed_of_models_before_any_data_is_a_probability():
    """Of all models together it is one; with more groups none becomes likelier."""
    groups = [
        group("m", [1.0], always=True),
        *(group(f"g{i}", [1.0]) for i in range(5)),
        group("h", [1.0, 1.0], forms=((0,), (0, 1))),
    ]
    layout = Layout.of(groups)
    each = list[float]()
    for mask in range(2**5):
        own = {f"g{i}": 0 for i in range(5) if mask >> i & 1}
        for more in ({}, {"h": 0}, {"h": 1}):
            each.append(np.exp(-0.5 * layout.believed(freeze(own | more))))
    assert sum(each) == pytest.approx(1.0, rel=1e-12)
    # the integral that it is, by quadrature
    w, weight = np.polynomial.legendre.leggauss(8)
    w, weight = 0.25 * (w + 1.0), 0.25 * weight
    exact = [2.0 * weight @ (w**k * (1.0 - w) ** (6 - k)) for k in range(7)]
    counted = [freeze({f"g{i}": 0 for i in range(k)}) for k in range(6)]
    found = [np.exp(-0.5 * layout.believed(model)) for model in counted]
    assert found == pytest.approx(exact[:6], rel=1e-12)
    assert np.all(np.diff(exact) < 0.0)


def test_of_many_groups_that_are_not_there_none_is_likely_by_chance():
    """Forty groups, of which two are at work; what the others gain by chance they gain as forty."""
    rng = np.random.default_rng(12)
    rows = 10.0 * np.linalg.qr(rng.normal(size=(60, 40)))[0]
    measured = rows[:, 0] * 2.0 + rows[:, 1] + rng.normal(size=60)
    problem = linear([group(f"g{i}", [1.0]) for i in range(40)], rows, measured)
    search = searched(problem)
    assert explore(search, np.zeros(40)).model == freeze({"g0": 0, "g1": 0})
    worths = [float((rows[:, i] @ measured) ** 2 / 101.0 - np.log(101.0)) for i in range(40)]
    # by themselves likelier there than not
    assert sum(worth > 0.0 for worth in worths[2:]) > 0
    found = weighed(scores(search, 1.0), search.names).groups
    for i, exact in enumerate(of_all(search.layout, worths)):
        assert found[owned(f"g{i}")] == pytest.approx(exact, abs=0.05)


def test_a_group_that_another_may_stand_for_is_not_sure():
    """Without either nothing is explained, with both nothing is gained: only a swap tells."""
    rng = np.random.default_rng(14)
    alike, apart, third = np.linalg.qr(rng.normal(size=(60, 3)))[0].T * 100.0
    rows = np.column_stack([alike, alike + 0.01 * apart, third])
    measured = rows @ [0.9, 0.0, 1.0] + rng.normal(size=60)
    problem = linear([group(name, [1.0]) for name in "abc"], rows, measured)
    search = searched(problem)
    best = explore(search, np.zeros(3))
    search = replace(search, fits={best.model: best})  # no other one happened to be fitted
    of_each = {}
    for mask in range(8):
        columns = np.array([i for i in range(3) if mask >> i & 1], dtype=np.intp)
        model = freeze({"abc"[i]: 0 for i in columns})
        of_each[model] = marginal(problem, rows, columns, measured) + search.layout.believed(model)
    exact = weighed(of_each, search.names)
    found = weighed(scores(search, 1.0), search.names)
    for name in search.names:
        assert found.groups[name] == pytest.approx(exact.groups[name], abs=0.01)
    assert found.groups[owned("a")] < 0.95
    assert found.groups[owned("c")] > 0.999


def test_groups_that_hardly_count_are_not_sure_for_being_many():
    """Thirty independent groups at work, and differences that count for little.

    Of the 2^30 models those without one of them are looked at, not those without two, three, ...
    Two were fitted, the whole and the empty one: by a few of those between them each would be
    nearer by two thousandths.
    """
    rng = np.random.default_rng(13)
    rows = 10.0 * np.linalg.qr(rng.normal(size=(60, 30)))[0]
    measured = rows @ rng.uniform(0.8, 1.6, 30) + 0.1 * rng.normal(size=60)
    problem = linear([group(f"g{i}", [1.0]) for i in range(30)], rows, measured)
    search = searched(problem)
    assert len(explore(search, np.zeros(30)).model) == 30
    found = weighed(scores(search, 50.0), search.names)
    worths = [((rows[:, i] @ measured) ** 2 / 101.0 - np.log(101.0)) / 50.0 for i in range(30)]
    for i, exact in enumerate(of_all(search.layout, worths)):
        assert 0.6 < exact < 0.95
        assert found.groups[owned(f"g{i}")] == pytest.approx(exact, abs=0.012)


def test_what_elimination_takes_out_first_comes_back_in_the_place_of_several():
    """Truth in a wide group, which five narrow ones together imitate.

    Each of them costs less evidence than the wide one, so elimination takes that out first; then
    none of the others can go, nor be swapped for it. All of them together cost more. Growth from
    nothing finds it at once.
    """
    rng = np.random.default_rng(5)
    base, _ = np.linalg.qr(rng.normal(size=(50, 5)))
    rows = np.column_stack([base.sum(axis=1), base])
    measured = 60.0 * rows[:, 0] + rng.normal(size=50)
    narrow = [group(f"n{i}", [60.0]) for i in range(5)]
    problem = linear([group("wide", [2e4]), *narrow], rows, measured)
    search = searched(problem)
    whole = search.fit(search.layout.whole(), np.zeros(6))
    assert whole is not None
    stuck = _thinned(search, whole)
    assert dict(stuck.model).keys() == {owned(f"n{i}") for i in range(5)}
    assert min(fit.score for fit in search.fits.values()) == stuck.score
    for best in (improved(search, stuck), explore(searched(problem), np.zeros(6))):
        assert best.model == freeze({"wide": 0})
        assert best.score < stuck.score - 5.0


def test_where_was_looked_around_is_known():
    """Once for each problem and point; where a model has everything, by its own derivatives."""
    rng = np.random.default_rng(21)
    rows = rng.normal(size=(40, 2))
    measured = rows @ [3.0, 0.0] + rng.normal(size=40)
    groups = [group("a", [5.0]), group("b", [5.0])]
    problem, other = (linear(groups, rows, measured, variance=v) for v in (1.0, 2.0))
    search = searched(problem)
    small = search.fit(freeze({"a": 0}), np.zeros(2))
    whole = search.fit(search.layout.whole(), np.zeros(2))
    assert small is not None
    assert whole is not None
    before = problem.solves
    around = search.around(small)
    assert problem.solves == before + 1
    np.testing.assert_allclose(around.hessian, rows.T @ rows, rtol=1e-12)
    assert search.around(replace(small, score=0.0)) is around
    assert search.around(whole) is whole.here
    assert problem.solves == before + 1
    moved = replace(small, here=replace(small.here, x=small.x + np.array([0.5, 0.0])))
    assert search.around(moved).square != around.square
    elsewhere = replace(search, problem=other)
    assert elsewhere.around(small) is not around
    assert other.solves == 1


def test_of_all_fits_the_best_alone_keeps_what_a_neighbour_starts_from():
    class Near(Known):
        def linearise(self, x: np.ndarray, columns: np.ndarray, near: Any = None) -> Linearised:
            return replace(super().linearise(x, columns), near="derivatives")

        def lighter(self, near: Any) -> Any:
            return "shapes"

    rng = np.random.default_rng(22)
    rows = rng.normal(size=(40, 3))
    measured = rows @ [3.0, 2.0, 0.0] + rng.normal(size=40)
    problem = Near(
        [group(name, [5.0]) for name in "abc"], measured, lambda x: (rows @ x, rows)
    )  # fmt: skip
    search = searched(problem)
    for model in ({}, {"a": 0}, {"c": 0}, {"a": 0, "b": 0}, {"b": 0}):
        search.fit(freeze(model), np.zeros(3))
    assert search.best.model == freeze({"a": 0, "b": 0})
    kept = {model: fit.here.near for model, fit in search.fits.items()}
    assert kept.pop(search.best.model) == "derivatives"
    assert set(kept.values()) == {"shapes"}


def test_fits_that_are_journaled_are_not_looked_for_again(tmp_path: Path) -> None:
    """Those that found nothing neither: nothing balances where three are free."""
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(30, 4))
    measured = rows @ [2.0, 0.0, 0.0, 1.5] + 0.1 * rng.normal(size=30)

    def found(problem: Edge, *, resume: bool = False) -> list[float]:
        search = searched(problem)
        with suppress(KeyboardInterrupt), journaled(tmp_path / "part", {}, resume=resume):
            for names in ("abc", "ad", "a"):
                search.fit(freeze(dict.fromkeys(names, 0)), np.zeros(4))
            raise KeyboardInterrupt
        return sorted(fit.score for fit in search.fits.values())

    first, again = (
        Edge([group(n, [1.0]) for n in "abcd"], measured, lambda x: (rows @ x, rows)) for _ in "12"
    )
    before = found(first)
    assert len(before) == 2
    assert first.tries > 0
    assert found(again, resume=True) == before
    assert again.tries == 0


def test_a_wrong_group_is_swapped_for_the_right_one():
    """Alike to 0.995, so that beside the wrong group the right one adds too little to pay."""
    rng = np.random.default_rng(6)
    base, _ = np.linalg.qr(rng.normal(size=(50, 2)))
    rows = np.stack([base[:, 0], 0.995 * base[:, 0] + np.sqrt(1 - 0.995**2) * base[:, 1]], axis=1)
    measured = rows[:, 0] * 30.0 + rng.normal(size=50)
    problem = linear([group("right", [30.0]), group("wrong", [30.0])], rows, measured)
    search = searched(problem)
    wrong = search.fit(freeze({"wrong": 0}), np.zeros(2))
    assert wrong is not None
    assert improved(search, wrong).model == freeze({"right": 0})


@pytest.mark.parametrize("more", [0.0, 3.0])
def test_specimens_are_changed_at_once(more):
    """Told by data of their own, one change of each; but of one specimen one after another.

    Where the best model holds `more` of what is not there, that is gone first, all of it.
    """
    rng = np.random.default_rng(21)
    rows = np.kron(np.eye(4), rng.normal(size=(40, 2)))
    rows[:, 7] = rng.normal(size=160)
    rows = 6.0 * np.linalg.qr(rows)[0]
    measured = rows @ [2.0, 3.0, 2.0, 0.0, 0.0, 0.0, 0.0, 2.0] + rng.normal(size=160)
    names = ["a@0", "b@0", "a@1", "b@1", "a@2", "b@2", "a@3", "cloth"]
    problem = linear([group(name, [5.0]) for name in names], rows, measured)
    search, tried = searched(problem), list[str]()
    false = {"b@1": 0, "b@2": 0} if more else {}
    begun = search.fit(freeze(false), np.full(8, more))
    search.say = tried.append
    assert improved(search, begun).model == freeze({"a@0": 0, "b@0": 0, "a@1": 0, "cloth": 0})
    grown = ["a@1 + b@0 + cloth", "a@0 + a@1 + b@0 + cloth"]
    assert tried == (["the moduli alone"] * bool(false)) + grown


@pytest.mark.parametrize(("fewer", "begins"), [(4, "a@0 + a@1 + a@2"), (2, "a@0")])
def test_specimens_are_changed_at_once_on_the_way_to_few(fewer, begins):
    """As long as that is no more groups than may still come."""
    rng = np.random.default_rng(22)
    rows = 6.0 * np.linalg.qr(rng.normal(size=(90, 4)))[0]
    measured = rows @ [3.0, 2.0, 2.0, 1.0] + rng.normal(size=90)
    names = ["a@0", "a@1", "a@2", "b@2"]
    search, tried = searched(linear([group(name, [5.0]) for name in names], rows, measured)), []
    small = search.fit(freeze({}), np.zeros(4))
    other = freeze({"a@0": 0, "b@2": 0})
    search.fits[other] = replace(small, model=other, score=small.score - 1.0)
    search.say = tried.append
    improved(search, small, fewer)
    assert tried[0] == begins


def test_a_swap_between_specimens_is_the_change_of_neither():
    model, swap = freeze({"a@0": 0}), freeze({"b@1": 0})
    drop, growth = freeze({}), freeze({"a@0": 0, "c@2": 0})
    both = _of_each_specimen(model, [(1.0, swap), (3.0, growth), (2.0, drop)])
    assert both == freeze({"c@2": 0})
    assert _of_each_specimen(model, [(1.0, swap), (2.0, drop)]) is None


def test_forms_shrink_to_what_the_data_need():
    rng = np.random.default_rng(7)
    rows = rng.normal(size=(80, 4))
    measured = rows[:, 0] * 3.0 + rng.normal(size=80)
    problem = linear([group("a", [5.0] * 4, forms=((0,), (0, 1), (0, 1, 2, 3)))], rows, measured)
    assert explore(searched(problem), np.zeros(4)).model == freeze({"a": 0})


def test_growth_gathers_fewer_groups_than_the_best_model_has():
    """The truth is a sum of four: from below it is not gone through once more."""
    rng = np.random.default_rng(12)
    rows = rng.normal(size=(60, 6))
    measured = rows @ [1.0, 2.0, 3.0, 4.0, 0.0, 0.0] + 0.1 * rng.normal(size=60)
    problem = linear([group(f"g{i}", [1.0]) for i in range(6)], rows, measured)
    search = searched(problem)
    ways = Ways(search, np.zeros(6))
    ways.by_elimination()
    assert len(search.best.model) == 4
    before = set(search.fits)
    ways.from_below()
    grown = set(search.fits) - before
    assert max(len(model) for model in grown) <= 3


@pytest.mark.parametrize("sizes", [(1.0, 1.0, 1.0, 1.0), (4.0, 2.0, 2.0, 1.0)])
def test_growth_ends_where_the_changes_that_are_left_cannot_reach_the_best_model(sizes):
    """Of four parts, each of which takes off what it takes off alone: three are in vain.

    Also where three as large as the largest would not be.
    """
    rng = np.random.default_rng(12)
    rows = np.linalg.qr(rng.normal(size=(60, 6)))[0] * 10.0
    measured = rows @ [*sizes, 0.0, 0.0] + 0.1 * rng.normal(size=60)
    problem = linear([group(f"g{i}", [1.0]) for i in range(6)], rows, measured)
    search = searched(problem)
    ways = Ways(search, np.zeros(6))
    ways.by_elimination()
    assert len(search.best.model) == 4
    before = set(search.fits)
    ways.from_below()
    assert {len(model) for model in set(search.fits) - before} == {0}


def test_elimination_waits_where_everything_together_leaves_more():
    """Only what has a name was freed, all of it, and nothing taken out."""
    rng = np.random.default_rng(13)
    rows = rng.normal(size=(60, 4))
    measured = rows @ [1.0, 0.0, 0.0, 9.0] + 0.1 * rng.normal(size=60)
    search = searched(linear([group(f"g{i}", [10.0]) for i in range(4)], rows, measured))
    ways = Ways(search, np.zeros(4), fields=(owned("g3"),))
    ways.by_elimination(lambda: False)
    assert set(search.fits) == {freeze({"g0": 0, "g1": 0, "g2": 0})}
    found = ways.with_fields()
    assert found is search.best
    assert found.x[3] == pytest.approx(9.0, abs=0.1)
    assert improved(search, found).model == freeze({"g0": 0, "g3": 0})


def test_fields_are_freed_anew_where_their_first_way_was_a_trap():
    """From the origin nothing balances; or what is found is worse than a model it contains."""
    rng = np.random.default_rng(14)
    rows = rng.normal(size=(40, 2))
    measured = rows @ [1.0, 2.0] + 0.1 * rng.normal(size=40)
    problem = linear([group("g", [10.0]), group("f", [10.0])], rows, measured, end=20.0)
    search = searched(problem)
    beyond = Ways(search, np.zeros(2), fields=(owned("f"),), origin=np.full(2, 30.0))
    assert beyond.with_fields() is search.best
    named = freeze({"g": 0})
    ways = Ways(search, np.zeros(2), fields=(owned("f"),), origin=np.ones(2))
    before = problem.solves
    ways.with_fields()
    once = problem.solves - before
    search.fits[named] = replace(search.best, model=named, score=search.best.score - 1.0)
    ways.with_fields()
    assert problem.solves - before > 2 * once


def test_what_is_needed_on_a_slope_alone_is_let_go():
    """From a rough fit b makes up for the bend of a's curve; at the bottom it is null."""
    slope = np.linspace(0.5, 1.5, 40)

    def curve(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        bent = np.exp(x[0] * slope)
        return 30.0 * bent + 30.0 * slope**2 * x[1], np.stack(
            [30.0 * slope * bent, 30.0 * slope**2], axis=1
        )

    noise = np.random.default_rng(16).normal(size=40)
    groups = [group("a", [3.0], always=True), group("b", [3.0])]
    problem = Known(groups, curve(np.array([0.8, 0.0]))[0] + noise, curve)
    search = searched(problem)
    whole = search.layout.whole()
    search.fits[whole] = descend(problem, search.layout, whole, np.zeros(2), steps=1)
    assert improved(search, search.best).model == whole
    closely(search)
    assert search.best.converged
    assert search.best.model == freeze({})
    assert search.best.x[0] == pytest.approx(0.8, abs=0.02)


def test_several_effects_that_stand_for_a_field_are_let_go():
    """Each of four is worth its cost beside the field, all of them together are not."""
    rng = np.random.default_rng(15)
    base, _ = np.linalg.qr(rng.normal(size=(50, 4)))
    rows = np.column_stack([base.sum(axis=1), base])
    measured = 60.0 * rows[:, 0] + rng.normal(size=50)
    narrow = [group(f"n{i}", [60.0]) for i in range(4)]
    problem = linear([group("f", [2e4]), *narrow], rows, measured)
    search = searched(problem)
    ways = Ways(search, np.zeros(5), fields=(owned("f"),))
    assert search.fit(search.layout.whole(), np.zeros(5)) is not None
    ways.from_fields()
    assert search.best.model == freeze({"f": 0})


def test_several_groups_give_way_to_a_larger_form_of_one():
    """Beside both the larger form is not worth its cost, and neither can go before it is there.

    What would be let go first, by the forecast, is what has come.
    """
    rng = np.random.default_rng(3)
    base, _ = np.linalg.qr(rng.normal(size=(60, 6)))
    third, mixed, more = base[:, 3:].T
    # both of them together do what the third one of the larger form does, and a little more
    rows = np.column_stack([base[:, :4], third + mixed, third - mixed + 0.12 * more])
    measured = rows @ [200.0, 0.0, 0.0, 120.0, 0.0, 0.0] + rng.normal(size=60)
    groups = [
        group("shape", [1e4] * 4, forms=((0,), (0, 1, 2, 3))),
        group("scale", [60.0]),
        group("lens", [60.0]),
    ]
    search = searched(linear(groups, rows, measured))
    trap = search.fit(freeze({"shape": 0, "scale": 0, "lens": 0}), np.zeros(6))
    right = freeze({"shape": 1})
    forecast = search.forecasts(search.around(trap), trap.model)
    beside = right | freeze({"scale": 0, "lens": 0})
    assert forecast(beside) > trap.score  # as an addition it is not worth it,
    for one, other in (("scale", "lens"), ("lens", "scale")):
        assert forecast(freeze({"shape": 0, one: 0})) > trap.score  # nor can one of the others go,
        assert forecast(right | freeze({other: 0})) > trap.score  # also not for it
    assert improved(search, trap).model == right


def test_a_way_from_a_field_keeps_it():
    """What is in its place leads where it led from below."""
    rng = np.random.default_rng(16)
    rows = rng.normal(size=(60, 4))
    rows[:, 0] = rows[:, 1] + 0.5 * rows[:, 0]  # what the field does like the first effect
    measured = rows @ [0.0, 10.0, 1.0, 0.0] + rng.normal(size=60)
    groups = [group("f", [30.0]), *(group(f"n{i}", [30.0]) for i in range(3))]
    search = searched(linear(groups, rows, measured))
    assert search.fit(search.layout.whole(), np.zeros(4)) is not None
    Ways(search, np.zeros(4), fields=(owned("f"),)).from_fields()
    assert freeze({"f": 0, "n0": 0}) in search.fits
    assert all("f" in {name.effect for name, _ in model} for model in search.fits)


def test_no_equilibrium_is_lost_on_the_way():
    """Two coordinates that only differ far out, where nothing balances, stay within it."""
    rng = np.random.default_rng(8)
    rows = np.stack([np.ones(30), np.linspace(-1, 1, 30)], axis=1)
    measured = rows @ [1.0, 4.0] + 0.1 * rng.normal(size=30)
    groups = [group("m", [2.0], always=True), group("b", [2.0])]
    problem = linear(groups, 10 * rows, 10 * measured, end=3.0)
    best = explore(searched(problem), np.zeros(2))
    assert best.model == freeze({"b": 0})
    assert 2.9 < best.x[1] <= 3.0
    with pytest.raises(SolveError, match="nothing balances"):
        explore(searched(problem), np.full(2, 9.0))


def test_probabilities_are_those_of_the_evidence():
    scores = {
        freeze({"a": 0}): 10.0,
        freeze({"b": 0}): 10.0 + 2.0 * np.log(3.0),
        freeze({}): 300.0,
    }
    a, b, c = map(owned, "abc")
    found = weighed(scores, (a, b, c))
    assert found.groups == pytest.approx({a: 0.75, b: 0.25, c: 0.0}, abs=1e-12)
    assert found.best == freeze({"a": 0})
    assert found.rivals(a) == (b,)


def test_a_temper_takes_roots_of_the_evidence_but_not_of_what_was_believed_before():
    rows = np.eye(4)[:, :2]
    measured = np.array([3.0, 1.0, 0.0, 0.0])
    problem = linear([group("a", [2.0]), group("b", [2.0])], rows, measured)
    search = searched(problem)
    explore(search, np.zeros(2))
    for temper in (1.0, 2.0):
        found = weighed(scores(search, temper), search.names).groups
        worths = [(v**2 * 4.0 / 5.0 - np.log(5.0)) / temper for v in (3.0, 1.0)]
        assert list(found.values()) == pytest.approx(of_all(search.layout, worths), abs=1e-9)


def test_a_doubtful_group_beside_nothing_has_no_rival():
    found = weighed({freeze({"a": 0}): 0.0, freeze({}): 2.0}, (owned("a"),))
    assert 0.5 < found.groups[owned("a")] < 0.95
    assert found.rivals(owned("a")) == ()


def lifted(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A rim that lifts on one side, ever less (amplitude, side, bend), and tilts (two)."""
    angle, load = (g.ravel() for g in np.meshgrid(np.linspace(0, 6.2, 40), [0.5, 1.0, 2.0, 3.0]))
    size, side, bend, one, other = x
    rise, by_bend = load - bend * load**2, -(load**2)
    lift, turn = np.maximum(np.cos(angle - side), 0.0), np.sin(angle - side)
    value = size * rise * lift + load * (one * np.cos(angle) + other * np.sin(angle))
    columns = [
        rise * lift,
        size * rise * turn * (lift > 0.0),
        size * by_bend * lift,
        load * np.cos(angle),
        load * np.sin(angle),
    ]
    return 50.0 * value, 50.0 * np.stack(columns, axis=1)


def lifts(truth: list[float]) -> Known:
    groups = [
        group(
            "lift", [1.0, as_wide_as(2 * np.pi), 0.1], lower=np.array([0.0, -np.inf, -np.inf]),
            forms=((0, 1), (0, 1, 2)), governor=(0, 0, 0), period=(np.inf, 2 * np.pi, np.inf),
        ),
        group("tilt", [1.0, 1.0]),
    ]  # fmt: skip
    noise = np.random.default_rng(9).normal(size=160)
    return Known(groups, lifted(np.array(truth))[0] + noise, lifted)


@pytest.mark.parametrize("side", [0.0, 1.0, -3.0])
def test_before_any_data_each_side_is_as_likely(side: float) -> None:
    """What the data tell of it is worth as much on any, and nothing where they tell nothing."""
    layout = Layout.of([group("side", [as_wide_as(2.0 * np.pi)], period=(2.0 * np.pi,))])
    at, columns = np.array([side]), np.array([0])
    for stiffness in (40.0, 0.0):
        here = Linearised(at, columns, 0.0, np.zeros(1), np.array([[stiffness]]))
        seen, _ = quad(lambda a, h=stiffness: np.exp(-0.5 * h * a * a), -np.pi, np.pi)
        evidence = -2.0 * np.log(seen / (2.0 * np.pi))
        found = laplace(here, layout, columns)
        assert found.score == pytest.approx(evidence, abs=5e-3)
        assert found.x[0] == side
        assert Forecast.of(here, layout, columns).score(columns) == pytest.approx(found.score)


@pytest.mark.parametrize("side", [0.3, 1.6, -1.2, 2.9, -2.6])
def test_what_comes_from_one_side_is_seen_from_any(side):
    """At no lift at all nothing tells the side, and from the wrong one a lift is below nothing."""
    search = searched(lifts([0.8, side, 0.0, 0.0, 0.0]))
    Ways(search, np.zeros(5)).from_below()
    assert set(dict(search.best.model)) == {owned("lift")}
    assert np.cos(search.best.x[1] - side) > 0.999


@pytest.mark.parametrize("roughly", [False, True])
def test_no_descent_ends_at_no_lift_where_another_side_leads_down(roughly):
    """From the wrong side it falls to no lift at all, where all sides are one."""
    problem = lifts([0.8, 2.9, 0.0, 0.0, 0.0])
    layout, model = Layout.of(problem.groups), freeze({"lift": 0})
    wrong = np.array([0.5, 2.9 - np.pi, 0.0, 0.0, 0.0])
    fit = descend(problem, layout, model, wrong, roughly=roughly)
    assert fit.converged
    assert fit.x[0] == pytest.approx(0.8, abs=0.02)
    assert np.cos(fit.x[1] - 2.9) > 0.999


def test_where_nothing_lifts_a_descent_ends_at_no_lift():
    """What noise takes off from one side or another is no reason to go on for long."""
    problem = lifts([0.0, 0.0, 0.0, 0.0, 0.0])
    layout, model = Layout.of(problem.groups), freeze({"lift": 0})
    fit = descend(problem, layout, model, np.array([0.5, 1.0, 0.0, 0.0, 0.0]), roughly=True)
    assert fit.converged
    assert fit.x[0] < 0.02
    assert fit.steps < 10


def test_a_lift_is_no_tilt_and_a_lift_on_the_other_side():
    """Without a bend they are the same, and each step from one to the other is worse."""
    search = searched(lifts([0.8, 2.9, 0.03, 0.0, 0.0]))
    # max(0, c) = c + max(0, -c)
    trap = np.array([0.75, 2.9 - np.pi, 0.0, 0.75 * np.cos(2.9), 0.75 * np.sin(2.9)])
    fit = search.fit(freeze({"lift": 0, "tilt": 0}), trap)
    assert np.cos(fit.x[1] - 2.9) < -0.99
    best = improved(search, fit)
    assert best.model == freeze({"lift": 1})
    assert best.x[:3] == pytest.approx([0.8, 2.9, 0.03], abs=0.02)


def fixed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A rim that lifts on one side (three) in a fixture that tilts (two), less by a bend (one)."""
    load = np.repeat([0.5, 1.0, 2.0, 3.0], 40)
    value, columns = lifted(np.array([*x[:3], 0.0, 0.0]))
    tilt = columns[:, 3:] * (1.0 - x[5] * load[:, None])
    bent = -columns[:, 3:] @ x[3:5] * load
    return value + tilt @ x[3:5], np.column_stack([columns[:, :3], tilt, bent])


@pytest.mark.parametrize("seed", range(4))
def test_the_right_side_counts_even_where_it_leaves_a_little_more(seed: int) -> None:
    """A tilt that bends as the lift does makes up for the wrong side, and has more to fit with."""
    lift = lifts([0.0] * 5).groups[0]
    tilt = group("tilt", [1.0, 1.0, 0.1])
    truth = np.array([0.8, 2.9, 0.03, 0.0, 0.0, 0.0])
    noise = np.random.default_rng(seed).normal(size=160)
    search = searched(Known([lift, tilt], fixed(truth)[0] + noise, fixed))
    trap = np.array([0.8, 2.9 - np.pi, 0.03, 0.8 * np.cos(2.9), 0.8 * np.sin(2.9), 0.03])
    fit = search.fit(freeze({"lift": 1, "tilt": 0}), trap)
    assert np.cos(fit.x[1] - 2.9) < -0.99
    best = improved(search, fit)
    assert best.model == freeze({"lift": 1})
    assert best.x[[0, 2]] == pytest.approx([0.8, 0.03], abs=0.02)
    assert np.cos(best.x[1] - 2.9) > 0.999


def test_the_right_side_counts_where_the_same_model_is_worse_by_it() -> None:
    """What is left of the wrong side is taken as its own, though the right one needs no tilt."""
    lift, tilt = lifts([0.0] * 5).groups[0], group("tilt", [1.0, 1.0, 0.1])
    model = freeze({"lift": 1, "tilt": 0})
    truth = np.array([0.8, 2.9, 0.03, 0.0, 0.0, 0.0])
    trap = np.array([0.8, 2.9 - np.pi, 0.03, 0.8 * np.cos(2.9), 0.8 * np.sin(2.9), 0.03])
    measured = fixed(truth)[0] + np.random.default_rng(2).normal(size=160)

    def fit(start: np.ndarray) -> tuple[Search, Fit]:
        search = searched(Known([lift, tilt], measured, fixed))
        return search, search.fit(model, start)

    # as much of what the two sides differ by as makes the wrong one the better fit
    measured = measured + 11.0 * (fixed(fit(trap)[1].x)[0] - fixed(fit(truth)[1].x)[0])
    search, wrong = fit(trap)
    assert np.cos(wrong.x[1] - 2.9) < -0.99
    assert wrong.score < fit(truth)[1].score
    best = improved(search, wrong)
    assert best.model == freeze({"lift": 1})
    assert np.cos(best.x[1] - 2.9) > 0.999


def rippled(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `lifted`, and a rim that rises by orders 0, 2 and 4 in proportion to the load (five)."""
    angle, load = (g.ravel() for g in np.meshgrid(np.linspace(0, 6.2, 40), [0.5, 1.0, 2.0, 3.0]))
    value, columns = lifted(x[:5])
    waves = [np.ones_like(angle), *(f(m * angle) for m in (2, 4) for f in (np.cos, np.sin))]
    more = 50.0 * load[:, None] * np.stack(waves, axis=1)
    return value + more @ x[5:], np.concatenate([columns, more], axis=1)


@pytest.mark.parametrize("amplitude", [0.8, 0.2])
@pytest.mark.parametrize("side", [0.3, 1.6, -1.2, 2.9, -2.6])
def test_what_comes_from_one_side_is_found_where_waves_stand_for_it(side, amplitude):
    """A lift is half a tilt and waves of even orders: beside them no side of it takes off more."""
    lift, tilt = (Owned(name) for name in ("lift", "tilt"))
    groups = [*lifts([amplitude, side, 0.0, 0.0, 0.0]).groups, group("waves", [1.0] * 5)]
    measured = rippled(np.array([amplitude, side, *np.zeros(8)]))[0]
    measured += np.random.default_rng(9).normal(size=160)
    search = searched(Known(groups, measured, rippled))
    stands = np.zeros(10)
    stands[3:8] = amplitude * np.array([np.cos(side) / 2, np.sin(side) / 2, 1 / np.pi, 0.0, 0.0])
    search.fit(freeze({tilt: 0, Owned("waves"): 0}), stands)
    closely(search)
    assert search.best.model == freeze({lift: 0})
    assert np.cos(search.best.x[1] - side) > 0.999


@pytest.mark.parametrize("side", [0.3, 1.6, -2.6])
def test_what_bends_is_found_where_others_that_bend_stand_for_it(side: float) -> None:
    """Without its bend, of which nothing is seen where it is absent, a lift does less than they."""
    bend = 0.1
    angle, load = (g.ravel() for g in np.meshgrid(np.linspace(0, 6.2, 40), [0.5, 1.0, 2.0, 3.0]))
    risen = 50.0 * (load - bend * load**2)[:, None]
    ones = np.ones((160, 1))
    waves = [f(m * angle)[:, None] for m in (1, 2, 4, 6) for f in (np.cos, np.sin)]
    rigid = risen * np.hstack([*waves[:2], ones, *waves[2:]])

    def seen(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, columns = lifted(np.array([*x[:3], 0.0, 0.0]))
        return value + rigid @ x[3:], np.hstack([columns[:, :3], rigid])

    lift, tilt, rest = (
        lifts([0.0] * 5).groups[0],
        group("tilt", [1.0] * 2),
        group("rest", [1.0] * 7),
    )
    truth = np.array([0.3, side, bend])
    measured = seen(np.array([*truth, *np.zeros(9)]))[0] + np.random.default_rng(9).normal(size=160)
    search = searched(Known([lift, tilt, rest], measured, seen))
    search.fit(freeze({"tilt": 0, "rest": 0}), np.zeros(12))
    closely(search)
    assert search.best.model == freeze({"lift": 1})
    assert search.best.x[0] == pytest.approx(0.3, abs=0.02)
    assert np.cos(search.best.x[1] - side) > 0.999


@pytest.mark.parametrize("side", [0.0, 0.4, np.pi / 4, 1.9, -np.pi / 4])
def test_beside_a_fixture_the_best_side_takes_off_half_of_what_the_right_one_does(side):
    """It has taken the mean and half of a lift, whose opposite would do as well: cos 2φ is left."""

    def moved(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, columns = rippled(np.array([*x, 0.0, 0.0, 0.0, 0.0]))
        return value, columns[:, :6]

    groups = [*lifts([0.8, side, 0.0, 0.5, -0.3]).groups, group("shift", [1.0])]
    measured = moved(np.array([0.8, side, 0.0, 0.5, -0.3, 0.1]))[0]
    problem = Known(groups, measured, moved)
    layout = Layout.of(groups)
    x = descend(problem, layout, freeze({"tilt": 0, "shift": 0}), np.zeros(6)).x

    def taken(angle: float) -> float:
        along = np.array(x)
        along[1] = angle
        slope, curvature = problem.along(along, 0, None)
        return max(slope, 0.0) ** 2 / curvature

    most = max(taken(angle) for angle in np.linspace(-np.pi, np.pi, 73))
    _, found = best_side(problem, layout, x, 1, None)
    assert found >= 0.45 * most


def humped(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A lift (amplitude, side) on one side, and less and narrower on the other."""
    angle = np.linspace(0.0, 6.2, 160)
    near, far = np.cos(angle - x[1]), -np.cos(angle - x[1])
    shape = np.maximum(near, 0.0) + 0.8 * np.maximum(far, 0.0) ** 3
    turn = np.sin(angle - x[1]) * ((near > 0.0) - 2.4 * np.maximum(far, 0.0) ** 2)
    return 50.0 * x[0] * shape, 50.0 * np.stack([shape, x[0] * turn], axis=1)


def test_another_side_of_the_same_model_is_kept():
    """It is fitted apart, since the side that it was fitted from before is a minimum too."""
    lift = group(
        "lift", [1.0, as_wide_as(2 * np.pi)], lower=np.array([0.0, -np.inf]),
        governor=(0, 0), period=(np.inf, 2 * np.pi),
    )  # fmt: skip
    noise = np.random.default_rng(9).normal(size=160)
    search = searched(Known([lift], humped(np.array([0.8, 0.5]))[0] + noise, humped))
    wrong = search.fit(freeze({"lift": 0}), np.array([0.8, 0.5 - np.pi]))
    assert np.cos(wrong.x[1] - 0.5) < -0.999
    found = improved(search, wrong)
    assert search.best is found
    assert np.cos(found.x[1] - 0.5) > 0.999


def test_what_two_groups_stand_for_is_found_where_one_of_them_is_gone():
    """Beside both it does nothing, so no forecast sees it: in the place of one it does all."""
    first, second = np.linalg.qr(np.random.default_rng(3).normal(size=(60, 2)))[0].T * 30.0
    both = first + second

    def curve(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        left = 1.0 - x[0] * x[1]
        value = x[0] ** 3 * first + x[1] ** 3 * second + x[2] * left * both
        rows = [
            3.0 * x[0] ** 2 * first - x[2] * x[1] * both,
            3.0 * x[1] ** 2 * second - x[2] * x[0] * both,
            left * both,
        ]
        return value, np.stack(rows, axis=1)

    one, other, true = (Owned(name) for name in ("one", "other", "true"))
    groups = [replace(group(str(name), [1.0]), id=name) for name in (one, other, true)]
    search = searched(Known(groups, both, curve))
    stands = search.fit(freeze({one: 0, other: 0}), np.ones(3))
    assert improved(search, stands) is stands
    closely(search, instead=())
    assert search.best.model == stands.model
    closely(search)
    assert search.best.model == freeze({true: 0})


def of_bumps(effect: float, size: float, seed: int) -> tuple[Known, np.ndarray, np.ndarray]:
    """A field of 30 bumps of a size, and an effect that is a direction in it."""
    rng = np.random.default_rng(seed)
    bumps = rng.normal(size=(400, 30))
    rows = np.column_stack([bumps, bumps @ np.linspace(-1.0, 1.0, 30)])
    truth = np.append(size * rng.normal(size=30), effect)
    measured = rows @ truth + rng.normal(size=400)
    groups = [group("field", [10.0] * 30), group("effect", [1.0])]
    return linear(groups, rows, measured), rows, measured


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_fields_size_is_the_likeliest_of_the_data(size: float):
    """By the marginal likelihood, a Gaussian of the data alone; and near that it was drawn with."""
    problem, rows, measured = of_bumps(0.0, size, seed=8)
    layout, model = Layout.of(problem.groups), freeze({"field": 0})
    fit = descend(problem, layout, model, np.zeros(31))
    found = amplitudes(fit.here, layout, [owned("field")])[owned("field")]
    assert 10.0 * found == pytest.approx(size, rel=0.3)

    def lost(factor: float) -> float:
        problem.groups[0] = layout.groups[owned("field")].scaled(factor)
        return marginal(problem, rows, layout.columns(model), measured)

    assert lost(found) < min(lost(0.95 * found), lost(found / 0.95))


def test_a_field_that_is_nowhere_goes_to_nothing_beside_one_that_is():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(400, 40))
    measured = rows[:, :20] @ rng.normal(size=20) + rng.normal(size=400)
    problem = linear([group("here", [5.0] * 20), group("nowhere", [5.0] * 20)], rows, measured)
    layout = Layout.of(problem.groups)
    fit = descend(problem, layout, layout.whole(), np.zeros(40))
    found = amplitudes(fit.here, layout, [owned("here"), owned("nowhere")])
    assert found[owned("here")] == pytest.approx(0.2, rel=0.4)
    assert found[owned("nowhere")] < 0.02


def test_an_effect_in_a_field_is_seen_once_that_is_as_large_as_it_is():
    """By a field ten times too wide it costs more than it saves."""
    problem, _, _ = of_bumps(1.0, 0.3, seed=5)
    layout, alone, both = Layout.of(problem.groups), freeze({"field": 0}), {"field": 0, "effect": 0}
    fit = descend(problem, layout, alone, np.zeros(31))
    assert descend(problem, layout, freeze(both), np.zeros(31)).score > fit.score
    scaled = layout.scaled(amplitudes(fit.here, layout, [owned("field")]))
    alone_now, with_it = (
        descend(problem, scaled, freeze(forms), np.zeros(31)) for forms in ({"field": 0}, both)
    )
    assert with_it.score < alone_now.score - 6.0


class Edge(Known):
    """Balances by two coordinates, and no further."""

    tries = 0

    def linearise(self, x: np.ndarray, columns: np.ndarray, near: Any = None) -> Linearised:
        self.tries += 1
        if len(columns) > 2:
            raise SolveError(
                "no step makes progress", pressure=0.2, reached=0.2, iteration=1, residual_norm=1.0,
                parameters={},
            )  # fmt: skip
        return super().linearise(x, columns, near)


def test_what_ends_on_the_edge_of_stability_is_kept():
    """Nothing can be looked at beside it, so nothing is forecast."""
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(30, 4))
    measured = rows @ [2.0, 0.0, 0.0, 1.5] + 0.1 * rng.normal(size=30)
    a, b, c, d = (Owned(name) for name in "abcd")
    groups = [replace(group(str(n), [1.0]), id=n) for n in (a, b, c, d)]
    search = searched(Edge(groups, measured, lambda x: (rows @ x, rows)))
    fit = search.fit(freeze({a: 0, d: 0}), np.zeros(4))
    assert improved(search, fit) is fit
    assert promise(search, fit) == fit.score
    closely(search)
    assert search.best.model == fit.model
    known = scores(search, 1.0)
    assert known.keys() == search.fits.keys()
    assert known[fit.model] == pytest.approx(search.best.score, rel=1e-12)


def test_drops_go_round(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was tried from the model before comes after what was not: once for each, not each time.

    Two by two, and no forecast is asked, so that every drop is fitted.
    """
    tried: list[str] = []

    def without(shared: Any, model: Any) -> list[Fit]:
        tried.append("".join(sorted(str(name) for name, _ in model)))
        return _without(shared, model)

    closely_at = "bulgefit.gap.evidence.closely."
    monkeypatch.setattr(closely_at + "improved", lambda search, fit: fit)
    monkeypatch.setattr(closely_at + "_without", without)
    monkeypatch.setattr(closely_at + "_ABREAST", 2)
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(60, 6))
    measured = rows @ [2.0, 3.0, -2.0, 0.0, 0.0, 0.0] + 0.1 * rng.normal(size=60)
    names = [Owned(n) for n in "abcdef"]
    groups = [replace(group(str(n), [1.0]), id=n) for n in names]
    search = searched(linear(groups, rows, measured, variance=0.01))
    search.fit(freeze(dict.fromkeys(names, 0)), np.zeros(6))
    closely(search)
    assert search.best.model == freeze(dict.fromkeys(names[:3], 0))
    begun = ["bcdef", "acdef", "abdef", "abcef"]  # without d it is better: on from e
    assert tried == [*begun, "abcf", "abce", "bcf", "acf", "abf", "abc", "bc", "ac", "ab"]


def test_drops_go_on_where_one_promised_more_than_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fitted to its end it is worse than what it was dropped from: the others are tried still."""
    tried: list[str] = []

    def without(shared: Any, model: Any) -> list[Fit]:
        tried.append("".join(sorted(str(name) for name, _ in model)))
        (found,) = _without(shared, model)
        return [replace(found, score=shared[1].score - 5.0)] if len(tried) == 1 else [found]

    monkeypatch.setattr("bulgefit.gap.evidence.closely._without", without)
    monkeypatch.setattr("bulgefit.gap.evidence.closely._ABREAST", 1)
    rng = np.random.default_rng(6)
    rows = rng.normal(size=(60, 3))
    measured = rows @ [2.0, 3.0, -2.0] + 0.1 * rng.normal(size=60)
    search = searched(linear([group(n, [1.0]) for n in "abc"], rows, measured, variance=0.01))
    whole = search.fit(freeze(dict.fromkeys("abc", 0)), np.zeros(3))
    closely(search)
    assert tried == ["bc", "ac", "ab"]
    assert search.best.model == whole.model
    assert search.fits[freeze({"b": 0, "c": 0})].score > search.best.score


def test_forms_are_ordered_by_what_they_contain():
    """Two forms of which neither contains the other, and one that contains both."""
    g = group("a", [1.0] * 3, forms=((0,), (1,), (0, 1), (2,), (0, 1, 2)))
    assert [g.below(form) for form in range(5)] == [[], [], [0, 1], [], [2, 3]]
    assert g.above(None) == [0, 1, 2, 3, 4]
    assert [g.above(form) for form in range(5)] == [[2, 4], [2, 4], [4], [4], []]


def test_what_two_models_contain_is_their_common_form_not_the_lower_number():
    g = group("a", [1.0] * 3, forms=((0,), (0, 1), (0, 2), (0, 1, 2)))
    layout = Layout.of([g, group("b", [1.0]), group("c", [1.0], forms=())])
    assert g.common(1, 2) == 0
    assert g.common(3, 2) == 2
    assert group("d", [1.0] * 2, forms=((0,), (1,))).common(0, 1) is None
    one, other = freeze({"a": 1, "b": 0}), freeze({"a": 2, "c": 0})
    assert layout.common(one, other) == layout.common(other, one) == freeze({"a": 0})


def sagged(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A shift by two shapes, a sag that shifts by one and lifts by its square, and a lift."""
    t = np.linspace(-1.0, 1.0, 60)
    one, rise = 40.0 * (1.0 - t**2), 10.0 * np.cos(3.0 * t)
    # what stands for the square: close to it, not the same
    stand = rise + 2.0 * np.sin(6.0 * t)
    value = x[0] * one + x[1] * 40.0 * t - x[2] * one + x[2] ** 2 * rise + x[3] * stand
    columns = [one, 40.0 * t, -one + 2.0 * x[2] * rise, stand]
    return value, np.stack(columns, axis=1)


@pytest.mark.parametrize("sag", [1.2, -1.2])
def test_what_another_hides_but_for_its_square_is_found_where_a_third_stands_for_that(sag):
    """Beside the shift a sag takes nothing off at none, and half of it only half of its square."""
    shift, sags, stand = (Owned(name) for name in ("shift", "sag", "stand"))
    groups = [
        group(shift, [1.0, 1.0]),
        group(sags, [2.0], hidden_by=(shift,)),
        group(stand, [2.0]),
    ]
    truth = np.array([0.0, 0.5, sag, 0.0])
    measured = sagged(truth)[0] + np.random.default_rng(7).normal(size=60)
    search = searched(Known(groups, measured, sagged))
    fit = search.fit(freeze({shift: 0, stand: 0}), np.zeros(4))
    around = search.around(fit)
    own = search.layout.own(shift, 0)
    x = handed_over(around, search.layout, own, sags)
    # to first order the same, by the misfit's own derivatives, and the sag has it all
    assert x[2] == pytest.approx(-fit.x[0], rel=1e-2)
    moved = sagged(fit.x)[1] @ (x - fit.x)
    assert np.abs(moved).max() < 0.01 * np.abs(40.0 * x[2])
    best = improved(search, fit)
    assert best.model == freeze({shift: 0, sags: 0})
    assert best.x[2] == pytest.approx(sag, abs=0.1)


def test_a_form_gives_way_to_either_of_its_parts():
    """Of two halves the first has no say: the search ends at the second, from wherever it began."""
    rng = np.random.default_rng(12)
    rows = rng.normal(size=(60, 5))
    measured = rows @ [1.0, 0.0, 0.0, 2.0, 2.0] + rng.normal(size=60)
    groups = [
        group("m", [5.0], always=True),
        group("a", [5.0] * 4, forms=((0, 1), (2, 3), (0, 1, 2, 3))),
    ]
    problem = linear(groups, rows, measured)
    layout = Layout.of(problem.groups)
    for form in (0, 2):
        search = Search(problem, layout, (owned("a"),))
        begun = search.fit(freeze({"a": form}), layout.null)
        assert improved(search, begun).model == freeze({"a": 1})
        drops = {dict(m).get(owned("a")) for m in smaller(search.layout, freeze({"a": 2}))}
        assert drops == {None, 0, 1}


def test_a_step_within_rows_is_the_constrained_optimum() -> None:
    """By the conditions of Karush, Kuhn and Tucker: held back by nothing but the rows it is at."""
    rng = np.random.default_rng(3)
    half = rng.normal(size=(6, 6))
    matrix, slope, lower = half @ half.T + np.eye(6), 5.0 * rng.normal(size=6), np.full(6, -np.inf)
    free, same = bounded_within(slope, matrix, lower, [])
    np.testing.assert_array_equal(free, bounded_optimum(slope, matrix, lower))
    np.testing.assert_array_equal(same, matrix)
    rows = [rng.normal(size=6) for _ in range(2)]
    rows = [row * factor / abs(row @ free) for row, factor in zip(rows, (3.0, 0.2), strict=True)]
    step, stiffer = bounded_within(slope, matrix, lower, rows)
    assert abs(rows[0] @ step) == pytest.approx(1.0, rel=1e-9)
    assert abs(rows[1] @ step) < 1.0
    pull = slope - matrix @ step
    np.testing.assert_allclose(pull, (pull @ rows[0]) / (rows[0] @ rows[0]) * rows[0], atol=1e-9)
    assert np.sign(pull @ rows[0]) == np.sign(free @ rows[0])
    np.testing.assert_allclose(stiffer @ step, slope, atol=1e-9)
    lower[:] = step + 0.1 * np.abs(step) * (np.arange(6) == 2)
    bound, _ = bounded_within(slope, matrix, lower, rows)
    assert (bound >= lower).all()
    assert max(abs(row @ bound) for row in rows) <= 1.001


class Edged(Known):
    """Two coordinates: at 1 of the first nothing is left of 1 - x, what keeps it stable."""

    told = True

    def again(self, here: Linearised, x: np.ndarray) -> Linearised:
        if x[0] >= 1.0:
            raise LostStabilityError(
                "lost", "edge", pressure=0.1, reached=0.1, iteration=0, residual_norm=0.0,
                parameters={},
            )  # fmt: skip
        return super().again(here, x)

    def kept_from(self, brink: Any, here: Linearised) -> np.ndarray | None:
        assert brink == "edge"
        return np.array([-1.0 / (1.0 - here.x[0]), 0.0]) if self.told else None


@pytest.mark.parametrize("told", [True, False])
def test_a_descent_goes_along_a_brink_and_not_over_it(told: bool) -> None:
    """Without what is kept the trust region shrinks until the second does not move, either."""

    def curve(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # what lies beyond pulls, and the more the nearer: as shapes do that are about to give way
        rise = 1.0 / max(1.0 - x[0], 1e-12)
        value = np.array([10.0 * x[0] + np.log(rise), x[1] + 0.3 * x[1] ** 2])
        return value, np.array([[10.0 + rise, 0.0], [0.0, 1.0 + 0.6 * x[1]]])

    problem = Edged([group("a", [1.0, 1.0], always=True)], np.array([60.0, 40.0]), curve)
    problem.told = told
    layout = Layout.of(problem.groups)
    found = descend(problem, layout, freeze({}), layout.null, steps=15)
    best = minimize_scalar(
        lambda y: (40.0 - y - 0.3 * y**2) ** 2 + y**2, bounds=(0.0, 20.0), method="bounded"
    )
    assert found.x[0] < 1.0
    assert (abs(found.x[1] - best.x) < 0.05) == told
