"""Does a warp that was mounted at an angle mean what turned axes mean?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.model.setup import Setup
from bulgefit.model.simulation import simulate
from bulgefit.model.virtual_test import VirtualTest

VALUES = {"E1": 320.0, "E2": 200.0, "G12": 12.0}
NAMES = ["E1", "E2", "G12", "nu12"]


@pytest.fixture
def test() -> BulgeTest:
    rng = np.random.default_rng(0)
    radius, angle = 95 * np.sqrt(rng.random(60)), 2 * np.pi * rng.random(60)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(60)])
    return BulgeTest.from_arrays(points, np.zeros((6, 60, 3)), np.linspace(0.01, 0.25, 6))


@pytest.mark.parametrize("interpolation", ["dense", "none"])
def test_by_a_right_angle_all_turns(test: BulgeTest, interpolation: str) -> None:
    """To what the stencils of a field's evaluation tell apart."""
    setup = Setup(interpolation=interpolation)
    here = VirtualTest(test, setup).predict(VALUES, NAMES)
    turned = replace(test.rotated(90), warp_angle=90.0)
    there = VirtualTest(turned, setup).predict(VALUES, NAMES)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(there.displacement, here.displacement @ turn.T, atol=5e-5)
    scale = np.abs(here.derivative).max(axis=(1, 2, 3), keepdims=True)
    np.testing.assert_allclose(
        there.derivative / scale, here.derivative @ turn.T / scale, atol=1e-4
    )


@pytest.mark.parametrize("angle", [30.0, 90.0])
def test_effects_turn_it_further(test: BulgeTest, angle: float) -> None:
    misaligned = {**VALUES, "axis_misalignment.angle": angle}
    expected = VirtualTest(test).predict(misaligned).displacement
    told = replace(test, warp_angle=angle)
    np.testing.assert_array_equal(VirtualTest(told).predict(VALUES).displacement, expected)
    back = VirtualTest(replace(test, warp_angle=angle + 7.0))
    found = back.predict({**VALUES, "axis_misalignment.angle": -7.0}).displacement
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_simulation_by_a_right_angle_is_of_a_quarter() -> None:
    """It is found by as little work, and a half turn is none."""
    material = {**VALUES, "nu12": 0.24}
    made = {
        angle: simulate(material, 0.2, angle=angle, correct_mesh=False)
        for angle in (0.0, 90.0, 180.0)
    }
    nodes = made[0.0].membrane.mesh.nodes
    image = KDTree(nodes).query(nodes @ [[0.0, 1.0], [-1.0, 0.0]])[1]
    height = made[0.0].displacement[0, :, 2]
    assert np.abs(height[image] - height).max() > 0.1
    np.testing.assert_allclose(made[90.0].displacement[0, image, 2], height, atol=1e-8)
    np.testing.assert_allclose(made[180.0].displacement, made[0.0].displacement, atol=1e-8)
    assert len({found.factorisations for found in made.values()}) == 1
