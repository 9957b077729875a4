"""A small specimen that every effect can be tried on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest
from bulgefit.parallel.threads import one_blas_thread

#: A coarse mesh, followed so closely that paths and single balances agree.
SETUP = Setup(refine=2, tolerance=1e-6, correct_mesh=False)


def points_of(count: int = 60) -> np.ndarray:
    """Points (n, 3) mm over the disc, without heights."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-90, 90, (count, 3)) * [1, 1, 0]
    return points[np.hypot(points[:, 0], points[:, 1]) < 92]


@pytest.fixture(scope="module")
def specimen() -> VirtualTest:
    """Three frames of some 50 points, with times."""
    points, pressure = points_of(), np.array([0.02, 0.1, 0.2])
    blank = np.zeros((3, len(points), 3))
    test = BulgeTest.from_arrays(points, blank, pressure, time=np.array([0.0, 30.0, 70.0]))
    return VirtualTest(test, SETUP)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    with one_blas_thread():
        yield
