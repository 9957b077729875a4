"""Points and tests that several rooms of the gap's tests stand on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.gap.data import Data
from bulgefit.gap.specimen import Specimen

SIGMA = np.array([0.006, 0.006, 0.012])


def disc_points(spacing: float, reach: float = 94.0) -> np.ndarray:
    """A square grid of points (n, 3) mm inside a radius."""
    side = np.arange(-90.0, 91.0, spacing)
    x, y = (g.ravel() for g in np.meshgrid(side, side))
    inside = np.hypot(x, y) < reach
    return np.column_stack([x[inside], y[inside], np.zeros(inside.sum())])


@pytest.fixture(scope="session")
def grid() -> Callable[..., np.ndarray]:
    """`grid(spacing, reach)`: points of the disc."""
    return disc_points


@pytest.fixture(scope="session")
def made_by_the_model() -> Callable[..., Data]:
    """`made(truth, spacing, frames, seed)`: by the model itself, so its mesh plays no part."""

    def made(truth: dict[str, float], spacing: float, frames: int, seed: int) -> Data:
        points, pressure = disc_points(spacing), np.linspace(0.01, 0.25, frames)
        blank = BulgeTest.from_arrays(points, np.zeros((frames, len(points), 3)), pressure)
        seen = Specimen(blank, refine=2).predict(truth).displacement
        noise = np.random.default_rng(seed).normal(size=seen.shape) * SIGMA
        test = BulgeTest.from_arrays(points, seen + noise, pressure)
        return Data(Specimen(test, refine=2), SIGMA, np.ones(seen.shape, dtype=bool))

    return made
