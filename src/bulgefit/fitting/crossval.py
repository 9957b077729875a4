"""Leave one test out: fit the others, judge on the one that was left out."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.evaluate import evaluate
from bulgefit.fitting.minimise import GAUSS_NEWTON, Descent, Limits
from bulgefit.fitting.multistart import best_of, descents, starting_points
from bulgefit.fitting.objective import OBJECTIVES, Objective, displacement_weight
from bulgefit.fitting.problem import Problem
from bulgefit.model.virtual_test import Setup

__all__ = ["crossval"]


def crossval(
    tests: Sequence[BulgeTest],
    objective: str = "e_w",
    *,
    material: str = "orthotropic",
    free: Iterable[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    held: Mapping[str, float] | None = None,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
    starts: int = 5,
    seed: int = 0,
    method: str = GAUSS_NEWTON,
    limits: Limits | None = None,
    executor: Executor | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Leave-one-test-out cross-validation, as JSON types.

    The starts of all folds are one heap of work for the executor.

    Parameters
    ----------
    tests : sequence of BulgeTest
        Two or more.
    weight : float, optional
        Of dz in e_w; default: from all tests, the same in every fold.
    objective, material, free, bounds, held, average, setup, starts, seed, method, limits
        As `fit` takes them.
    executor, workers
        As `fit` takes them.

    Returns
    -------
    dict
        "folds": per test left out, the parameters, the training value and every objective of the
        test left out (mm); "mean": their mean and standard deviation over folds.
    """
    if len(tests) < 2:
        raise InputError(f"cross-validation needs two tests or more, got {len(tests)}")
    comparison: dict[str, Any] = {
        "weight": displacement_weight(tests) if weight is None else weight,
        "average": average,
        "setup": setup,
    }
    parameters: dict[str, Any] = {
        "kind": material,
        "free": tuple(free),
        "bounds": bounds,
        "held": held,
    }
    # in one problem first: what stands against that, such as ratios that differ, stands against all
    Problem(Objective(tests, objective, **comparison), **parameters)
    folds = _Folds(tests, objective, comparison, parameters)
    points = starting_points(folds[0].size, starts, seed)
    found = descents(
        folds,
        [(i, point) for i in range(len(tests)) for point in points],
        method=method,
        limits=limits,
        executor=executor,
        workers=workers,
    )
    return _summary(
        objective,
        [
            _fold(left_out, folds[i], found[i * starts : (i + 1) * starts], comparison)
            for i, left_out in enumerate(tests)
        ],
    )


class _Folds:
    """The problem of each fold, made when it is first asked for, in whatever process."""

    def __init__(
        self,
        tests: Sequence[BulgeTest],
        objective: str,
        comparison: Mapping[str, Any],
        parameters: Mapping[str, Any],
    ) -> None:
        self._given = tuple(tests), objective, comparison, parameters
        self._made: dict[int, Problem] = {}
        self._lock = threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return _Folds, self._given

    def __getitem__(self, index: int) -> Problem:
        tests, objective, comparison, parameters = self._given
        with self._lock:
            if index not in self._made:
                others = tests[:index] + tests[index + 1 :]
                target = Objective(others, objective, **comparison)
                self._made[index] = Problem(target, **parameters)
            return self._made[index]


def _fold(
    left_out: BulgeTest,
    problem: Problem,
    found: Sequence[Descent],
    comparison: Mapping[str, Any],
) -> dict[str, Any]:
    """What the others' parameters are, and what the test left out says of them."""
    best, material = best_of(problem, found)
    try:
        judged = evaluate(left_out, material, **comparison)
    except SolveError:
        # the others' parameters need not reach this test's pressures
        judged = dict.fromkeys(OBJECTIVES)
    return {
        "left_out": left_out.name,
        "parameters": dict(material.values),
        "training": {"objective": problem.objective.name, "value": best.value},
        "left_out_objectives": {k: judged[k] for k in OBJECTIVES},
        "evaluations": sum(len(d.history) for d in found),
        "failures": sum(d.failures for d in found),
    }


def _summary(objective: str, folds: list[dict[str, Any]]) -> dict[str, Any]:
    scores = [fold["left_out_objectives"][objective] for fold in folds]
    seen = [s for s in scores if s is not None]
    return {
        "objective": objective,
        "unit": "mm",
        "folds": folds,
        "mean": float(np.mean(seen)) if seen else None,
        "standard_deviation": float(np.std(seen, ddof=1)) if len(seen) > 1 else None,
    }
