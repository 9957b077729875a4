"""Leave one test out: fit the others, judge on the one that was left out."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.inverse.evaluate import evaluate
from bulgefit.inverse.fit import fit
from bulgefit.inverse.objective import displacement_weight
from bulgefit.model.virtual_test import Setup

__all__ = ["crossval"]


def crossval(
    tests: Sequence[BulgeTest],
    objective: str = "e_w",
    *,
    weight: float | Sequence[float] | None = None,
    average: str = "points",
    setup: Setup | None = None,
    executor: Executor | None = None,
    workers: int = 1,
    **options: Any,
) -> dict[str, Any]:
    """Leave-one-test-out cross-validation, as JSON types.

    Parameters
    ----------
    tests : sequence of BulgeTest
        Two or more.
    objective : {"e_w", "e", "e_z"}
    weight : float, optional
        Of dz in e_w; default: from all tests, the same in every fold.
    options
        As `fit` takes them.

    Returns
    -------
    dict
        "folds": per test left out, the parameters, the training value and every objective of the
        test left out (mm); "mean": their mean and standard deviation over folds.
    """
    if len(tests) < 2:
        raise InputError(f"cross-validation needs two tests or more, got {len(tests)}")
    shared = displacement_weight(tests) if weight is None else weight
    folds: list[dict[str, Any]] = []
    for i, left_out in enumerate(tests):
        others = [t for j, t in enumerate(tests) if j != i]
        found = fit(
            others,
            objective,
            weight=shared,
            average=average,
            setup=setup,
            executor=executor,
            workers=workers,
            **options,
        )
        judged = evaluate(left_out, found.material, weight=shared, average=average, setup=setup)
        folds.append(
            {
                "left_out": left_out.name,
                "parameters": dict(found.material.values),
                "training": {"objective": found.objective, "value": found.value},
                "left_out_objectives": {k: judged[k] for k in ("e", "e_w", "e_z")},
                "evaluations": found.evaluations,
                "failures": found.failures,
            }
        )
    scores = [fold["left_out_objectives"][objective] for fold in folds]
    seen = [s for s in scores if s is not None]
    return {
        "objective": objective,
        "unit": "mm",
        "folds": folds,
        "mean": float(np.mean(seen)) if seen else None,
        "standard_deviation": float(np.std(seen, ddof=1)) if len(seen) > 1 else None,
    }
