"""Made bulge tests of known materials on coarse meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.trace import trace
from bulgefit.model.observation import operators
from bulgefit.model.parameters import Material, material
from bulgefit.model.setup import Setup
from bulgefit.parallel.threads import one_blas_thread

#: The mesh of the fits: 228 cells.
COARSE = 2

STIFF = material("orthotropic", E1=330, E2=240, G12=30, nu12=0.24)


@cache
def _seen(of: tuple[float, ...], refine: int, frames: int, points: int) -> np.ndarray:
    """Displacements (frames, points, 3) mm at `_points`, on a mesh."""
    mesh = disc(100.0, refine)
    path = trace(Membrane(mesh), np.array(of), (1e-4, 0.3), tolerance=1e-4)
    assert path.stable.all()
    return operators(mesh, _points(points), "smooth")(path(_pressure(frames)))


def _points(count: int) -> np.ndarray:
    radius = 95 * np.sqrt((np.arange(count) + 0.5) / count)
    angle = np.pi * (1 + 5**0.5) * np.arange(count)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)])


def _pressure(frames: int) -> np.ndarray:
    return np.linspace(0.02, 0.3, frames)


def _make(
    of: Material = STIFF,
    *,
    refine: int = COARSE,
    exact: bool = False,
    frames: int = 5,
    points: int = 80,
    noise: float = 0.0,
    seed: int = 0,
    name: str = "made",
    poisson_ratio: float = 0.24,
) -> BulgeTest:
    given = tuple(of.stiffness().tolist()), frames, points
    if exact:
        # the error of a mesh goes with the square of its cells
        seen = (4.0 * _seen(given[0], 10, *given[1:]) - _seen(given[0], 5, *given[1:])) / 3.0
    else:
        seen = _seen(given[0], refine, *given[1:])
    rng = np.random.default_rng(seed)
    seen = seen + rng.normal(0, noise, seen.shape) if noise else seen
    return BulgeTest.from_arrays(
        _points(points), seen, _pressure(frames), name=name, poisson_ratio=poisson_ratio
    )


@pytest.fixture(scope="session")
def make() -> Callable[..., BulgeTest]:
    """Make a test: `make(material, refine=, frames=, points=, noise=, seed=, name=)`.

    By the coarse mesh, or, where it is to be `exact`, by what finer meshes tend to.
    """
    return _make


@pytest.fixture(scope="session")
def setup() -> Setup:
    """The coarse mesh of the made tests, followed closely: what they are made by, no other one."""
    return Setup(refine=COARSE, tolerance=1e-4, correct_mesh=False)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """As in a fit, so that objectives taken one by one agree with it to the last bit."""
    with one_blas_thread():
        yield
