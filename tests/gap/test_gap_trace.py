"""The part of a residual that is smooth in space and keeps from frame to frame, by its size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.residual.structure import structure

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0}
START = dict(zip(MODULI, TRUTH.values(), strict=True))


@dataclass(frozen=True)
class Scene:
    """Noise about a model that is right, and a smooth pattern (noise units) that grows."""

    data: list[Data]
    fit: Regression
    pattern: np.ndarray

    def missing(self, size: float) -> Regression:
        """The fit, had the model missed the pattern times a size."""
        (p,) = self.fit.predictions
        shifted = type(p)(
            p.displacement - size * self.pattern * self.data[0].sigma, p.derivative, p.shapes
        )
        return Regression(**{**vars(self.fit), "predictions": [shifted]})


@pytest.fixture(scope="module")
def scene(made_by_the_model: Callable[..., Data]) -> Scene:
    data = [made_by_the_model(TRUTH, spacing=5.0, frames=12, seed=3)]
    points = data[0].specimen.reference
    radius = np.hypot(*points[:, :2].T) / 100.0
    ring = 1.0 - 6.0 * radius**2 + 6.0 * radius**4
    growth = np.linspace(1.2, 0.8, 12)
    pattern = (growth[:, None] * ring / np.std(ring))[..., None] * np.ones(3)
    return Scene(data, regress(data, MODULI, START), pattern)


def test_noise_leaves_no_trace(scene: Scene) -> None:
    found = structure(scene.data, scene.fit)
    assert not found.significant
    assert abs(found.smooth) < found.by_chance


def test_a_pattern_within_the_models_floor_is_seen(scene: Scene) -> None:
    """A quarter of a noise unit is no structure yet; its size is that of the smooth part."""
    near = scene.missing(0.25)
    found = structure(scene.data, near)
    assert not found.significant
    assert found.smooth == pytest.approx(0.25**2, rel=0.2)


def test_beside_offsets_of_points_all_that_persists_is_a_trace(scene: Scene) -> None:
    """They take away what stays the same, of the noise too; a pattern that changes sign is left."""
    coordinates = Coordinates.of([], [d.specimen.nulls() for d in scene.data])
    creased = Weighing(
        scene.data, coordinates, [Creases.of(d, np.full(3, 1.0), 0.0) for d in scene.data]
    )
    layout, start = Layout.of(coordinates.groups), np.log(list(TRUTH.values()))
    fit = regression_of(creased, descend(creased, layout, freeze({}), start))
    found = structure(scene.data, fit)
    assert abs(found.smooth) < found.by_chance < 0.02
    assert found.persistent < -2.0 * found.by_chance  # a mean of 12 frames was taken off
    waves = np.cos(np.linspace(0.0, np.pi, 12))[:, None, None] * scene.pattern
    near = Scene(scene.data, fit, waves).missing(0.3)
    found = structure(scene.data, near)
    assert not found.significant
    assert found.smooth == pytest.approx(0.3**2 / 2, rel=0.2)
    assert found.smooth > 2.0 * found.by_chance
