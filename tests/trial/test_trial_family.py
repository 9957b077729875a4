"""Are a family's tests of one cloth, and is its law the one that the truth tells?"""

from __future__ import annotations

import json

import numpy as np
import pytest

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import rectangle
from bulgefit.trial import family as families
from bulgefit.trial.family import SPECIMENS, law_table, make_family
from bulgefit.trial.make import Recipe

SMALL = Recipe(frames=5, spacing=18.0, fineness=8)
MODULI = {"E1": 330.0, "E2": 200.0, "G12": 16.0}


@pytest.fixture(scope="module")
def family():
    return make_family(3, SMALL, "cloth")


def test_three_specimens_of_one_cloth(family):
    truth = json.loads(json.dumps(family.truth))
    assert truth["kind"] == "family"
    assert [test.name for test in family.tests] == [f"cloth_{n}" for n in (1, 2, 3)]
    specimens = truth["specimens"]
    assert [s["name"] for s in specimens] == [test.name for test in family.tests]
    for one in specimens:
        assert one["moduli"]["E1"] == pytest.approx(truth["moduli"]["E1"] * one["factors"]["warp"])
        assert one["moduli"]["E2"] == pytest.approx(truth["moduli"]["E2"] * one["factors"]["fill"])
        assert one["moduli"]["G12"] == truth["moduli"]["G12"]
        own = {"initial_shape", "prestrain"} & {*one["effects"]}
        assert len(own) == 2
        assert {"rigid_motion", "fixture_motion"} & {*one["effects"]}
    laws = [s["parameters"].get("nonlinear_material") for s in specimens]
    assert laws[0] == laws[1] == laws[2]
    slacks = {s["parameters"]["prestrain"]["slack_x"] for s in specimens}
    assert len(slacks) == SPECIMENS
    assert truth["effects"] == sorted({e for s in specimens for e in s["effects"]})


def test_the_seed_is_all_there_is(family):
    again = make_family(3, SMALL, "cloth")
    assert again.truth == family.truth
    for one, other in zip(family.tests, again.tests, strict=True):
        np.testing.assert_array_equal(one.blocks[0].displacement, other.blocks[0].displacement)


def test_factors_scatter_as_said_about_one():
    rng = np.random.default_rng(1)
    logs = np.log([families._factors(0.08, rng) for _ in range(4000)])
    np.testing.assert_allclose(logs.mean(axis=1), 0.0, atol=1e-12)
    # 24,000 numbers, two thirds of them free: 0.6 % standard error
    assert logs.std() == pytest.approx(0.08, rel=0.03)


def test_a_specimen_has_further_effects_that_some_test_tells_apart():
    rng = np.random.default_rng(5)
    own = ("initial_shape", "prestrain", "rigid_motion")
    drawn = [families._further(own, number, rng) for number in (0, 1, 2) for _ in range(200)]
    assert [len({*more}) for more in drawn] == np.repeat([0, 1, 2], 200).tolist()
    every = {effect for more in drawn for effect in more}
    assert {"rim_lift", "clamp_slip", "registration", "dic_smoothing", "fixture_motion"} <= every
    # the cloth's own, what no test shows, and what a motion of the camera would be taken for
    assert every.isdisjoint({*own, "nonlinear_material", "creep", "pressure_gain", "poisson_ratio"})
    assert "reference_state" not in every


def test_law_is_that_of_a_strip_that_is_pulled():
    """A strip of the membrane, pulled along an axis and free to narrow, by its own energy."""
    law = {"nonlinear_material.k_x": 3.0, "nonlinear_material.k_y": 1.5}
    told = law_table(MODULI, law, 0.81)
    stiffness = orthotropic_stiffness(330.0, 200.0, 16.0, 0.24)
    gain = (3.0 * 330.0, 1.5 * 200.0)
    strip = Membrane(rectangle((0.0, 10.0), (0.0, 10.0), 2, 2), 0.81, fabric=Fabric(gain=gain))
    for side, axis in (("warp_N_per_mm", 0), ("fill_N_per_mm", 1)):
        for strain, resultant in zip(told["strain"], told[side], strict=True):
            # narrowing by nu12 along fill, by nu21 along warp, in logarithmic strain
            across = -strain * (0.24 if axis == 0 else 0.24 * 200.0 / 330.0)
            e = (strain, across) if axis == 0 else (across, strain)
            # ∂W/∂e by central differences of the energy per area of the whole
            step = 1e-5
            ahead, behind = (
                _energy(strip, stiffness, e, axis, side_step) for side_step in (step, -step)
            )
            assert (ahead - behind) / (2 * step) / 100.0 == pytest.approx(resultant, rel=1e-5)


def _energy(strip, stiffness, strains, axis, step):
    strains = np.array(strains)
    strains[axis] += step
    plane = strip.mesh.nodes * (np.exp(strains) - 1.0)
    moved = np.column_stack([plane, np.zeros(len(plane))])
    return strip.state(moved, 0.0, stiffness, tangent=False).potential
