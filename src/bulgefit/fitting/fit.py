"""Fit parameters to bulge tests."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTests, given_tests
from bulgefit.errors import BulgefitError
from bulgefit.fitting.beliefs import beliefs_of
from bulgefit.fitting.minimise import GAUSS_NEWTON, Descent, descend
from bulgefit.fitting.multistart import best_of, multistart
from bulgefit.fitting.noise_left import noise_left
from bulgefit.fitting.options import FitOptions, options_from
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.quality import quality_of
from bulgefit.fitting.result import FitResult, Stability, describe_tests
from bulgefit.fitting.sides import turned
from bulgefit.fitting.uncertainty import uncertainty_of
from bulgefit.model.inflation import Shapes
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["corrected_at_start", "fit", "polished", "stability", "weighed"]

Floats = NDArray[np.floating]

#: Most rounds of the mesh's error at the end of a fit. Where each leaves 0.6 of it, as in the worst
#: that was seen, ten leave a hundredth. Other methods end anywhere within their own tolerance, so
#: that no round of theirs moves nothing.
_ROUNDS, _OTHERS = 10, 2


def fit(
    tests: GivenTests,
    objective: str | None = None,
    *,
    options: FitOptions | None = None,
    executor: Executor | None = None,
    workers: int = 1,
    **changes: Any,
) -> FitResult:
    """Parameters that bring the virtual test closest to the measured ones.

    Parameters
    ----------
    tests : BulgeTest, path, or sequence of them
        Several are fitted together; the objective is their mean, of likelihoods their sum. What
        an effect does to one specimen is each test's own.
    objective : {"e_w", "e", "e_z", "likelihood"}, optional
        See `bulgefit.fitting.objective`.
    options : FitOptions, optional
    executor : concurrent.futures.Executor, optional
        Threads, processes, or `Client.get_executor()` of Dask: the data reach each process once.
    workers : int
        Threads where no executor is given.
    **changes
        Options by name (see `FitOptions`): material, free, bounds, held, effects, priors,
        uncertainty, weight, average, setup, starts, seed, method, limits.

    Raises
    ------
    InputError
        Input that cannot be used.
    UnsolvedError
        Every evaluation of every start failed.
    """
    began = time.perf_counter()
    given = given_tests(tests)
    if objective is not None:
        changes["objective"] = objective
    chosen = options_from(options, changes)
    problem = chosen.problem(given)
    with one_blas_thread():
        corrected_at_start(problem)
    descents = multistart(
        problem,
        starts=chosen.starts,
        seed=chosen.seed,
        method=chosen.method,
        limits=chosen.limits,
        executor=executor,
        workers=workers,
    )
    with one_blas_thread():
        best, _ = best_of(problem, descents)
        last = polished(problem, problem.coordinates(best.values), chosen)
        return _result(problem, descents, last, chosen, given, began)


def corrected_at_start(problem: Problem) -> None:
    """Take the mesh's error off as it is in the middle of the starts: it hardly changes."""
    if problem.objective.setup.corrects_mesh:
        try:
            middle = problem.start(np.full(len(problem.scattered), 0.5))
            problem.objective.correct_mesh(problem.shapes(middle))
        except BulgefitError:
            return  # the optimum will tell


def weighed(problem: Problem, z: Floats) -> None:
    """Weigh data, and what is believed beside them, by the noise that a model leaves of them.

    A displacement as it is shows its noise by what a local surface leaves of it; where a few
    hundred points lie far apart that is its curvature, and several times the noise.
    """
    if problem.objective.squared or problem.priors:
        problem.objective.weigh_by(noise_left(problem.objective, problem.shapes(z)))


def polished(problem: Problem, z: Floats, options: FitOptions) -> Descent:
    """The fit once more from its end, with the mesh's error as it is there, on all data.

    The starts ended with the mesh's error of another place, so the error at their end is off, by a
    hundredth or so of what theirs was. That is a third of a modulus's standard error where much was
    measured; a second round leaves a hundredth of it. Where parameters can hardly be told apart a
    round may leave half: they go on until one moves none of them.
    """
    z = turned(problem, z, options.method, options.limits)
    weighed(problem, z)
    rounds = _ROUNDS if options.method == GAUSS_NEWTON else _OTHERS
    for _ in range(rounds if problem.objective.setup.corrects_mesh else 0):
        problem.objective.correct_mesh(problem.shapes(z))
        before, end = z, descend(problem, z, options.method, options.limits)
        z = problem.coordinates(end.best.values)
        if np.array_equal(z, before):
            break
    return descend(problem.on_all_data(), z, options.method, options.limits)


def _result(
    problem: Problem,
    descents: list[Descent],
    last: Descent,
    options: FitOptions,
    tests: list[BulgeTest],
    began: float,
) -> FitResult:
    objective = problem.objective
    z = problem.coordinates(last.best.values)
    shapes = problem.shapes(z, derivatives=True)
    at_bound = problem.at_bound(z)
    noises = noise_left(objective, shapes)
    errors = uncertainty_of(problem, z, shapes, at_bound, options.uncertainty, noises)
    beliefs = beliefs_of(problem, z, options)
    value = objective.value(shapes)
    return FitResult(
        material=problem.material(z),
        effects={str(key): value for key, value in problem.effects(z).items()},
        free=problem.free,
        objective=objective.name,
        value=value,
        weights=objective.weights.tolist(),
        tests=objective.parts(shapes),
        descents=descents,
        stability=stability(objective.tests, shapes),
        uncertainty=errors,
        beliefs=beliefs,
        quality=quality_of(problem, z, value, shapes, descents, errors, at_bound, noises, beliefs),
        options=options,
        settings=_settings(problem, options),
        seconds=time.perf_counter() - began,
        sources=describe_tests(tests),
    )


def _settings(problem: Problem, options: FitOptions) -> dict[str, Any]:
    setup = problem.objective.setup
    return {
        "law": setup.law,
        "evaluation": setup.evaluation,
        "interpolation": setup.interpolation,
        "relaxation": setup.relaxation,
        "cells": len(problem.objective.virtual[0].mesh.cells),
        "mesh_error_taken_off": setup.corrects_mesh,
        "tolerance_mm": setup.tolerance,
        "average": options.average,
        "method": options.method,
        "starts": options.starts,
        "seed": options.seed,
        "effects": list(options.effects),
        "held": dict(options.held),
        "priors": {name: asdict(prior) for name, prior in options.priors.items()},
        "uncertainty": dict(options.uncertainty),
        "sampled": problem.objective.is_sampled,
    }


def stability(tests: Sequence[BulgeTest], shapes: Sequence[Shapes]) -> Stability:
    """Where the model with these parameters stops being stable, by the frames' own pressures.

    What a frame was loaded with may be another pressure than it shows: an offset, a gain, creep.
    """
    limits: list[float] = []
    beyond = 0
    for test, one in zip(tests, shapes, strict=True):
        lost = test.pressure[~one.stable]
        if len(lost):
            below = test.pressure[test.pressure < lost.min()]
            limits.append(float(below.max(initial=0.0)))
            beyond += len(lost)
    wrinkled = any(one.wrinkled is not None and one.wrinkled.any() for one in shapes)
    return Stability(10.0 * min(limits) if limits else None, beyond, wrinkled)
