"""Is what is said of a sum of scores what it scatters by, where the noise is correlated?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.noise import Noise, Source, noise_of
from bulgefit.fitting.noise_left import noise_left
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.problem import Problem
from bulgefit.fitting.scores import Scores
from bulgefit.model.setup import Setup

Maker = Callable[..., BulgeTest]

TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
BOUNDS = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
SIZE, SHARE, LENGTH = 0.02, 0.36, 10.0
POINTS, FRAMES, DRAWS = 600, 8, 60
NOISE = Noise(SIZE * np.ones(3), LENGTH, 1.0, Source.AT_REST)


def correlation(points: np.ndarray) -> np.ndarray:
    return np.exp(-((cdist(points, points) / LENGTH) ** 2))


@cache
def _root(key: bytes) -> np.ndarray:
    points = np.frombuffer(key).reshape(-1, 2)
    return np.linalg.cholesky(correlation(points) + 1e-6 * np.eye(len(points)))


def noise(points: np.ndarray, seed: int) -> np.ndarray:
    """(frames, n, 3) mm: a share of its variance is correlated."""
    own, common = np.random.default_rng(seed).standard_normal((2, FRAMES, len(points), 3))
    smooth = np.einsum("nm,fmc->fnc", _root(points.tobytes()), common)
    return SIZE * (np.sqrt(1.0 - SHARE) * own + np.sqrt(SHARE) * smooth)


@pytest.mark.parametrize("name", ["e", "likelihood"])
def test_covariances_of_correlated_noise_are_the_true_ones(
    name: str, make: Maker, setup: Setup
) -> None:
    """Signs of normal values that correlate by ρ do so by 2/π asin ρ (Sheppard, 1899)."""
    problem = Problem(
        Objective([make(noise=SIZE, frames=FRAMES, points=POINTS)], name, setup), bounds=BOUNDS
    )
    z = problem.coordinates(TRUTH)
    shapes, columns = problem.shapes(z, derivatives=True), problem.columns(z)
    (look,) = problem.objective.looks(shapes, problem.names_of_tests())
    found, freedom = [], []
    for seed in range(DRAWS):
        drawn = replace(look, residual=noise(look.position, seed))
        scores = Scores(problem.objective, columns, [NOISE])
        scores.weigh(drawn)
        scores.add(drawn)
        covariance, known = scores.of_noise(np.eye(3))
        found.append(np.diag(covariance))
        freedom.append(known)
    rho = SHARE * correlation(look.position) + (1.0 - SHARE) * np.eye(POINTS)
    alike = SIZE**2 * rho if scores.squared else 2.0 / np.pi * np.arcsin(np.minimum(rho, 1.0))
    pull = scores.jacobian(look) * look.scale[:, None, :, None]
    true = np.einsum("fncp,nm,fmcp->p", pull, alike, pull, optimize=True)
    # three standard errors of the mean, and the 2 % that the weight of pairs leaves out at most
    error = np.sqrt(2.0 / np.min(freedom, axis=0) / DRAWS)
    np.testing.assert_array_less(np.abs(np.mean(found, axis=0) / true - 1.0), 3.0 * error + 0.02)
    # a variance of DRAWS draws is known to √(2/DRAWS); three of that
    scatter = 2.0 * np.mean(found, axis=0) ** 2 / np.var(found, axis=0, ddof=1)
    ratio = np.log(np.median(freedom, axis=0) / scatter)
    np.testing.assert_array_less(np.abs(ratio), 3.0 * np.sqrt(2.0 / DRAWS))


@pytest.mark.parametrize("name", ["e", "likelihood"])
def test_covariances_of_noise_that_persists_are_the_true_ones(
    name: str, make: Maker, setup: Setup
) -> None:
    """A third of its variance is the same in every frame, each point's its own."""
    share = 1.0 / 3.0
    problem = Problem(
        Objective([make(noise=SIZE, frames=FRAMES, points=POINTS)], name, setup), bounds=BOUNDS
    )
    z = problem.coordinates(TRUTH)
    shapes, columns = problem.shapes(z, derivatives=True), problem.columns(z)
    (look,) = problem.objective.looks(shapes, problem.names_of_tests())
    told = Noise(SIZE * np.ones(3), 0.0, 1.0, Source.FRAMES, persistent=share)
    found, freedom, rng = [], [], np.random.default_rng(5)
    for _ in range(DRAWS):
        own = rng.standard_normal(look.residual.shape)
        lasting = rng.standard_normal(look.residual.shape[1:])
        drawn = SIZE * (np.sqrt(1.0 - share) * own + np.sqrt(share) * lasting)
        scores = Scores(problem.objective, columns, [told])
        scores.add(replace(look, residual=drawn))
        covariance, known = scores.of_noise(np.eye(3))
        found.append(np.diag(covariance))
        freedom.append(known)
    rho = share * np.ones((FRAMES, FRAMES)) + (1.0 - share) * np.eye(FRAMES)
    alike = SIZE**2 * rho if scores.squared else 2.0 / np.pi * np.arcsin(np.minimum(rho, 1.0))
    pull = scores.jacobian(look) * look.scale[:, None, :, None]
    true = np.einsum("fncp,fg,gncp->p", pull, alike, pull, optimize=True)
    error = np.sqrt(2.0 / np.min(freedom, axis=0) / DRAWS)
    np.testing.assert_array_less(np.abs(np.mean(found, axis=0) / true - 1.0), 3.0 * error + 0.02)
    scatter = 2.0 * np.mean(found, axis=0) ** 2 / np.var(found, axis=0, ddof=1)
    ratio = np.log(np.median(freedom, axis=0) / scatter)
    np.testing.assert_array_less(np.abs(ratio), 3.0 * np.sqrt(2.0 / DRAWS))


def test_freedom_falls_where_few_points_tell_most(make: Maker, setup: Setup) -> None:
    """One frame's cells are not those of all frames, though all are there."""
    test = make(noise=SIZE, frames=FRAMES, points=POINTS)
    problem = Problem(Objective([test], "e", setup), bounds=BOUNDS)
    z = problem.coordinates(TRUTH)
    (look,) = problem.objective.looks(problem.shapes(z, derivatives=True), problem.names_of_tests())
    known = []
    for loudest in (1.0, 100.0):
        scale = look.scale.copy()
        scale[3] *= loudest
        scores = Scores(problem.objective, problem.columns(z), [NOISE])
        scores.add(replace(look, scale=scale))
        known.append([scores.of_noise(np.eye(3))[1], scores.of_blocks(np.eye(3))[1]])
    assert (known[1][0] < known[0][0] / 2).all()
    assert (known[1][1] < known[0][1]).all()


def test_noise_is_told_by_what_a_fit_leaves(make: Maker, setup: Setup) -> None:
    """A field alone is blind to noise that is correlated in space; frames without images at rest
    tell it all the same."""
    test = make(frames=FRAMES, points=POINTS)
    (block,) = test.blocks
    seen = block.displacement + noise(np.ascontiguousarray(block.reference[:, :2]), 7)
    test = BulgeTest.from_arrays(block.reference, seen, test.pressure, poisson_ratio=0.24)
    problem = Problem(Objective([test], "e", setup), bounds=BOUNDS)
    (found,) = noise_left(problem.objective, problem.shapes(problem.coordinates(TRUTH)))
    assert found is not None
    assert found.correlation_length > 0.6 * LENGTH
    np.testing.assert_allclose(found.sigma, SIZE, rtol=0.1)
    alone = noise_of(test)
    assert alone is not None
    assert alone.correlation_length == 0.0


def test_some_of_the_points_tell_how_many_of_all_count(
    make: Maker, setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Among more points within its reach noise that correlates counts for less each."""
    test = make(frames=FRAMES, points=POINTS)
    (block,) = test.blocks
    seen = block.displacement + noise(np.ascontiguousarray(block.reference[:, :2]), 8)
    test = BulgeTest.from_arrays(block.reference, seen, test.pressure, poisson_ratio=0.24)
    problem = Problem(Objective([test], "e", setup), bounds=BOUNDS)
    shapes = problem.shapes(problem.coordinates(TRUTH))
    (by_all,) = noise_left(problem.objective, shapes)
    monkeypatch.setattr("bulgefit.fitting.noise_left._MOST", POINTS // 3)
    (by_some,) = noise_left(problem.objective, shapes)
    assert by_all is not None
    assert by_some is not None
    assert by_all.inflation > 2.0
    assert by_some.inflation == pytest.approx(by_all.inflation, rel=0.25)
