"""Many starts, spread evenly over the bounds, in parallel or not, always with the same result."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from bulgefit.errors import InputError, UnsolvedError
from bulgefit.fitting.minimise import GAUSS_NEWTON, Descent, Limits, descend
from bulgefit.fitting.problem import Evaluation, Problem
from bulgefit.model.parameters import Material
from bulgefit.parallel.spread import spread
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.parallel.workers import open_executor

__all__ = ["Problems", "best_of", "check_starts", "descents", "multistart", "starting_points"]

Floats = NDArray[np.floating]


class Problems(Protocol):
    """Several problems, such as a list of them; it may make them when they are asked for."""

    def __getitem__(self, index: int, /) -> Problem:
        """One of them."""
        ...


def check_starts(count: int) -> None:
    """Refuse a number of starts of which none is one; InputError."""
    if count < 1:
        raise InputError(f"starts: must be 1 or more, got {count}")


def starting_points(size: int, count: int, seed: int) -> Floats:
    """Scrambled Sobol points (count, size) in the unit cube: the same for the same seed."""
    check_starts(count)
    if size == 0:
        return np.zeros((1, 0))
    sampler = qmc.Sobol(size, scramble=True, rng=np.random.default_rng(seed))
    return sampler.random_base2(int(np.ceil(np.log2(max(count, 2)))))[:count]


def multistart(
    problem: Problem,
    *,
    starts: int = 5,
    seed: int = 0,
    method: str = GAUSS_NEWTON,
    limits: Limits | None = None,
    executor: Executor | None = None,
    workers: int = 1,
) -> list[Descent]:
    """Descend from `starts` scrambled-Sobol points of the moduli; results in their order.

    Parameters
    ----------
    problem : Problem
    starts, seed : int
    method : str
        See `bulgefit.fitting.minimise.descend`.
    limits : Limits, optional
    executor : concurrent.futures.Executor, optional
        See `descents`.
    workers : int
    """
    points = starting_points(len(problem.scattered), starts, seed)
    jobs = [(0, problem.start(point)) for point in points]
    return descents(
        [problem], jobs, method=method, limits=limits, executor=executor, workers=workers
    )


def descents(
    problems: Problems,
    jobs: Sequence[tuple[int, Floats]],
    *,
    method: str = GAUSS_NEWTON,
    limits: Limits | None = None,
    executor: Executor | None = None,
    workers: int = 1,
) -> list[Descent]:
    """A descent for each job, in their order.

    Parameters
    ----------
    problems : Problems
        Sent to each worker process once.
    jobs : sequence of (index, start)
        Which problem, and the coordinates to start from.
    method, limits
        See `bulgefit.fitting.minimise.descend`.
    executor : concurrent.futures.Executor, optional
        Where to run; default: `workers` threads of this process.
    workers : int
    """
    task = partial(_descend_alone, method=method, limits=limits)
    own = open_executor(workers) if executor is None else nullcontext(executor)
    with own as pool:
        return spread(pool, task, problems, jobs)


def _descend_alone(
    problems: Problems,
    job: tuple[int, Floats],
    *,
    method: str,
    limits: Limits | None,
) -> Descent:
    """One descent on one BLAS thread, so that rounding does not depend on the machine."""
    index, start = job
    with one_blas_thread():
        return descend(problems[index], start, method, limits)


def best_of(problem: Problem, found: Sequence[Descent]) -> tuple[Evaluation, Material]:
    """The lowest end of all descents, and its material; UnsolvedError where there is none."""
    values = [d.best.value for d in found]
    if not np.isfinite(values).any():
        raise UnsolvedError(f"no start found an equilibrium: {found[0].reason}")
    best = found[int(np.nanargmin(values))].best
    return best, problem.material(problem.coordinates(best.values))
