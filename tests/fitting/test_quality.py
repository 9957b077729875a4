"""Does a fit say how good it is: noise, structure, and what its user must know?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.registry import parameter_named
from bulgefit.fitting.fit import fit
from bulgefit.fitting.quality import Doubt, Quality, _words
from bulgefit.model.setup import Setup

Maker = Callable[..., BulgeTest]

BOUNDS = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
#: mm.
NOISE = 0.05


def changed(test: BulgeTest, displacement: np.ndarray) -> BulgeTest:
    """The test with other displacements."""
    return BulgeTest.from_arrays(test.blocks[0].reference, displacement, test.pressure, name="made")


def judged(test: BulgeTest, setup: Setup, **options: object) -> Quality:
    return fit(test, **{"bounds": BOUNDS, "starts": 2, "setup": setup, **options}).quality


def test_pure_noise_is_a_misfit_of_one(make: Maker, setup: Setup) -> None:
    test = make(noise=NOISE, frames=10, points=300)
    found = judged(test, setup)
    # the noise is judged by medians of differences of neighbouring frames, of which six are left
    assert found.misfit_over_noise == pytest.approx(1.0, abs=0.05)
    assert found.structured_share is not None
    assert found.structured_share < 0.1
    assert found.noise_mm == pytest.approx([NOISE] * 3, rel=0.12)
    # of the deviations of a model that does not deform all but those of the noise are explained
    assert 0.9 < found.explained_share < 1.0
    assert (found.agreeing, found.starts) == (2, 2)
    assert found.warnings == []
    assert all("is found" in text for text in found.identifiability.values())


def test_structure_is_the_share_that_is_no_noise(make: Maker, setup: Setup) -> None:
    test = make(noise=NOISE, frames=10, points=300)
    block = test.blocks[0]
    # what no modulus makes: a tilt that grows with pressure
    wave = block.reference[:, 0] / 95.0 * np.linspace(0.2, 1.0, 10)[:, None]
    seen = np.array(block.displacement)
    seen[..., 2] += 0.3 * wave
    found = judged(changed(test, seen), setup)
    square = (0.3 * wave) ** 2
    structure = square.mean() / 3 / NOISE**2
    assert found.misfit_over_noise == pytest.approx(np.sqrt(1 + structure), rel=0.1)
    assert found.structured_share == pytest.approx(structure / (1 + structure), abs=0.05)


def test_a_test_of_unknown_noise_does_not_hide_what_the_others_show(
    make: Maker, setup: Setup
) -> None:
    """Sixteen points tell none; the misfit of the other, and what its model lacks, is told."""
    test = make(noise=NOISE, frames=10, points=300)
    seen = np.array(test.blocks[0].displacement)
    seen[..., 2] += 0.3 * test.blocks[0].reference[:, 0] / 95.0
    bent, few = changed(test, seen), make(noise=NOISE, frames=10, points=16, seed=1, name="few")
    options = {"bounds": BOUNDS, "starts": 1, "setup": setup}
    alone, found = (fit(tests, **options).quality for tests in (bent, [bent, few]))
    assert found.misfit_over_noise == pytest.approx(alone.misfit_over_noise, rel=0.05)
    assert found.noise_mm == pytest.approx(alone.noise_mm, rel=0.05)
    codes = [warned.code for warned in found.warnings]
    assert codes == ["model_lacks", "noise_unknown"]
    assert found.warnings[1].text.startswith("the noise of few is not known")


def test_images_at_rest_tell_the_noise_of_a_few_points(make: Maker, setup: Setup) -> None:
    """So that what the model lacks is told, where the points alone tell no noise."""
    test = make(noise=NOISE, frames=10, points=16)
    rest = np.random.default_rng(5).normal(scale=NOISE, size=(60, 16, 3))
    seen = np.array(test.blocks[0].displacement)
    seen[..., 2] += 0.3 * test.blocks[0].reference[:, 0] / 95.0
    codes = {}
    for name, moved in (("clean", test), ("bent", changed(test, seen))):
        found = judged(replace(moved, static_displacement=rest), setup)
        assert found.noise_mm == pytest.approx([NOISE] * 3, rel=0.15)
        codes[name] = [warned.code for warned in found.warnings]
    assert codes == {"clean": [], "bent": ["model_lacks"]}


def test_worse_than_a_model_that_does_not_deform(make: Maker, setup: Setup) -> None:
    """The z axis points into the specimen: no modulus bulges the other way."""
    test = make(noise=NOISE, frames=10)
    found = judged(
        changed(test, test.blocks[0].displacement * [1.0, 1.0, -1.0]), setup, objective="e"
    )
    codes = [warned.code for warned in found.warnings]
    assert "worse_than_undeformed" in codes
    assert found.explained_share < 0.0
    assert any("worse than a model that does not deform" in line for line in found.lines())


def test_one_point_for_three_moduli(make: Maker, setup: Setup) -> None:
    found = judged(make(noise=NOISE, frames=10), setup, objective="e_z")
    (warned,) = [w for w in found.warnings if w.code == "too_few_points"]
    assert warned.text.startswith("1 point for 3 parameters: they cannot all be found")
    codes = {w.code for w in judged(make(noise=NOISE, frames=10), setup).warnings}
    assert "too_few_points" not in codes


def test_a_mesh_too_coarse_for_the_noise_is_said(make: Maker) -> None:
    """What is left of the mesh's error is told beside the noise, in mm."""
    test = make(exact=True, noise=0.002, frames=8, points=150)
    coarse, fine = (judged(test, Setup(refine=n), starts=1) for n in (2, 4))
    assert "mesh_error_large" in {w.code for w in coarse.warnings}
    assert "mesh_error_large" not in {w.code for w in fine.warnings}
    assert coarse.mesh_error_mm is not None
    assert fine.mesh_error_mm is not None
    assert max(fine.mesh_error_mm) < 0.2 * max(coarse.mesh_error_mm)


def test_what_is_left_of_the_coarsest_meshs_error_is_not_known(
    make: Maker, monkeypatch: pytest.MonkeyPatch
) -> None:
    test = make(exact=True, noise=NOISE, frames=8)
    codes = {w.code for w in judged(test, Setup(refine=1), starts=1).warnings}
    assert "mesh_remainder_unknown" in codes
    assert "mesh_error_unknown" not in codes
    # where the finer mesh finds no equilibrium, nothing is taken off
    monkeypatch.setattr("bulgefit.fitting.objective.correct_mesh", lambda *_: None)
    codes = {w.code for w in judged(test, Setup(refine=1), starts=1).warnings}
    assert "mesh_error_unknown" in codes
    assert "mesh_remainder_unknown" not in codes


def test_every_doubt_can_be_said() -> None:
    """With all the words that any asks for; codes are what scripts rely on."""
    words = {"name": "E1", "value": 300.0, "lower": 20.0, "upper": 300.0, "starts": 3}
    words |= {"points": "1 point", "parameters": 3, "first": "E1", "second": "nu12", "by": 0.99}
    words |= {"share": 34.0, "names": "E1", "this": "E1 = 300", "other": "E1 = 200"}
    words |= {"mean": 330.0, "deviation": 0.02, "alone": 320.0, "stderr": 0.1, "apart": 98.1}
    said = [doubt.of(**words) for doubt in Doubt]
    assert all("{" not in one.text and "}" not in one.text for one in said)
    assert said[0].text.endswith("widen --bounds E1=20:300, or hold it")
    assert [one.code for one in said] == [
        "at_bound", "worse_than_undeformed", "explains_little", "model_lacks", "other_optimum",
        "undetermined", "no_start_converged", "starts_disagree",
        "too_few_points", "inseparable", "prior_conflict", "noise_unknown", "mesh_error_unknown",
        "mesh_remainder_unknown", "mesh_error_large", "stated_unknown",
    ]  # fmt: skip


@pytest.mark.parametrize(("noise", "alike"), [(0.05, True), (0.01, False)])
def test_parameters_that_are_both_well_found_can_be_told_apart(
    make: Maker, setup: Setup, noise: float, alike: bool
) -> None:
    """At the apex their sum is felt, their difference hardly: to 20 %, or to 5 with less noise."""
    test = make(noise=noise, frames=10, points=1000)
    block = test.blocks[0]
    near = np.argsort(np.hypot(block.reference[:, 0], block.reference[:, 1]))[:3]
    seen = BulgeTest.from_arrays(
        block.reference[near], block.displacement[:, near], test.pressure, name="apex"
    )
    found = fit(seen, bounds={**BOUNDS, "G12": (30.0, 30.0)}, starts=1, setup=setup)
    assert abs(found.uncertainty.data_correlation["E2", "E1"]) > 0.98
    assert ("inseparable" in {w.code for w in found.quality.warnings}) == alike


def test_an_effect_that_is_absent_is_found_to_be(make: Maker, setup: Setup) -> None:
    """Its value is all but nothing, and its error many times that; but a small one."""
    test = make(noise=NOISE, frames=8, points=300)
    found = fit(test, effects=("pressure_offset",), bounds=BOUNDS, starts=1, setup=setup)
    error, value = found.uncertainty.stderr["pressure_offset.offset"], found.effects
    assert error is not None
    assert error > abs(value["pressure_offset.offset"])
    said = found.quality.identifiability["pressure_offset.offset"]
    assert said.startswith("pressure_offset.offset is found")
    assert said.endswith(" bar")
    assert "cannot" not in found.report()


@pytest.mark.parametrize(
    ("name", "value", "error", "said"),
    [
        # over its prior, 0.5 of the thickness, about its null, 0
        ("surface_offset.share", 2e-5, 4e-4, "is found within 0.0004"),
        ("surface_offset.share", 2e-5, 0.1, "is found roughly, within 0.1"),
        ("surface_offset.share", 0.3, 0.45, "is hardly found: its standard error is 90 % of what"),
        ("surface_offset.share", 0.3, 0.55, "cannot be found from this test"),
        # over how far it is off where that is more
        ("surface_offset.share", -4.0, 0.55, "is found roughly, within 0.55"),
        ("surface_offset.share", 1.0, 0.55, "is hardly found: its standard error is 55 % of it"),
        # over its value where nothing is said of a null, or no width
        ("poisson_ratio.nu12", 0.24, 0.012, "is found within 5 %"),
        ("E1", 300.0, 60.0, "is found roughly, within 20 %"),
        ("E1", 0.0, 1e-9, "cannot be found from this test"),
        ("E1", 300.0, None, "cannot be found from this test"),
    ],
)
def test_how_well_something_is_found(
    name: str, value: float, error: float | None, said: str
) -> None:
    parameter = parameter_named(name) if "." in name else Parameter(name, "MPa", 100.0, 400.0)
    assert _words(parameter, value, error).startswith(f"{parameter.name} {said}")
