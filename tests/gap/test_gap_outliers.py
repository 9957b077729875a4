"""Values that are no measurement of the fabric are left out, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.dic.noise import outliers

SIGMA = np.array([0.006, 0.006, 0.015])


@pytest.fixture
def gap(grid: Callable[..., np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points, and the residual (12, n, 3) of a model: a smooth gap that grows, waves, noise."""
    points = grid(5.0)[:, :2]
    x, y = points.T / 100.0
    rise = np.linspace(0.2, 1.0, 12)[:, None]
    waves = 0.5 * np.sin(2.0 * np.pi * points[:, 0] / 40.0)
    residual = np.stack(
        [0.1 * rise * x, 0.1 * rise * y, 2.0 * rise * (1.0 - x**2 - y**2) + waves], axis=-1
    )
    return points, residual + np.random.default_rng(1).normal(size=residual.shape) * SIGMA


def test_a_gap_has_no_outliers(gap: tuple[np.ndarray, np.ndarray]) -> None:
    """However far it is above the noise: waves of 40 mm and a dome."""
    assert not outliers(*gap, SIGMA).any()


@pytest.mark.parametrize("count", [1, 7, 12])
def test_points_that_lost_the_pattern_are_left_out(
    gap: tuple[np.ndarray, np.ndarray], count: int
) -> None:
    """In clusters as well, where most neighbours are lost too; no other point loses a value."""
    points, residual = gap
    lost = np.argsort(np.hypot(points[:, 0] - 52.0, points[:, 1] + 31.0))[:count]
    strayed = np.ix_([2, 3], lost, [2])
    residual[strayed] += np.linspace(5.0, 9.0, residual[strayed].size).reshape(2, -1, 1)
    found = outliers(points, residual, SIGMA)
    assert found[np.ix_([2, 3], lost)].all()
    assert not np.delete(found, lost, axis=1).any()


def test_points_that_are_not_measured_are_no_outliers(gap: tuple[np.ndarray, np.ndarray]) -> None:
    """A hole over a third of the disc, and a frame without any point."""
    points, residual = gap
    residual[4:7, points[:, 0] > 30.0] = np.nan
    residual[8] = np.nan
    residual[:, 0] = np.nan
    assert not outliers(points, residual, SIGMA).any()
