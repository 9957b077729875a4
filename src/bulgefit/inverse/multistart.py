"""Many starts, spread evenly over the bounds, in parallel or not, always with the same result."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from bulgefit.errors import InputError
from bulgefit.inverse.minimise import GAUSS_NEWTON, Descent, Limits, descend
from bulgefit.inverse.problem import Problem
from bulgefit.spread import spread
from bulgefit.threads import one_blas_thread
from bulgefit.workers import open_executor

__all__ = ["descents", "multistart", "starting_points"]

Floats = NDArray[np.floating]


def starting_points(size: int, count: int, seed: int) -> Floats:
    """Scrambled Sobol points (count, size) in the unit cube: the same for the same seed."""
    if count < 1:
        raise InputError(f"starts: must be 1 or more, got {count}")
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
    """Descend from `starts` scrambled-Sobol points; results in the order of the points.

    Parameters
    ----------
    problem : Problem
    starts, seed : int
    method : str
        See `bulgefit.inverse.minimise.descend`.
    limits : Limits, optional
    executor : concurrent.futures.Executor, optional
        See `descents`.
    workers : int
    """
    jobs = [(0, point) for point in starting_points(problem.size, starts, seed)]
    return descents(
        [problem], jobs, method=method, limits=limits, executor=executor, workers=workers
    )


def descents(
    problems: Sequence[Problem],
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
    problems : sequence of Problem
        Sent to each worker process once; it may make its items when they are asked for.
    jobs : sequence of (index, start)
        Which problem, and the coordinates to start from.
    method, limits
        See `bulgefit.inverse.minimise.descend`.
    executor : concurrent.futures.Executor, optional
        Where to run; default: `workers` threads of this process.
    workers : int
    """
    task = partial(_descend_alone, method=method, limits=limits)
    own = open_executor(workers) if executor is None else nullcontext(executor)
    with own as pool:
        return spread(pool, task, problems, jobs)


def _descend_alone(
    problems: Sequence[Problem],
    job: tuple[int, Floats],
    *,
    method: str,
    limits: Limits | None,
) -> Descent:
    """One descent on one BLAS thread, so that rounding does not depend on the machine."""
    index, start = job
    with one_blas_thread():
        return descend(problems[index], start, method, limits)
