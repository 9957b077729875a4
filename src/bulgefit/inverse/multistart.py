"""Many starts, spread evenly over the bounds, in parallel or not, always with the same result."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from bulgefit.errors import InputError
from bulgefit.inverse.minimise import GAUSS_NEWTON, Descent, Limits, descend
from bulgefit.inverse.problem import Problem
from bulgefit.threads import one_blas_thread

__all__ = ["multistart", "starting_points"]

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
        Where to run; default: `workers` threads of this process (the kernels and LAPACK release
        the interpreter, so the starts share the data).
    workers : int
    """
    points = starting_points(problem.size, starts, seed)
    task = partial(_descend_alone, problem, method=method, limits=limits)
    own = ThreadPoolExecutor(max_workers=workers) if executor is None else nullcontext(executor)
    # the limit is a process's, so it is set around the pool as well as in each task
    with one_blas_thread(), own as pool:
        return list(pool.map(task, points))


def _descend_alone(
    problem: Problem, start: Floats, *, method: str, limits: Limits | None
) -> Descent:
    """One descent on one BLAS thread, so that rounding does not depend on the machine."""
    with one_blas_thread():
        return descend(problem, start, method, limits)
