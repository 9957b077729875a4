"""An objective over free parameters, in coordinates that suit a minimiser."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key, Parameter, by_key, of_specimen
from bulgefit.effects.registry import parameter_named
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.free import (
    AT_BOUND,
    at_end,
    bounded,
    freed,
    held_values,
    stated_ratio,
    turns,
    within,
)
from bulgefit.fitting.guess import bounds_from, start_box
from bulgefit.fitting.l1 import Rows
from bulgefit.fitting.objective import Objective
from bulgefit.model.description import check_needs
from bulgefit.model.inflation import Shapes
from bulgefit.model.parameters import (
    HELD_BY_DEFAULT,
    Material,
    check_replaced,
    free_parameters,
    held_by,
    parameters_of,
)

__all__ = ["Evaluation", "Prior", "Problem"]

Floats = NDArray[np.floating]

Of = TypeVar("Of")

#: Exponent of what priors raise a sum of absolute deviations by, before numbers end.
_LARGEST = 600.0
#: What the virtual test calls the material's constants.
_CONSTANTS = ("E1", "E2", "G12", "nu12")


@dataclass(frozen=True)
class Prior:
    """What is believed of a parameter before the fit: mean and standard deviation, in its unit."""

    mean: float
    deviation: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One point of the search.

    Attributes
    ----------
    values : dict of str to float
        Free parameters in their units.
    value : float
        The objective, priors included; NaN where the solve failed.
    error : str
        Why it failed, else "".
    slope : (free,) array or None
        Derivative of the objective by the coordinates, if asked for.
    rows : Rows or None
        The objective linearised in the coordinates, with them.
    shapes : list of Shapes or None
    """

    values: dict[str, float]
    value: float
    error: str = ""
    slope: Floats | None = None
    rows: Rows | None = None
    shapes: list[Shapes] | None = None


class Problem:
    """Objective, material kind, and what is free.

    Coordinates run from 0 to 1 between the bounds of what each parameter steps in: the logarithm
    of a modulus, since displacements are far more linear in log E than in E.

    Parameters
    ----------
    objective : Objective
    kind : str
        A key of `bulgefit.model.parameters.MATERIALS`.
    free : iterable of str
        Freed beyond the moduli.
    bounds : mapping of name to (lower, upper), optional
        Default: from the tests' apex (`bulgefit.fitting.guess`). Equal ones hold a modulus.
    held : mapping of name to value, optional
        Values of parameters that are not free, `effect.parameter` and test i's own
        `effect.parameter@i` among them; default the tests' Poisson ratio and every effect's null.
    effects : iterable of str
        Freed beside the moduli: ids of effects, or of one parameter (`effect.parameter`).
    priors : mapping of name to Prior, optional
    """

    def __init__(
        self,
        objective: Objective,
        kind: str = "orthotropic",
        *,
        free: Iterable[str] = (),
        bounds: Mapping[str, tuple[float, float]] | None = None,
        held: Mapping[str, float] | None = None,
        effects: Iterable[str] = (),
        priors: Mapping[str, Prior] | None = None,
    ) -> None:
        self.objective, self.kind = objective, kind
        tests, given = objective.tests, by_key(bounds or {})
        ours = {p.name for p in parameters_of(kind)}
        implied = {n: b for n, b in bounds_from(tests).items() if n in ours}
        limits = implied | _of_material(given)
        moduli = free_parameters(kind, free, limits)
        beside = freed(effects, tests)
        fixed = held_values(held or {}, ours, len(tests))
        for i, test in enumerate(tests):
            check_needs(of_specimen(fixed, i), test)
        by_bounds = {Key("", n): ends[0] for n, ends in limits.items() if held_by(ends)}
        self.keys = (*(Key("", p.name) for p in moduli), *beside)
        self.free = (*moduli, *(bounded(key, given) for key in beside))
        for key in fixed:
            if key.name in {own.name for own in self.keys}:
                raise InputError(f"hold: {key} is fitted; hold it or fit it")
        asked = (*self.keys, *fixed)
        check_replaced(
            [str(key) for key in asked if key.effect], [k.name for k in asked if not k.effect]
        )
        if not self.free:
            raise InputError(
                "bounds: they hold everything, and nothing is left to fit; widen those of one, or "
                "compare what is held (bulgefit evaluate)"
            )
        for key in given:
            if key not in by_bounds:
                self._meant(key, "bounds")
        stated = _of_material(fixed | by_bounds)
        self.held = {
            name: stated[name] if name in stated else stated_ratio(tests)
            for name in (p.name for p in parameters_of(kind))
            if Key("", name) not in self.keys
        }
        self.held_effects = {key: value for key, value in fixed.items() if key.effect}
        self._check_held_ratio()
        self.priors = {
            own: _possible(prior, key)
            for key, prior in by_key(priors or {}).items()
            for own in self._meant(key, "prior")
        }
        self._lower = np.array([p.to_coordinate(p.lower) for p in self.free])
        self._upper = np.array([p.to_coordinate(p.upper) for p in self.free])
        self._box = _start_box(self, given)
        self.all_data = False

    def with_objective(self, objective: Objective) -> Problem:
        """The same parameters and bounds with another objective."""
        other = copy(self)
        other.objective = objective
        return other

    def on_all_data(self) -> Problem:
        """The same, whose values and slopes are those of all data, not of a sample."""
        other = copy(self)
        other.all_data = True
        return other

    def _check_held_ratio(self) -> None:
        """Refuse a Poisson's ratio with which no moduli within the bounds are admissible.

        Where any are, the largest E1 beside the least E2 is: E1/E2 has to exceed nu12². It is not
        asked of a ratio that an effect takes the place of.
        """
        acting = [key for key in (*self.keys, *self.held_effects) if key.effect]
        replaced = any(parameter_named(key.name).null is None for key in acting)
        if replaced or not any(name in HELD_BY_DEFAULT for name in self.held):
            return
        pairs = zip(self.keys, self.free, strict=True)
        best = {
            key.name: p.upper if key.name == "E1" else p.lower for key, p in pairs if not key.effect
        }
        try:
            Material(self.kind, {**self.held, **best}).stiffness()
        except InputError as error:
            raise InputError(
                f"no moduli within their bounds go with what is held: {error}"
            ) from None

    def _meant(self, key: Key, where: str) -> list[Key]:
        """What is free by a key: itself, or each test's own where it names no test; InputError."""
        found = [own for own in self.keys if key in (own, own._replace(specimen=None))]
        if not found:
            known = ", ".join(map(str, self.keys))
            raise InputError(f"{where}: {key} is not fitted (fitted: {known})")
        return found

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return len(self.free)

    @property
    def scattered(self) -> NDArray[np.intp]:
        """Coordinates whose starts are scattered: the material's."""
        return np.flatnonzero([not key.effect for key in self.keys])

    def start(self, point: Floats) -> Floats:
        """Coordinates of a start from a point (scattered,) of the unit cube."""
        pairs = zip(self.free, self.keys, strict=True)
        z = self.coordinates({p.name: self._start_of(p, key) for p, key in pairs})
        low, high = self._box
        z[self.scattered] = low + (high - low) * point
        return np.clip(z, *self._believable())

    def _believable(self) -> tuple[Floats, Floats]:
        """Coordinates (free,) between which starts lie: within the bounds.

        And, where priors raise the objective, not so far from their means that numbers end: no
        optimum lies there.
        """
        low, high = np.zeros(self.size), np.ones(self.size)
        if self.objective.squared or not self.priors:
            return low, high
        counted = self.objective.count / self._inflation
        far = np.sqrt(2.0 * _LARGEST * counted / len(self.priors))
        for j, (key, p) in enumerate(zip(self.keys, self.free, strict=True)):
            if (prior := self.priors.get(key)) is not None:
                away = far * prior.deviation * np.array([-1.0, 1.0])
                ends = np.clip(prior.mean + away, p.lower, p.upper)
                along = np.array([p.to_coordinate(float(end)) for end in ends])
                low[j], high[j] = (along - self._lower[j]) / (self._upper[j] - self._lower[j])
        return low, high

    def keyed(self, z: Floats) -> dict[Key, float]:
        """Free parameters at coordinates z in [0, 1]."""
        along = self._lower + (self._upper - self._lower) * np.asarray(z)
        return {
            key: within(p, float(np.clip(p.from_coordinate(float(c)), p.lower, p.upper)))
            for key, p, c in zip(self.keys, self.free, along, strict=True)
        }

    def idle(self, z: Floats) -> list[tuple[int, int]]:
        """Places of parameters with a period and of what governs each, where that is at its null.

        A whole period lies within their bounds.
        """
        values, found = self.keyed(z), []
        for j, (key, p) in enumerate(zip(self.keys, self.free, strict=True)):
            governor = key._replace(parameter=p.governor or "")
            if turns(p) and governor in self.keys:
                g = self.keys.index(governor)
                own = self.free[g]
                near = AT_BOUND * (own.upper - own.lower)
                if abs(values[governor] - (own.null or 0.0)) <= near:
                    found.append((j, g))
        return found

    def awoken(self, z: Floats, turning: int, governor: int, turn: float) -> Floats:
        """Coordinates with one of `idle` turned by a part of its period, and its governor there."""
        values, p, own = self.keyed(z), self.free[turning], self.keys[governor]
        assert p.period is not None
        values[self.keys[turning]] = within(p, values[self.keys[turning]] + turn * p.period)
        values[own] = self._start_of(self.free[governor], own)
        return self.coordinates({str(key): value for key, value in values.items()})

    def values(self, z: Floats) -> dict[str, float]:
        """The same under their names, as results tell them."""
        return {str(key): value for key, value in self.keyed(z).items()}

    def at_bound(self, z: Floats) -> NDArray[np.bool_]:
        """Which free parameters sit at a bound, (free,)."""
        values = self.values(z)
        return np.array([at_end(p, values[p.name]) for p in self.free])

    def value_at(self, index: int, coordinate: float) -> float:
        """A free parameter's value at its coordinate, within its bounds or not."""
        along = self._lower[index] + (self._upper[index] - self._lower[index]) * coordinate
        return self.free[index].from_coordinate(float(along))

    def value_slope(self, index: int, z: Floats) -> float:
        """∂(a free parameter's value)/∂(its coordinate)."""
        step = 1e-6
        ends = [self.value_at(index, z[index] + h) for h in (-step, step)]
        return (ends[1] - ends[0]) / (2.0 * step)

    def coordinates(self, values: Mapping[str, float]) -> Floats:
        """Coordinates of given free parameters."""
        along = np.array([p.to_coordinate(values[p.name]) for p in self.free])
        return np.asarray((along - self._lower) / (self._upper - self._lower))

    def material(self, z: Floats) -> Material:
        """The material at coordinates z (not checked for admissibility)."""
        values = {**self.held, **_of_material(self.keyed(z))}
        return Material(self.kind, {p.name: values[p.name] for p in parameters_of(self.kind)})

    def effects(self, z: Floats) -> dict[Key, float]:
        """Values of effects' parameters, held and fitted."""
        fitted = {key: value for key, value in self.keyed(z).items() if key.effect}
        return {**self.held_effects, **fitted}

    def of_tests(self, z: Floats) -> list[dict[str, float]]:
        """What each test's virtual twin is given."""
        constants, effects = self.material(z).constants(), self.effects(z)
        count = len(self.objective.tests)
        return [{**constants, **of_specimen(effects, i)} for i in range(count)]

    def names_of_tests(self) -> list[tuple[str, ...]]:
        """What each test's virtual twin differentiates by."""
        constants = _CONSTANTS if any(not key.effect for key in self.keys) else ()
        return [
            (*constants, *(k.name for k in self.keys if k.effect and k.specimen in (None, i)))
            for i in range(len(self.objective.tests))
        ]

    def columns(self, z: Floats) -> list[Floats]:
        """∂(what each test differentiates by)/∂z, (names, free) each."""
        material, values = self.material(z), self.keyed(z)
        slopes = [p.slope(values[key]) for key, p in zip(self.keys, self.free, strict=True)]
        by_value = np.array(slopes) * (self._upper - self._lower)
        every = [p.name for p in parameters_of(self.kind)]
        by_material = material.constants_derivative()
        out = []
        for i, names in enumerate(self.names_of_tests()):
            columns = np.zeros((len(names), self.size))
            for j, (key, p) in enumerate(zip(self.keys, self.free, strict=True)):
                if not key.effect:
                    columns[: len(_CONSTANTS), j] = by_material[:, every.index(p.name)]
                elif key.specimen in (None, i):
                    columns[names.index(key.name), j] = 1.0
            out.append(columns * by_value)
        return out

    def shapes(self, z: Floats, *, derivatives: bool = False) -> list[Shapes]:
        """Balanced shapes of every test; raises SolveError or InputError."""
        names = self.names_of_tests() if derivatives else None
        return self.objective.shapes(self.of_tests(z), names)

    def evaluate(self, z: Floats, *, derivatives: bool = False) -> Evaluation:
        """The objective at z; a failed solve is an evaluation whose value is NaN."""
        values = self.values(z)
        try:
            shapes = self.shapes(z, derivatives=derivatives)
        except (SolveError, InputError) as error:
            return Evaluation(values, float("nan"), str(error))
        if not derivatives and (self.all_data or not self.objective.is_sampled):
            value = self.objective.value(shapes)
            return Evaluation(values, self._believed(value, z), shapes=shapes)
        names, columns = self.names_of_tests(), self.columns(z)
        rows = self.objective.rows(shapes, names, columns)
        if self.all_data and self.objective.is_sampled:
            value, slope = self.objective.slope(shapes, names, columns)
        else:
            value, slope = rows.value(), rows.slope()
        if self.priors:
            slope = (slope + self.pull(value, z)[1]) * self.raised(z)
        return Evaluation(values, self._believed(value, z), "", slope, rows, shapes)

    def pull(self, value: float, z: Floats) -> tuple[Floats, Floats]:
        """Hessian and slope by the coordinates that the priors add to an objective of this value.

        ½ q, with q = Σ ((x - m)/s)² of the values x, joins a likelihood as it is. The sum of
        absolute deviations is, up to a constant, minus the logarithm of a Laplace likelihood of
        unknown scale: n/v ln F of n values that count, v of which count as one (`_inflation`);
        there the priors add F v/n times as much, and all of it is `raised`.
        """
        hessian, slope = np.zeros((self.size, self.size)), np.zeros(self.size)
        weight = self._weight_of_priors(value)
        values = self.keyed(z)
        for j, (key, p) in enumerate(zip(self.keys, self.free, strict=True)):
            prior = self.priors.get(key)
            if prior is not None:
                by_z = p.slope(values[key]) / p.by_value(values[key])
                by_z *= self._upper[j] - self._lower[j]
                slope[j] = weight * (values[key] - prior.mean) / prior.deviation**2 * by_z
                hessian[j, j] = weight * (by_z / prior.deviation) ** 2
        return hessian, slope

    def raised(self, z: Floats) -> float:
        """Factor by which the priors raise a sum of absolute deviations and its slope.

        n/v ln F + ½ q falls as F exp(½ q v/n) does; q, n and v as in `pull`.
        """
        if self.objective.squared or not self.priors:
            return 1.0
        exponent = 0.5 * self._squares(z) * self._inflation / self.objective.count
        return float(np.exp(min(exponent, _LARGEST)))

    def scores_of_priors(self, value: float, z: Floats) -> Floats:
        """Covariance of the slope that the priors add, if their means are off by their deviations.

        The slope is w (v - m)/s² by the value: its variance is w times the Hessian's w/s².
        """
        return self._weight_of_priors(value) * self.pull(value, z)[0]

    def without_prior(self, key: Key) -> Problem:
        """The same without what is believed of one parameter."""
        other = copy(self)
        other.priors = {own: prior for own, prior in self.priors.items() if own != key}
        return other

    def _believed(self, value: float, z: Floats) -> float:
        if self.objective.squared:
            return value + 0.5 * self._squares(z)
        return value * self.raised(z)

    def _squares(self, z: Floats) -> float:
        """Σ ((v - m)/s)² of the priors."""
        values = self.keyed(z)
        return sum(((values[key] - p.mean) / p.deviation) ** 2 for key, p in self.priors.items())

    def _weight_of_priors(self, value: float) -> float:
        if self.objective.squared or not self.priors:
            return 1.0
        return value * self._inflation / self.objective.count

    @property
    def _inflation(self) -> float:
        """Of the noise, the mean over the tests: so many values count as one."""
        return float(np.mean([n.inflation if n else 1.0 for n in self.objective.noise()]))

    def fall_by(self, part: float, value: float) -> float:
        """What a part of a parameter's standard error changes the objective by at its optimum.

        A whole one changes minus the logarithm of a likelihood by a half, and so n ln F of a sum
        of absolute deviations F over n values. That takes every value as independent: where they
        correlate it is less than the part that was asked for, and descents go on for longer.
        """
        fall = 0.5 * part**2
        return fall if self.objective.squared else fall * value / self.objective.count

    def worst(self) -> float:
        """The objective of a model that does not deform: worse than any that does."""
        if self.objective.is_sampled and not self.all_data:
            none = [()] * len(self.objective.tests)
            looks = self.objective.looks(None, none, sampled=True)
            sums = (look.scale * self.objective.summed(look.residual) for look in looks)
            return float(sum(np.sum(of_one) for of_one in sums))
        return self.objective.value(None)

    def _start_of(self, parameter: Parameter, key: Key) -> float:
        """Where a fit of an effect's parameter starts; of the material: anywhere."""
        if not key.effect:
            return parameter.lower
        start = parameter.start if parameter.start is not None else parameter.null
        if start is None:
            start = self.objective.tests[key.specimen or 0].poisson_ratio
        return float(np.clip(start, parameter.lower, parameter.upper))


def _of_material(values: Mapping[Key, Of]) -> dict[str, Of]:
    """Those of the material, by name."""
    return {key.name: value for key, value in values.items() if not key.effect}


def _possible(prior: Prior, key: Key) -> Prior:
    if not (np.isfinite(prior.mean) and 0.0 < prior.deviation < np.inf):
        raise InputError(f"prior of {key}: give a finite mean and a deviation above 0")
    return prior


def _start_box(problem: Problem, given: Mapping[Key, tuple[float, float]]) -> tuple[Floats, Floats]:
    """Coordinates (scattered,) between which starts are scattered: given bounds, or the apex's."""
    implied = start_box(problem.objective.tests)
    ends = []
    for j in problem.scattered:
        p = problem.free[j]
        own = (p.lower, p.upper)
        box = own if problem.keys[j] in given else implied.get(p.name, own)
        span = problem._upper[j] - problem._lower[j]
        ends.append([(p.to_coordinate(v) - problem._lower[j]) / span for v in box])
    low, high = np.clip(np.array(ends).reshape(-1, 2), 0.0, 1.0).T
    return low, high
