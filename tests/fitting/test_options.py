"""Options, priors and effects of a fit: what they do, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting import objective as module
from bulgefit.fitting.batch import batch_of
from bulgefit.fitting.bootstrap import bootstrap
from bulgefit.fitting.crossval import crossval
from bulgefit.fitting.evaluate import evaluate
from bulgefit.fitting.fit import fit, weighed
from bulgefit.fitting.guess import bounds_from
from bulgefit.fitting.minimise import Limits, _Model, descend
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.options import FitOptions, options_from
from bulgefit.fitting.problem import Prior, Problem
from bulgefit.model.parameters import material
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup

Maker = Callable[..., BulgeTest]

ONE = material("isotropic", E=250, nu=0.24)


def test_an_unknown_option_names_the_nearest(make: Maker) -> None:
    with pytest.raises(InputError, match=r"fit has no option 'bound'; did you mean bounds\?"):
        fit(make(), bound={"E1": (1.0, 2.0)})
    with pytest.raises(InputError, match=r"fit has no option 'xyzzy'; there are objective, mat"):
        fit(make(), xyzzy=1)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"starts": 0}, "starts: must be 1 or more, got 0"),
        ({"seed": -1}, "seed: must be 0 or more, got -1"),
        ({"limits": Limits(evaluations=0)}, "limits: evaluations must be 1 or more, got 0"),
    ],
)
def test_numbers_that_cannot_be(make: Maker, option: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit(make(), **option)


def test_names_given_as_one_string_are_a_list() -> None:
    found = options_from(FitOptions(starts=3), {"effects": "clamp_slip,prestrain", "free": "nu12"})
    assert found.effects == ("clamp_slip", "prestrain")
    assert found.free == ("nu12",)
    assert found.starts == 3
    assert options_from(found, {"starts": None}).starts == 3


def test_a_prior_pulls_by_the_closed_formula(make: Maker, setup: Setup) -> None:
    """Near its optimum a likelihood is quadratic: means weigh by one over their variances."""
    test = make(ONE, noise=0.3, frames=8, points=100)
    options = {"material": "isotropic", "starts": 1, "setup": setup, "bounds": {"E": (100, 500)}}
    free = fit(test, "likelihood", **options)
    best = free.material.values["E"]
    problem = Problem(
        Objective([test], "likelihood", setup), "isotropic", bounds={"E": (100.0, 500.0)}
    )
    z = problem.coordinates({"E": best})
    weighed(problem, z)
    rows = problem.evaluate(z, derivatives=True).rows
    assert rows is not None
    hessian, _ = rows.normal(np.zeros(1), 0.0)
    error = problem.value_slope(0, z) / np.sqrt(hessian[0, 0])
    prior = Prior(best + 4.0 * error, 2.0 * error)
    expected = (best + prior.mean / 4.0) / (1.0 + 1.0 / 4.0)
    pulled = fit(test, "likelihood", priors={"E": prior}, **options)
    assert pulled.material.values["E"] == pytest.approx(expected, abs=0.02 * error)
    # the value is that of the data alone, by the noise that this fit's start has left
    weighed(problem, problem.coordinates(pulled.descents[0].best.values))
    least = problem.evaluate(z).value
    assert pulled.value == pytest.approx(least + 0.5 * 0.8**2, abs=0.02)


@pytest.mark.parametrize("name", ["e_w", "likelihood"])
def test_a_belief_beyond_doubt_is_the_answer(name: str, make: Maker, setup: Setup) -> None:
    test = make(ONE, noise=0.05, frames=8)
    found = fit(
        test, name, material="isotropic", starts=1, setup=setup, priors={"E": Prior(280.0, 1e-3)}
    )
    assert found.material.values["E"] == pytest.approx(280.0, abs=0.05)


def test_a_start_is_drawn_to_what_is_believed_beyond_doubt(make: Maker, setup: Setup) -> None:
    """From the data's own optimum no way leads there: the objective's numbers would end."""
    objective = Objective([make(ONE, noise=0.05, frames=8)], "e_w", setup)
    priors = {"E": Prior(280.0, 1e-3)}
    problem = Problem(objective, "isotropic", bounds={"E": (100.0, 625.0)}, priors=priors)
    for point in (0.0, 0.5, 1.0):  # in the middle, 250
        found = descend(problem, problem.start(np.array([point]))).best
        assert found.values["E"] == pytest.approx(280.0, abs=0.01)


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("name", ["e_w", "e_z", "likelihood"])
def test_priors_slope_is_that_of_differences(
    name: str, whole: bool, make: Maker, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However far off what is believed lies."""
    if whole:
        monkeypatch.setattr(module, "SAMPLE", 1_000)
    setup = Setup(refine=2, tolerance=1e-6, correct_mesh=False)
    objective = Objective([make(ONE, noise=0.05, frames=8, points=200)], name, setup)
    priors = {"E": Prior(230.0, 3.0)}
    problem = Problem(objective, "isotropic", bounds={"E": (100.0, 500.0)}, priors=priors)
    problem = problem.on_all_data() if whole else problem
    z = problem.coordinates({"E": 240.0})
    step = np.full(1, 1e-5)
    here, below, above = (problem.evaluate(at, derivatives=True) for at in (z, z - step, z + step))
    assert here.slope is not None
    expected = (above.value - below.value) / 2e-5
    assert here.slope[0] == pytest.approx(expected, rel=2e-3)
    # and a short step falls by what it promises
    step, fall = _Model(problem, here, z).minimise(1e-5)
    there = problem.evaluate(z + step, derivatives=True)
    assert fall == pytest.approx(here.value - there.value, rel=2e-2)


@pytest.mark.parametrize("value", [2.0, 9.0])
def test_a_prior_of_what_acts_through_its_square(value: float, make: Maker, setup: Setup) -> None:
    """Pulls by the value, however a fit steps in it; its curvature is that of Gauss and Newton."""
    name, mean, deviation = "dic_smoothing.window", 5.0, 0.5
    problem = FitOptions(
        "likelihood", setup=setup, effects=(name,), priors={name: Prior(mean, deviation)}
    ).problem([make(noise=0.05, frames=8)])
    z = problem.coordinates({"E1": 300.0, "E2": 200.0, "G12": 20.0, name: value})
    hessian, slope = problem.pull(1.0, z)
    step = 1e-5 * np.eye(4)[3]
    off = [(problem.values(at)[name] - mean) / deviation for at in (z - step, z + step)]
    assert slope[3] == pytest.approx(np.diff(0.5 * np.square(off))[0] / 2e-5, rel=1e-6)
    assert hessian[3, 3] == pytest.approx((np.diff(off)[0] / 2e-5) ** 2, rel=1e-6)


@pytest.mark.parametrize("method", ["gauss-newton", "L-BFGS-B"])
def test_a_prior_against_the_data_joins_their_likelihood(
    method: str, make: Maker, setup: Setup
) -> None:
    """The optimum is that of n ln F + ½ ((v - m)/s)², by looking at many places."""
    test = make(ONE, noise=0.3, frames=6, points=60)
    mean, deviation = 230.0, 2.0
    options = {"material": "isotropic", "bounds": {"E": (100.0, 500.0)}, "setup": setup}
    found = fit(
        test, "e_z", starts=2, method=method, priors={"E": Prior(mean, deviation)}, **options
    )
    problem = FitOptions("e_z", **options).problem([test])
    (noise,) = problem.objective.noise()
    assert noise is not None
    places = np.linspace(225.0, 255.0, 301)
    left = [problem.evaluate(problem.coordinates({"E": place})).value for place in places]
    counted = problem.objective.count / noise.inflation
    total = counted * np.log(left) + 0.5 * ((places - mean) / deviation) ** 2
    assert found.material.values["E"] == pytest.approx(places[np.argmin(total)], abs=0.15)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"priors": {"E9": Prior(1.0, 1.0)}}, r"prior: E9 is not fitted \(fitted: E1, E2, G12\)"),
        ({"priors": {"E1": Prior(1.0, 0.0)}}, "prior of E1: give a finite mean and a deviation"),
        ({"held": {"E9": 1.0}}, "hold: 'E9' is no parameter"),
        ({"held": {"E1": 1.0}}, "hold: E1 is fitted; hold it or fit it"),
        ({"held": {"clamp_slip.x": 1.0}}, "clamp_slip has no parameter 'x'; choose from comp"),
        (
            {"held": {"clamp_slip.compliance": -0.5}},
            r"hold: clamp_slip\.compliance must be 0 or more, got -0\.5",
        ),
        (
            {"held": {"pressure_gain.gain": -1.0}},
            r"hold: pressure_gain\.gain must be above -1, got -1",
        ),
        (
            {"effects": "clamp_slip", "bounds": {"clamp_slip.compliance": (-0.1, 0.1)}},
            r"bounds of clamp_slip\.compliance must be 0 or more, got -0\.1",
        ),
        ({"effects": "clamp_slap"}, r"effect 'clamp_slap' is unknown; did you mean clamp_slip"),
        ({"effects": "pressure_gain"}, "pressure_gain cannot be fitted: a gain of pressure is"),
        ({"effects": "creep"}, "made: creep needs the time of its frames"),
        (
            {"effects": "clamp_slip", "bounds": {"clamp_slip.compliance": (0.2, 0.1)}},
            r"must be finite and ascend, got 0\.2:0\.1; an effect is held by --hold",
        ),
    ],
)
def test_what_cannot_be_asked_for(
    options: dict[str, object], said: str, make: Maker, setup: Setup
) -> None:
    with pytest.raises(InputError, match=said):
        fit(make(), starts=1, setup=setup, **options)  # type: ignore[arg-type]


def test_equal_bounds_hold_a_modulus(make: Maker, setup: Setup) -> None:
    """As a prior without doubt does; in refits, folds and batches too."""
    tests = [make(noise=0.02, name=name, seed=i) for i, name in enumerate(("one", "two"))]
    options = {"bounds": {"E1": (300.0, 300.0)}, "starts": 1, "setup": setup}
    found = fit(tests, "likelihood", **options)
    believed = {**options, "bounds": {}, "priors": {"E1": Prior(300.0, 1e-4)}}
    wanted = fit(tests, "likelihood", **believed).material.values
    assert found.material.values["E1"] == 300.0
    assert found.material.values == pytest.approx(wanted, rel=1e-3)
    assert [p.name for p in found.free] == ["E2", "G12"]
    assert "  E1             300 MPa  held" in found.report()
    assert "\n1 start, 1 converged, 1 at this optimum; " in found.report()
    refits = bootstrap(found, tests, replicates=20)
    assert [p.name for p in refits.free] == ["E2", "G12"]
    folds = crossval(tests, "likelihood", **options)["folds"]
    assert {fold["parameters"]["E1"] for fold in folds} == {300.0}
    assert list(batch_of([fit(test, **options) for test in tests]).spreads) == ["E2", "G12"]


def test_an_effect_is_found_beside_the_moduli(make: Maker, setup: Setup) -> None:
    """What was put in by the virtual test comes back; each specimen has its own."""
    truth = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
    offsets = (0.02, -0.03)
    tests = []
    for i, offset in enumerate(offsets):
        blank = make(frames=6, points=60, name=f"t{i}")
        seen = predict(blank, truth, effects={"pressure_offset.offset": offset}, setup=setup)
        tests.append(
            BulgeTest.from_arrays(
                blank.blocks[0].reference, seen.displacement, blank.pressure, name=f"t{i}"
            )
        )
    found = fit(tests, effects="pressure_offset", starts=1, setup=setup)
    for name, value in truth.items():
        assert found.material.values[name] == pytest.approx(value, rel=2e-3)
    for i, offset in enumerate(offsets):
        assert found.effects_of(i) == {"pressure_offset.offset": pytest.approx(offset, abs=2e-4)}
    entry = found.to_dict()["parameters"]["pressure_offset.offset@1"]
    assert entry["unit"] == "bar"
    assert entry["free"]

    # the same values held, each of its own test, and as they were written
    own = {f"pressure_offset.offset@{i}": offset for i, offset in enumerate(offsets)}
    held = fit(tests, held=own, starts=1, setup=setup)
    for name, value in truth.items():
        assert held.material.values[name] == pytest.approx(value, rel=2e-3)
    assert held.to_dict()["parameters"]["pressure_offset.offset@1"]["unit"] == "bar"
    told = evaluate(tests, held.material, effects=own, setup=setup)
    assert told["e_w"] < 0.01 * evaluate(tests, held.material, setup=setup)["e_w"]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("clamp_slip.compliance@2", "there are 2 tests, @0 to @1"),
        ("clamp_slip.compliance@b", "behind the @ stands the number of a test"),
        ("clamp_slip.compliance@1", None),
    ],
)
def test_what_is_one_tests_own_is_of_a_test_that_there_is(
    make: Maker, setup: Setup, name: str, said: str | None
) -> None:
    tests, effects = [make(name="a"), make(name="b", noise=1e-9)], {name: 0.01}
    moduli = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
    if said is not None:
        with pytest.raises(InputError, match=said):
            evaluate(tests, moduli, effects=effects, setup=setup)
        with pytest.raises(InputError, match=said):
            FitOptions(held=effects, setup=setup).problem(tests)
        return
    assert evaluate(tests, moduli, effects=effects, setup=setup)["effects"] == effects
    with pytest.raises(InputError, match=r"is of one among several tests; write clamp_slip\.comp"):
        FitOptions(held=effects, setup=setup).problem(tests[:1])
    with pytest.raises(InputError, match=r"held: .*@1 is of one test alone, and each fold leaves"):
        crossval(tests, held=effects, setup=setup)


def test_a_ratio_that_an_effect_takes_the_place_of_need_not_go_with_any_moduli(
    make: Callable[..., BulgeTest],
) -> None:
    test = replace(make(frames=4, points=60), poisson_ratio=1.2)
    # E1/E2 up to 1.33, where 1.44 would be needed
    bounds = {"E1": (100.0, 200.0), "E2": (150.0, 300.0)}
    assert bounds_from([test]) == bounds_from([replace(test, poisson_ratio=0.5)])
    with pytest.raises(InputError, match="no moduli within their bounds go with what is held"):
        Problem(Objective([test], "e_w"), bounds=bounds)
    Problem(Objective([test], "e_w"), bounds=bounds, effects=["poisson_ratio"])
    Problem(Objective([test], "e_w"), bounds=bounds, held={"poisson_ratio.nu12": 0.3})
