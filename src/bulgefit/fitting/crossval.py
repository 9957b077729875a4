"""Leave one test out: fit the others, judge on the one that was left out."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTests, given_tests
from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import effect_named
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.answers import CrossValidation
from bulgefit.fitting.evaluate import evaluate
from bulgefit.fitting.fit import corrected_at_start, polished
from bulgefit.fitting.free import at_end
from bulgefit.fitting.minimise import Descent
from bulgefit.fitting.multistart import best_of, descents, starting_points
from bulgefit.fitting.objective import LIKELIHOOD, OBJECTIVES, displacement_weight
from bulgefit.fitting.options import FitOptions, options_from
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.result import FORMAT, describe_tests
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["check_owners", "crossval"]


def crossval(
    tests: GivenTests,
    objective: str | None = None,
    *,
    options: FitOptions | None = None,
    executor: Executor | None = None,
    workers: int = 1,
    **changes: Any,
) -> CrossValidation:
    """Leave-one-test-out cross-validation, as JSON types.

    The starts of all folds are one heap of work for the executor.

    Parameters
    ----------
    tests : sequence of BulgeTest or path
        Two or more.
    objective, options, executor, workers, **changes
        As `fit` takes them; the weight of dz in e_w is that of all tests in every fold.

    Returns
    -------
    CrossValidation
        A dict that has tables and a figure. "folds": per test left out, the parameters, those at
        a bound, the training value and every objective of the test left out (mm); "mean": their
        mean and standard deviation over folds.

    Raises
    ------
    InputError
        Fewer than two tests, or what a fit refuses.
    """
    tests = given_tests(tests)
    if len(tests) < 2:
        raise InputError(f"cross-validation needs two tests or more, got {len(tests)}")
    if objective is not None:
        changes["objective"] = objective
    chosen = options_from(options, changes)
    check_owners(chosen)
    if chosen.weight is None:
        chosen = replace(chosen, weight=displacement_weight(tests))
    # in one problem first: what stands against that, such as ratios that differ, stands against all
    chosen.problem(tests)
    folds = _Folds(tests, chosen)
    points = starting_points(len(folds[0].scattered), chosen.starts, chosen.seed)
    found = descents(
        folds,
        [(i, folds[i].start(point)) for i in range(len(tests)) for point in points],
        method=chosen.method,
        limits=chosen.limits,
        executor=executor,
        workers=workers,
    )
    each = len(points)
    return _summary(
        chosen.objective,
        [
            _fold(left_out, folds[i], found[i * each : (i + 1) * each], chosen)
            for i, left_out in enumerate(tests)
        ],
        tests,
    )


def check_owners(options: FitOptions) -> None:
    """Refuse what is said of one test by its number: folds number the tests anew; InputError."""
    for what in ("held", "bounds", "priors"):
        for name in getattr(options, what):
            if Key.read(name).specimen is not None:
                raise InputError(
                    f"{what}: {name} is of one test alone, and each fold leaves a test out; say it "
                    f"of all ({Key.read(name).name}), or fit without cross-validation"
                )


class _Folds:
    """The problem of each fold, made when it is first asked for, in whatever process."""

    def __init__(self, tests: Sequence[BulgeTest], options: FitOptions) -> None:
        self._given = tuple(tests), options
        self._made: dict[int, Problem] = {}
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return _Folds, self._given

    def __getitem__(self, index: int) -> Problem:
        tests, options = self._given
        with self._lock:
            if index not in self._made:
                problem = options.problem(tests[:index] + tests[index + 1 :])
                with one_blas_thread():
                    corrected_at_start(problem)
                self._made[index] = problem
            return self._made[index]


def _fold(
    left_out: BulgeTest, problem: Problem, found: Sequence[Descent], options: FitOptions
) -> dict[str, Any]:
    """What the others' parameters are, and what the test left out says of them."""
    best, _ = best_of(problem, found)
    with one_blas_thread():
        last = polished(problem, problem.coordinates(best.values), options).best
    material = problem.material(problem.coordinates(last.values))
    effects = problem.effects(problem.coordinates(last.values))
    # of two tests the other's own keys name no specimen, as what is shared
    of_all = {
        key.name: value
        for key, value in effects.items()
        if key in problem.held_effects or effect_named(key.effect).shared
    }
    judged: Mapping[str, Any]
    try:
        judged = evaluate(
            left_out,
            material,
            effects=of_all,
            weight=options.weight,
            average=options.average,
            setup=options.setup,
        )
    except SolveError:
        # the others' parameters need not reach this test's pressures
        judged = dict.fromkeys(OBJECTIVES)
    return {
        "left_out": left_out.name,
        "parameters": {**material.values, **{str(key): v for key, v in effects.items()}},
        "at_bound": [p.name for p in problem.free if at_end(p, last.values[p.name])],
        "training": {"objective": problem.objective.name, "value": last.value},
        "left_out_objectives": {k: judged[k] for k in OBJECTIVES},
        "evaluations": sum(len(d.history) for d in found),
        "failures": sum(d.failures for d in found),
    }


def _summary(
    objective: str, folds: list[dict[str, Any]], tests: Sequence[BulgeTest]
) -> CrossValidation:
    judged = OBJECTIVES[0] if objective == LIKELIHOOD else objective
    scores = [fold["left_out_objectives"][judged] for fold in folds]
    seen = [s for s in scores if s is not None]
    return CrossValidation(
        {
            "format": FORMAT,
            "objective": objective,
            "judged_by": judged,
            "unit": "mm",
            "folds": folds,
            "mean": float(np.mean(seen)) if seen else None,
            "standard_deviation": float(np.std(seen, ddof=1)) if len(seen) > 1 else None,
            "sources": describe_tests(tests),
        }
    )
