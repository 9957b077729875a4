"""Did the starts end at one optimum, or at others of equal worth?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.fitting.minimise import Descent
from bulgefit.fitting.problem import Problem

__all__ = ["AGREE", "elsewhere", "of_equal_worth"]

Floats = NDArray[np.floating]

#: Starts within this part of the lowest objective are worth the same.
AGREE = 1e-3


def of_equal_worth(descents: Sequence[Descent]) -> list[Descent]:
    """The descents whose end is as good as the best."""
    best = min(d.best.value for d in descents if np.isfinite(d.best.value))
    return [d for d in descents if d.best.value <= best * (1.0 + AGREE)]


def elsewhere(
    problem: Problem, z: Floats, descents: Sequence[Descent], stderr: Mapping[str, float | None]
) -> list[Descent]:
    """Those of the descents that ended at another optimum than z: a ridge lies between.

    Along a valley of which the data tell no place from another there is none. Ends within a
    standard error of each other are not asked.
    """
    return list(_beyond_a_ridge(problem, z, descents, stderr))


def _beyond_a_ridge(
    problem: Problem, z: Floats, descents: Sequence[Descent], stderr: Mapping[str, float | None]
) -> Iterator[Descent]:
    here = problem.values(z)
    value = None
    for descent in descents:
        if _near(here, descent.best.values, stderr):
            continue
        if value is None:
            value = problem.evaluate(z).value
        end = problem.coordinates(descent.best.values)
        between = problem.evaluate(0.5 * (z + end)).value
        # where nothing balances in between, that is a ridge too
        if not between <= max(value, problem.evaluate(end).value) * (1.0 + AGREE):
            yield descent


def _near(
    here: Mapping[str, float], there: Mapping[str, float], stderr: Mapping[str, float | None]
) -> bool:
    return all(
        abs(there[name] - value) <= max(stderr[name] or 0.0, AGREE * abs(value))
        for name, value in here.items()
        if name in stderr
    )
