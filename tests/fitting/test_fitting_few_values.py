"""Is what few values, or points far apart, leave open told as it is, and looked for all round?"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from bulgefit import FitOptions, Prior, bootstrap, evaluate, fit, predict, simulate
from bulgefit.dic import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting.bootstrap import _drawn
from bulgefit.gap.diagnose import diagnose
from bulgefit.model.setup import Setup

SETUP = Setup(refine=1, correct_mesh=False)
MATERIAL = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
SHEAR = {"G12": (30.0, 30.0)}


def grid(count: int, reach: float = 90.0) -> np.ndarray:
    x, y = (g.ravel() for g in np.meshgrid(*[np.linspace(-reach, reach, count)] * 2))
    return np.column_stack([x, y, 0 * x])[np.hypot(x, y) <= reach]


def made(
    points: Any, pressure: Any, noise: float, effects: Mapping[str, float] | None = None
) -> BulgeTest:
    """A test by the model, in MPa, with white noise in mm."""
    points, pressure = np.asarray(points, dtype=float), np.asarray(pressure)
    empty = BulgeTest.from_arrays(
        points, np.zeros((len(pressure), len(points), 3)), pressure, radius=100, thickness=0.81
    )
    moved = predict(empty, MATERIAL, effects=effects, setup=SETUP).displacement
    moved = moved + np.random.default_rng(3).normal(0.0, noise, moved.shape)
    return BulgeTest.from_arrays(points, moved, pressure, radius=100, thickness=0.81)


@pytest.fixture(scope="module")
def few() -> BulgeTest:
    return made(grid(9), [0.05, 0.12, 0.2, 0.3], 0.02)


def test_an_optimum_that_meets_all_values_tells_no_error():
    """Three values, two moduli: two of the residuals are nothing, whatever the noise."""
    found = fit(made([[30, 20, 0]], [0.2], 0.01), setup=SETUP, starts=1, bounds=SHEAR)
    assert found.uncertainty.stderr == {"E1": None, "E2": None}
    several = made([[30, 20, 0], [-20, 50, 0], [40, -30, 0], [60, 10, 0]], [0.2], 0.01)
    found = fit(several, setup=SETUP, starts=1, bounds=SHEAR)
    # eight seeds scatter by 6 MPa
    assert 2.0 < found.uncertainty.stderr["E1"] < 20.0


def test_a_length_that_is_not_there_has_an_error_and_no_negative_interval(few):
    """Near none at all the slope of a length by its square is infinite."""
    found = fit(few, "likelihood", setup=SETUP, starts=1, effects="dic_smoothing")
    low, high = found.uncertainty.interval95["dic_smoothing.window"]
    assert found.effects["dic_smoothing.window"] < high
    assert low >= 0.0
    assert 0.0 < found.uncertainty.stderr["dic_smoothing.window"] < 10.0


@pytest.mark.parametrize("side", [180.0, -150.0])
def test_a_lift_on_the_other_side_is_found(side):
    """From 0 degree there is no slope towards it, and its amplitude falls to nothing."""
    lifted = {"rim_lift.amplitude": 0.3, "rim_lift.direction": side}
    found = fit(
        made(grid(13), [0.05, 0.12, 0.2, 0.3], 0.005, lifted), setup=SETUP, starts=1,
        bounds=SHEAR, effects="rim_lift.amplitude,rim_lift.direction",
    )  # fmt: skip
    away = found.effects["rim_lift.direction"] - side
    assert abs((away + 180) % 360 - 180) < 0.5
    assert found.effects["rim_lift.amplitude"] == pytest.approx(0.3, abs=0.002)
    assert -180.0 <= found.effects["rim_lift.direction"] <= 180.0
    assert found.uncertainty.stderr["rim_lift.direction"] < 0.5


@pytest.mark.parametrize("objective", ["likelihood", "e_w"])
def test_a_prior_pulls_by_as_much_as_it_says_where_points_lie_far_apart(objective):
    """On 113 points a local surface leaves the dome's own curvature, twice the noise and alike."""
    few = made(grid(13), [0.05, 0.12, 0.2, 0.3], 0.02)
    bounds = {"E2": (240.0, 240.0), **SHEAR}
    alone = fit(few, objective, setup=SETUP, starts=1, bounds=bounds)
    value, error = alone.material.values["E1"], alone.uncertainty.stderr["E1"]
    believed = {"E1": Prior(value + 6 * error, 2 * error)}
    both = fit(few, objective, setup=SETUP, starts=1, bounds=bounds, priors=believed)
    # weighed by one over the variances: 1 and 1/4
    wanted = (value + 0.25 * (value + 6 * error)) / 1.25
    assert both.material.values["E1"] == pytest.approx(wanted, abs=0.4 * error)
    if objective == "likelihood":
        # a half for each value; the noise is known to a tenth or so
        assert alone.value == pytest.approx(0.5 * 3 * few.n_measured, rel=0.25)


def test_runs_of_frames_are_neighbours_in_pressure():
    pressure = np.array([0.3, 0.1, 0.9, 0.5, 0.2, 0.7, 0.4, 0.8, 0.6])
    run = np.repeat([1.0, 0.0], [3, 6])
    runs = [np.roll(run, first) for first in range(9)]
    drawn = [_drawn(pressure, 3, np.random.default_rng(seed)) for seed in range(20)]
    for times in drawn:
        ranked = times[np.argsort(pressure)]
        assert any((a + b + c == ranked).all() for a in runs for b in runs for c in runs)
    assert len({tuple(times) for times in drawn}) > 15


@pytest.mark.parametrize("of", [np.float32, np.int64, np.array])
def test_numbers_of_numpy_are_numbers(few, of):
    options = {"bounds": {"E2": (240, 240), "G12": [of(30), of(30)]}, "held": {"nu12": of(0)}}
    if of is np.array:
        options["bounds"]["G12"] = np.array([30, 30])
        options["held"] = {"nu12": 0}
    found = fit(
        few, setup=SETUP, starts=np.int64(1), seed=np.int64(2), weight=np.array(0.3),
        priors={"E1": Prior(np.float32(330), np.int64(50))},
        uncertainty={"radius": np.float32(0.01)}, **options,
    )  # fmt: skip
    json.dumps(found.to_dict())
    again = bootstrap(found, few, replicates=2, block=np.int64(1), seed=np.int64(3))
    json.dumps(again.to_dict())
    moduli = {name: np.float32(value) for name, value in MATERIAL.items()}
    json.dumps(evaluate(few, moduli, effects={"clamp_slip.compliance": np.float32(0.01)}).to_dict())


def test_options_are_read_alike_however_they_are_given(few):
    given = FitOptions(effects="clamp_slip", free="nu12", setup=SETUP, starts=1, bounds=SHEAR)
    found = fit(few, options=given)
    assert [p.name for p in found.free] == ["E1", "E2", "nu12", "clamp_slip.compliance"]
    with pytest.raises(InputError, match="bounds of G12: give a lower and an upper number"):
        fit(few, options=FitOptions(bounds={"G12": (30,)}))
    with pytest.raises(InputError, match="prior of E1: give numbers"):
        fit(few, priors={"E1": Prior("330", 1)})


def parts(test: BulgeTest) -> list[BulgeTest]:
    """Two of which neither is the other."""
    return [test.select(frames=range(count)) for count in (2, 3)]


@pytest.mark.parametrize(
    ("work", "match"),
    [
        (lambda test: fit(test, effects="reference_field"), "reference_field cannot be fitted"),
        (lambda test: predict(test, MATERIAL, effects={"creep.rate": 0.1}), "creep needs the time"),
        (lambda _: simulate(MATERIAL, 0.1, effects={"creep.rate": 0.1}), "creep needs the time"),
        (lambda test: diagnose(test, held={"creep.rate": 0.1}), "creep needs the time"),
        (lambda test: diagnose(test, holdout=parts(test)), "holdout: give one test"),
        (lambda test: diagnose(test, holdout=[]), "holdout: give one test"),
        (lambda _: Setup(tolerance=-1), "tolerance must be a length above 0 mm"),
        (lambda _: Setup(refine=2.0), "refine must be a whole number"),
        (lambda _: simulate(MATERIAL, 0.1, radius="100"), "radius must be a length above 0 mm"),
        (lambda _: simulate(MATERIAL, 0.1, refine=2.0), "refine must be a whole number"),
    ],
    ids=map(str, range(10)),
)  # fmt: skip
def test_what_would_do_nothing_or_end_in_a_traceback_is_refused(few, work, match):
    with pytest.raises(InputError, match=match):
        work(few)


@pytest.mark.parametrize("numbers", [{"block": 1.5}, {"replicates": 2.0}, {"level": "0.9"}])
def test_a_bootstrap_of_no_numbers(few, numbers):
    found = fit(few, setup=SETUP, starts=1, bounds={"E2": (240, 240), **SHEAR})
    with pytest.raises(InputError, match="bootstrap: "):
        bootstrap(found, few, **numbers)


def test_what_is_left_of_a_gauges_zero_inflates_nothing():
    """0.1 + 0.2 - 0.3: with an effect each frame is balanced, at no less than a pascal."""
    points = grid(5)
    zero = 0.1 + 0.2 - 0.3
    test = BulgeTest.from_arrays(
        points, np.zeros((3, len(points), 3)), [0.0, zero, 0.2], radius=100, thickness=0.81
    )
    for effects in ({}, {"clamp_slip.compliance": 1e-4}):
        moved = predict(test, MATERIAL, effects=effects, setup=SETUP).displacement
        assert np.abs(moved[:2]).max() < 1e-3
        assert moved[2].max() > 20.0
