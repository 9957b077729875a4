"""Structure in a residual: what persists from frame to frame, by its size, and whom it trusts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.outcome import Seen, regression_of
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.residual import structure as regional
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
    assert structure(scene.data, scene.missing(0.6)).significant


def test_a_pattern_within_the_models_floor_is_none(scene: Scene) -> None:
    """A quarter of a noise unit is no structure yet; it persists by its square."""
    found = structure(scene.data, scene.missing(0.25))
    assert not found.significant
    assert found.persistent == pytest.approx(0.25**2, rel=0.3)


def test_fields_beside_noise_leave_no_trace(scene: Scene) -> None:
    """However many coordinates a model has: most of them are finer than regions are."""
    many = tuple(Key.of(f"stiffness_field.b{n}") for n in range(500))
    found = structure(scene.data, Seen(many, list(scene.fit.predictions)))
    assert not found.significant


def test_a_frame_that_is_doubted_is_no_trace(scene: Scene) -> None:
    """What the model's own doubt explains there is none, and it is told at its size in mm."""
    (data,), (p,) = scene.data, scene.fit.predictions
    off = np.array(p.displacement)
    wave = 10.0 * scene.pattern[:1] * data.sigma
    off[:1] -= wave
    wild = Seen((), [replace(p, displacement=off)])
    trust = np.where(np.arange(12) < 1, 0.1, 1.0)
    assert structure([data], wild).significant
    found = structure([replace(data, trust=trust)], wild)
    assert not found.significant
    largest = max(abs(cell.mean) for cell in found.cells)
    assert largest == pytest.approx(max(abs(c.mean) for c in structure([data], wild).cells))


def test_noise_that_persists_scatters_as_its_cells_are_told_to(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of it the same in every frame: bands share that, and their means have it undivided."""
    monkeypatch.setattr(regional, "MODEL_FLOOR", 0.0)
    (data,), (p,) = scene.data, scene.fit.predictions
    rng, shape = np.random.default_rng(5), data.used.shape
    persists = replace(data, inflation=0.5 * shape[0] + 0.5, persistent=0.5)
    statistics, significances = [], []
    for _ in range(40):
        noise = np.sqrt(0.5) * (rng.normal(size=shape) + rng.normal(size=(1, *shape[1:])))
        noise[rng.random(shape) < 0.2] = np.nan
        found = structure([persists], Seen((), [replace(p, displacement=data_of(data, noise))]))
        statistics.append(found.statistic / len(found.cells))
        significances += [cell.significance for cell in found.cells]
    expected = np.sqrt(2.0 / len(found.cells) / len(statistics))
    assert np.mean(statistics) == pytest.approx(1.0, abs=4 * expected)
    # 3 of 4 bands' worth of what persists is the same: at least a quarter of them are independent
    assert np.var(significances) == pytest.approx(1.0, abs=4 * np.sqrt(8.0 / len(significances)))


def data_of(data: Data, residual: np.ndarray) -> np.ndarray:
    """What a model shows that leaves this residual, in noise units; NaN where nothing was seen."""
    return np.asarray(data.specimen.measured - residual * data.sigma)


def test_beside_offsets_of_points_all_that_persists_is_a_trace(scene: Scene) -> None:
    """They take away what stays the same, of the noise too; a pattern that changes sign is left."""
    coordinates = Coordinates.of([], [d.specimen.nulls() for d in scene.data])
    creased = Weighing(
        scene.data, coordinates, [Creases.of(d, np.full(3, 1.0), 0.0) for d in scene.data]
    )
    layout, start = Layout.of(coordinates.groups), np.log(list(TRUTH.values()))
    fit = regression_of(creased, descend(creased, layout, freeze({}), start))
    found = structure(scene.data, fit)
    # a mean of 12 frames was taken off
    assert found.persistent == pytest.approx(-1.0 / 12.0, abs=0.01)
    waves = np.cos(np.linspace(0.0, np.pi, 12))[:, None, None] * scene.pattern
    near = Scene(scene.data, fit, waves).missing(0.3)
    found = structure(scene.data, near)
    assert not found.significant
    assert found.persistent + 1.0 / 12.0 == pytest.approx(0.3**2 / 2, rel=0.3)
