"""Fit material parameters to bulge tests."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fitting.minimise import GAUSS_NEWTON, Limits
from bulgefit.fitting.multistart import best_of, multistart
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.result import FitResult, Stability, describe_tests
from bulgefit.model.parameters import Material
from bulgefit.model.virtual_test import Setup
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["fit"]


def fit(
    tests: BulgeTest | Sequence[BulgeTest],
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
) -> FitResult:
    """Material parameters that bring the virtual test closest to the measured ones.

    Parameters
    ----------
    tests : BulgeTest or sequence of BulgeTest
        Several are fitted together; the objective is their mean.
    objective : {"e_w", "e", "e_z"}
        See `bulgefit.fitting.objective`.
    material : {"orthotropic", "isotropic", "isotropic-EG"}
    free : iterable of str
        Freed beyond the moduli: "nu12" or "nu".
    bounds : mapping of name to (lower, upper), optional
        MPa; default: the study's.
    held : mapping of name to value, optional
        nu12 or nu where it is not the tests'.
    weight, average
        See `Objective`.
    setup : Setup, optional
        Law, mesh, field evaluation.
    starts, seed : int
        Scrambled-Sobol starts; the same seed gives the same result for any number of workers.
    method : str
        "gauss-newton" or a scipy minimiser.
    limits : Limits, optional
    executor : concurrent.futures.Executor, optional
        Threads, processes, or `Client.get_executor()` of Dask: the data reach each process once.
    workers : int
        Threads where no executor is given.

    Raises
    ------
    InputError
        Input that cannot be used.
    BulgefitError
        Every evaluation of every start failed.
    """
    began = time.perf_counter()
    given = [tests] if isinstance(tests, BulgeTest) else list(tests)
    target = Objective(given, objective, setup, weight=weight, average=average)
    problem = Problem(target, material, free=free, bounds=bounds, held=held)
    descents = multistart(
        problem,
        starts=starts,
        seed=seed,
        method=method,
        limits=limits,
        executor=executor,
        workers=workers,
    )
    best, found = best_of(problem, descents)
    with one_blas_thread():
        tests_parts = target.parts(target.virtual.fields(found))
        stable = stability(target, found)
    return FitResult(
        material=found,
        free=problem.free,
        objective=objective,
        value=best.value,
        weights=target.weights.tolist(),
        tests=tests_parts,
        descents=descents,
        stability=stable,
        settings={
            "law": target.virtual.setup.law,
            "evaluation": target.virtual.setup.evaluation,
            "interpolation": target.virtual.setup.interpolation,
            "relaxation": target.virtual.setup.relaxation,
            "cells": len(target.virtual.membrane(given[0]).mesh.cells),
            "tolerance_mm": target.virtual.setup.tolerance,
            "average": average,
            "method": method,
            "starts": starts,
            "seed": seed,
        },
        seconds=time.perf_counter() - began,
        sources=describe_tests(given),
        setup=target.virtual.setup,
    )


def stability(objective: Objective, material: Material) -> Stability:
    """Where the model with these parameters stops being stable, against the frames."""
    limits = []
    beyond, wrinkled = 0, False
    for kind, path in objective.virtual.paths(material, derivatives=False).items():
        wrinkled |= bool(path.wrinkled.any())
        if path.stable.all():
            continue
        first = int(np.argmin(path.stable))
        limits.append(float(path.pressure[first - 1]) if first else 0.0)
        alike = [t for t in objective.tests if (t.radius, t.thickness) == kind]
        beyond += sum(int((test.pressure > limits[-1]).sum()) for test in alike)
    return Stability(10.0 * min(limits) if limits else None, beyond, wrinkled)
