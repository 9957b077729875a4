"""Made bulge tests of known materials on coarse meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

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


def _make(
    of: Material = STIFF,
    *,
    refine: int = COARSE,
    frames: int = 5,
    points: int = 80,
    noise: float = 0.0,
    seed: int = 0,
    name: str = "made",
    poisson_ratio: float = 0.24,
) -> BulgeTest:
    mesh = disc(100.0, refine)
    pressure = np.linspace(0.02, 0.3, frames)
    path = trace(Membrane(mesh), of.stiffness(), (1e-4, 0.3), tolerance=1e-4)
    assert path.stable.all()
    rng = np.random.default_rng(seed)
    radius = 95 * np.sqrt((np.arange(points) + 0.5) / points)
    angle = np.pi * (1 + 5**0.5) * np.arange(points)
    where = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(points)])
    seen = operators(mesh, where, "shape")(path(pressure))
    seen += rng.normal(0, noise, seen.shape) if noise else 0.0
    return BulgeTest.from_arrays(where, seen, pressure, name=name, poisson_ratio=poisson_ratio)


@pytest.fixture(scope="session")
def make() -> Callable[..., BulgeTest]:
    """Make a test: `make(material, refine=, frames=, points=, noise=, seed=, name=)`."""
    return _make


@pytest.fixture(scope="session")
def setup() -> Setup:
    """A coarse mesh, followed closely."""
    return Setup(refine=COARSE, tolerance=1e-4)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """As in a fit, so that objectives taken one by one agree with it to the last bit."""
    with one_blas_thread():
        yield
