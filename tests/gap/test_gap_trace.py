"""A trace of the gap's pattern, weaker than what is granted to the model, betrays an imitation."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import pytest

from bulgefit.gap.data import Data
from bulgefit.gap.doubt import (
    BEYOND_THE_EDGE,
    beyond_the_edge,
    hardly_flattened,
    leaves_a_trace,
)
from bulgefit.gap.effects import CATALOGUE, FIELD, FLATTENING, MODULI
from bulgefit.gap.explain import explain
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.structure import structure

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0}


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
    return Scene(data, regress(data, MODULI, TRUTH), pattern)


def test_noise_leaves_no_trace(scene: Scene) -> None:
    found = structure(scene.data, scene.fit)
    assert not found.significant
    assert abs(found.smooth) < found.by_chance
    assert not leaves_a_trace(scene.data, scene.missing(5.0), scene.fit, found)


def test_a_pattern_within_the_models_floor_is_seen(scene: Scene) -> None:
    """A quarter of a noise unit is no structure yet; its size is that of the smooth part."""
    near = scene.missing(0.25)
    found = structure(scene.data, near)
    assert not found.significant
    assert found.smooth == pytest.approx(0.25**2, rel=0.2)


def test_beside_offsets_of_points_all_that_persists_is_a_trace(scene: Scene) -> None:
    """They take away what stays the same, of the noise too; a pattern that changes sign is left."""
    fit = regress(scene.data, (*MODULI, FIELD), TRUTH)
    found = structure(scene.data, fit)
    assert abs(found.smooth) < found.by_chance < 0.02
    assert found.persistent < -2.0 * found.by_chance  # a mean of 12 frames was taken off
    waves = np.cos(np.linspace(0.0, np.pi, 12))[:, None, None] * scene.pattern
    near = Scene(scene.data, fit, waves).missing(0.3)
    found = structure(scene.data, near)
    assert not found.significant
    assert found.smooth == pytest.approx(0.3**2 / 2, rel=0.2)
    assert found.smooth > 2.0 * found.by_chance


@pytest.mark.parametrize(("gap", "betrayed"), [(4.0, True), (20.0, False)])
def test_a_trace_counts_beside_what_was_explained(scene: Scene, gap: float, betrayed: bool) -> None:
    """Effects that take off a large gap may leave more: none is modelled better than to 1 %."""
    near = scene.missing(0.25)
    found = structure(scene.data, near)
    assert leaves_a_trace(scene.data, scene.missing(gap), near, found) is betrayed


@pytest.mark.parametrize(
    ("cause", "imitated"),
    [
        ({"dic_smoothing.window": 4.0}, True),
        ({"prestrain.slack_x": 2e-4, "prestrain.slack_y": 2e-4}, True),
        ({"reference_state.z20": 0.05, "reference_state.x02": 0.02}, False),
    ],
    ids=["smoothing", "slack", "reference state"],
)
def test_one_flexible_effect_is_betrayed_as_well(
    made_by_the_model: Callable[..., Data], cause: dict[str, float], imitated: bool
) -> None:
    """A reference state comes near what small windows and slack do, and leaves no structure."""
    data = [made_by_the_model({**TRUTH, **cause}, spacing=6.0, frames=12, seed=3)]
    with ThreadPoolExecutor(1) as executor:
        found = explain(
            data, [CATALOGUE["reference_state"]], regress(data, MODULI, TRUTH), executor
        )
    assert [*found.groups] == ["reference_state"]
    assert not found.remainder.significant
    assert found.doubt == ("trace" if imitated else "")


@pytest.mark.parametrize(
    ("cause", "completed"),
    [
        ({"initial_shape.h0": 2.5}, True),
        ({"reference_state.z20": 0.1, "pressure_offset.offset": 0.02}, False),
        ({"reference_state.z20": 0.025, "pressure_offset.offset": 0.05}, True),
    ],
    ids=["dome", "reference state and offset", "offset and next to no reference state"],
)
def test_what_completes_a_flexible_effect_or_is_one_that_completes_is_not_named(
    made_by_the_model: Callable[..., Data], cause: dict[str, float], completed: bool
) -> None:
    """A reference state comes near what a dome does; an offset of pressure takes what it misses.

    And a reference state can take what an offset misses of anything.
    """
    data = [made_by_the_model({**TRUTH, **cause}, spacing=6.0, frames=12, seed=3)]
    effects = [CATALOGUE["reference_state"], CATALOGUE["pressure_offset"]]
    with ThreadPoolExecutor(1) as executor:
        found = explain(data, effects, regress(data, MODULI, TRUTH), executor)
    assert {*found.groups} == {"reference_state", "pressure_offset"}
    assert not found.remainder.significant
    assert found.doubt == ("completion" if completed else "")


@pytest.mark.parametrize(("window", "beyond"), [(20.0, True), (11.0, False)])
def test_a_parameter_that_would_leave_its_range_is_noticed(
    made_by_the_model: Callable[..., Data], window: float, beyond: bool
) -> None:
    """Windows are plausible up to 15 mm."""
    truth = {**TRUTH, "dic_smoothing.window": window}
    data = [made_by_the_model(truth, spacing=8.0, frames=8, seed=3)]
    key = "dic_smoothing.window"
    fit = regress(data, (*MODULI, key), {**TRUTH, key: 12.0})
    assert (beyond_the_edge(fit) > BEYOND_THE_EDGE) is beyond


def test_how_far_beyond_the_edge_a_parameter_is_seen(
    made_by_the_model: Callable[..., Data],
) -> None:
    """The square of the distance in standard errors, of a linear parameter."""
    key = "rigid_motion.shift_z"
    data = [made_by_the_model({**TRUTH, key: 2.01}, spacing=12.0, frames=8, seed=3)]
    fit = regress(data, (*MODULI, key), {**TRUTH, key: 1.0})
    assert fit.values[key] == pytest.approx(2.0)
    error = fit.standard_errors()[key]
    assert beyond_the_edge(fit) == pytest.approx((0.01 / error) ** 2, rel=0.3)


def test_an_edge_that_the_data_leave_open_is_no_reason_to_doubt(
    made_by_the_model: Callable[..., Data],
) -> None:
    """Where the slope hardly changes, a knee may be anywhere."""
    data = [made_by_the_model(TRUTH, spacing=12.0, frames=8, seed=3)]
    knee = "nonlinear_material.knee_x"
    start = {**TRUTH, "nonlinear_material.s_x": 1e-3, knee: 0.05}
    fit = regress(data, (*MODULI, knee), start, iterations=0)
    assert fit.values[knee] == 0.05
    assert beyond_the_edge(fit) < BEYOND_THE_EDGE / 5


@pytest.mark.parametrize(("flattening", "slow"), [(0.0, False), (0.4, False), (0.5, True)])
def test_offsets_that_pressure_hardly_flattens_are_noticed(
    scene: Scene, flattening: float, slow: bool
) -> None:
    """Of 0.4 bar, 14 % is left at 2.5 bar."""
    keys = (*MODULI, FIELD, FLATTENING)
    fit = regress(scene.data, keys, {**TRUTH, FLATTENING: flattening}, iterations=0)
    assert hardly_flattened(scene.data, fit) is slow
