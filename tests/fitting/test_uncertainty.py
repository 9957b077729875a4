"""Are standard errors the scatter that they stand for, and do they hold what was stated?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bulge_lab.fung import FUNG

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fem.laws import registry
from bulgefit.fem.mesh import disc
from bulgefit.fitting.crossval import crossval
from bulgefit.fitting.fit import fit
from bulgefit.fitting.minimise import descend
from bulgefit.fitting.noise_left import noise_left
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.problem import Prior, Problem
from bulgefit.fitting.result import FitResult
from bulgefit.fitting.uncertainty import uncertainty_of
from bulgefit.model.parameters import material
from bulgefit.model.setup import Setup

Maker = Callable[..., BulgeTest]

TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
BOUNDS = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
#: Sets of noise; their scatter is known to 1/√(2 · 60) = 9 %, one standard deviation.
SETS = 60


def test_errors_are_the_scatter_of_many_data_sets(make: Maker, setup: Setup) -> None:
    """By the noise alone; the larger of two estimates, which is told, lies above it."""
    found, noise, told = [], [], []
    for seed in range(1000, 1000 + SETS):
        test = make(noise=0.05, frames=8, points=150, seed=seed)
        problem = Problem(Objective([test], "likelihood", setup), bounds=BOUNDS)
        best = descend(problem, problem.coordinates(TRUTH)).best
        found.append(list(best.values.values()))
        if seed % 6 == 0:
            z = problem.coordinates(best.values)
            shapes = problem.shapes(z, derivatives=True)
            noises = noise_left(problem.objective, shapes)
            errors = uncertainty_of(problem, z, shapes, np.zeros(3, dtype=bool), {}, noises)
            noise.append(list(errors.noise_stderr.values()))
            told.append(list(errors.stderr.values()))
    scatter = np.std(found, axis=0, ddof=1)
    # three standard deviations of the scatter's own error
    np.testing.assert_allclose(np.mean(noise, axis=0) / scatter, 1.0, atol=3 / np.sqrt(2 * SETS))
    np.testing.assert_array_less(np.array(noise) * (1 - 1e-9), told)
    np.testing.assert_array_less(told, 2.0 * np.array(noise))
    # and no bias: three standard errors of the mean
    off = (np.mean(found, axis=0) - list(TRUTH.values())) / (scatter / np.sqrt(SETS))
    assert np.abs(off).max() < 3.0


def test_absolute_deviations_are_less_sure_than_squares(make: Maker, setup: Setup) -> None:
    """Of normal noise a median scatters √(π/2) times as much as a mean (Laplace, 1818)."""
    ratios = []
    for seed in range(6):
        test = make(noise=0.05, frames=8, points=150, seed=seed)
        errors = []
        for name in ("e", "likelihood"):
            problem = Problem(Objective([test], name, setup), bounds=BOUNDS)
            z = problem.coordinates(TRUTH)
            shapes = problem.shapes(z, derivatives=True)
            noises = noise_left(problem.objective, shapes)
            found = uncertainty_of(problem, z, shapes, np.zeros(3, dtype=bool), {}, noises)
            errors.append([found.noise_stderr[key] for key in TRUTH])
        ratios.append(np.divide(*errors))
    # each error is a root of a sum over some hundred cells: off by 5 %, 18 of them by 1 to 2 %
    assert np.mean(ratios) == pytest.approx(np.sqrt(np.pi / 2), rel=0.05)


def test_what_is_at_a_bound_has_no_error_and_is_held_for_the_others(
    make: Maker, setup: Setup
) -> None:
    test = make(noise=0.02, frames=8, points=150)
    bounded = {**BOUNDS, "G12": (10.0, 20.0)}
    found = fit(test, bounds=bounded, starts=1, setup=setup)
    assert found.to_dict()["parameters"]["G12"]["at_bound"]
    errors = found.uncertainty
    assert errors.stderr["G12"] is None
    assert errors.interval95["G12"] is None
    assert errors.stderr["E1"] is not None
    assert errors.interval95["E1"] is not None
    assert all("G12" not in pair for pair in errors.correlation)
    warned = found.quality.warnings[0]
    assert warned.code == "at_bound"
    assert warned.text.startswith("G12 = 20 is the bound of the search")


def test_intervals_are_of_the_value_and_the_parts_of_the_error(make: Maker, setup: Setup) -> None:
    test = make(noise=0.02, frames=8, points=150)
    stated = {"thickness": 0.02, "pressure": 0.01, "nu12": 0.03}
    found = fit(test, bounds=BOUNDS, starts=1, setup=setup, uncertainty=stated)
    errors = found.uncertainty
    for name in TRUTH:
        value, error = found.material.values[name], errors.stderr[name]
        ends = errors.interval95[name]
        assert error is not None
        assert ends is not None
        assert ends[0] < value < ends[1]
        parts = errors.parts[name]
        assert error == pytest.approx(np.sqrt(sum(p**2 for p in parts.values())), rel=1e-6)
        # only E t is felt, and a gain of pressure is a gain of every modulus
        assert parts["thickness"] == pytest.approx(0.02 * value, rel=0.02)
        assert parts["pressure"] == pytest.approx(0.01 * value, rel=0.05)
    # what is stated makes moduli alike; the data tell them apart all the same
    assert errors.correlation["E2", "E1"] > 0.98 > errors.data_correlation["E2", "E1"]
    assert "inseparable" not in {warned.code for warned in found.quality.warnings}
    # what another ratio does is what a fit with it does
    other = fit(test, bounds=BOUNDS, starts=1, setup=setup, held={"nu12": 0.27})
    for name in ("E1", "E2"):
        moved = abs(other.material.values[name] - found.material.values[name])
        assert errors.parts[name]["nu12"] == pytest.approx(moved, rel=0.1)


def _moved_by_thickness(
    found: FitResult, test: BulgeTest, size: float, **options: Any
) -> dict[str, float]:
    """What a fit of a thickness that is larger by a share changes, as errors are: by logarithms."""
    other = fit(replace(test, thickness=test.thickness * (1.0 + size)), **options)
    pairs = ((n, v, other.material.values[n]) for n, v in found.material.values.items())
    return {name: value * abs(np.log(moved / value)) for name, value, moved in pairs}


@pytest.mark.parametrize(
    "held",
    [
        {"bounds": {"E1": (330.0, 330.0)}},
        {"bounds": {**BOUNDS, "G12": (10.0, 20.0)}},
        {"priors": {"G12": Prior(30.0, 0.3)}},
        {"priors": {"E1": Prior(330.0, 3.0)}},
    ],
    ids=["held", "at a bound", "believed", "half believed"],
)
def test_what_holds_a_modulus_is_heeded_by_thickness(
    held: dict[str, Any], make: Maker, setup: Setup
) -> None:
    """The others move as a fit of another thickness finds, and not by its share."""
    test = make(noise=0.02, frames=8, points=150)
    options = {"objective": "likelihood", "starts": 1, "setup": setup, **held}
    found = fit(test, uncertainty={"thickness": 0.01}, **options)
    moved = _moved_by_thickness(found, test, 0.01, **options)
    for name, part in found.uncertainty.parts.items():
        # to first order: what moves by 5 % is right to some
        assert part["thickness"] == pytest.approx(moved[name], rel=0.03)


@pytest.mark.parametrize("law", ["hencky", "svk", "yarn"])
def test_stiffness_times_thickness_is_all_that_is_felt(law: str, make: Maker, setup: Setup) -> None:
    """Also by a rim that gives, by slack and by curves: with all moduli free they move alike."""
    held = {
        "prestrain.slack_x": 0.002,
        "clamp_slip.compliance": 0.02,
        "nonlinear_material.k_x": -2.0,
        "stiffness_gradient.g_x": 0.1,
    }
    test = make(noise=0.02, points=150)
    problem = Problem(Objective([test], "likelihood", replace(setup, law=law)), held=held)
    z = problem.coordinates(TRUTH)
    shapes = problem.shapes(z, derivatives=True)
    noises = noise_left(problem.objective, shapes)
    stated = {"thickness": 0.05}
    errors = uncertainty_of(problem, z, shapes, np.zeros(3, dtype=bool), stated, noises)
    for name, value in TRUTH.items():
        assert errors.parts[name]["thickness"] == pytest.approx(value * np.log(1.05), rel=1e-6)


def test_a_law_with_a_stiffness_of_its_own_is_heeded_by_thickness(
    make: Maker, setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fung's exponential of an energy over a modulus that is the law's: more than E t is felt."""
    monkeypatch.setattr(registry, "_others", lambda: {"fung": FUNG})
    test = make(material("isotropic", E=250, nu=0.24), noise=0.01, frames=8, points=150)
    options = {
        "objective": "likelihood",
        "material": "isotropic",
        "starts": 1,
        "setup": replace(setup, law="fung"),
    }
    found = fit(test, uncertainty={"thickness": 0.01}, **options)
    moved = _moved_by_thickness(found, test, 0.01, **options)["E"]
    # the share would be 6 % more
    assert found.uncertainty.parts["E"]["thickness"] == pytest.approx(moved, rel=0.01)


@pytest.mark.parametrize(
    ("size", "objective", "within"),
    [
        (0.002, "e_w", 0.1),
        (0.002, "e", 0.1),
        (0.01, "e_w", 0.1),
        (0.01, "e", 0.1),
        # its G12 goes with the radius along a curve, of which errors know the slope
        (0.0005, "likelihood", 0.05),
    ],
)
def test_another_clamp_is_what_fits_with_it_find(
    size: float, objective: str, within: float, make: Maker, setup: Setup
) -> None:
    """By the mean of a larger and a smaller one, with which models change by up to 30 noises."""
    test = make(noise=0.02, frames=8, points=150)
    options = {"objective": objective, "bounds": BOUNDS, "starts": 1, "setup": setup}
    found = fit(test, uncertainty={"radius": size}, **options)
    larger, smaller = (
        fit(replace(test, radius=radius), **options).material.values
        for radius in (100.0 * (1 + size), 100.0 * (1 - size))
    )
    for name in TRUTH:
        moved = 0.5 * abs(larger[name] - smaller[name])
        assert found.uncertainty.parts[name]["radius"] == pytest.approx(moved, rel=within)


def test_a_mesh_that_is_given_grows_with_the_clamp(make: Maker, setup: Setup) -> None:
    test = make(noise=0.02, frames=8, points=150)
    options = {"bounds": BOUNDS, "starts": 1, "uncertainty": {"radius": 0.002}}
    own, given = (
        fit(test, setup=one, **options).uncertainty.parts
        for one in (setup, replace(setup, mesh=disc(100.0, setup.refine)))
    )
    for name in TRUTH:
        assert given[name]["radius"] == pytest.approx(own[name]["radius"], rel=1e-3)
    study = fit(test, setup=Setup.study(disc(100.0, setup.refine)), **options).uncertainty
    assert all(part["radius"] > 0.0 for part in study.parts.values())


def test_poissons_ratio_of_a_sheet_takes_its_shear_along(make: Maker, setup: Setup) -> None:
    """As a fit with the other ratio finds: G = E/2(1 + nu)."""
    test = make(material("isotropic", E=250, nu=0.24), noise=0.01, frames=8, points=150)
    options = {"objective": "likelihood", "material": "isotropic", "starts": 1, "setup": setup}
    found = fit(test, uncertainty={"nu12": 0.005}, **options)
    ends = [fit(test, held={"nu": nu}, **options).material.values["E"] for nu in (0.235, 0.245)]
    # with the shear modulus held it would be 2.4 % more
    part = found.uncertainty.parts["E"]["nu12"]
    assert part == pytest.approx(0.5 * abs(ends[1] - ends[0]), rel=5e-3)


def test_what_cannot_be_taken_in_is_said(make: Maker, setup: Setup) -> None:
    """nu12² may not exceed E1/E2."""
    test = make(noise=0.02, frames=8, points=150)
    stated = {"nu12": 0.95, "thickness": 0.01}
    found = fit(test, bounds=BOUNDS, starts=1, setup=setup, uncertainty=stated)
    assert found.uncertainty.unknown == ("nu12",)
    said = [warned.text for warned in found.quality.warnings if warned.code == "stated_unknown"]
    assert len(said) == 1
    assert said[0].startswith("the errors are without that of nu12")


@pytest.fixture
def before_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """No start may be begun."""
    for place in ("fit.multistart", "crossval.descents"):
        monkeypatch.setattr(f"bulgefit.fitting.{place}", lambda *_, **__: pytest.fail("began"))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"material": "isotropic-EG"}, "E and G are fitted, and Poisson's ratio follows"),
        ({"free": ("nu12",)}, r"nu12 is fitted; .* \(--prior nu12=MEAN"),
        ({"material": "isotropic", "free": ("nu",)}, r"nu is fitted; .* \(--prior nu=MEAN"),
        ({"effects": ("poisson_ratio",)}, r"poisson_ratio\.nu12 is fitted"),
        ({"held": {"poisson_ratio.nu12": 0.3}}, r"is held in its place; hold nu12"),
    ],
)
def test_a_ratio_that_was_not_given_has_no_error_to_state(
    options: dict[str, Any], said: str, make: Maker, setup: Setup, before_starts: None
) -> None:
    with pytest.raises(InputError, match=f"uncertainty of nu12: .*{said}"):
        fit(make(), starts=1, setup=setup, uncertainty={"nu12": 0.02}, **options)


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"colour": 0.1}, "uncertainty of 'colour' is not known; choose from thickness, radius"),
        ({"radius": 2.0}, "uncertainty of radius: give a part between 0 and 1, got 2"),
        ({"radius": 0.0}, "uncertainty of radius: give a part between 0 and 1, got 0"),
    ],
)
def test_statements_that_cannot_be(
    stated: dict[str, float], said: str, make: Maker, setup: Setup, before_starts: None
) -> None:
    for verb, tests in ((fit, make()), (crossval, [make(), make(noise=1e-9)])):
        with pytest.raises(InputError, match=said):
            verb(tests, bounds=BOUNDS, starts=1, setup=setup, uncertainty=stated)
