"""Does the face of a cloth move as a sheet of some thickness has it?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.model.face import Face
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

ABOVE = 0.4


def twin(refine: int) -> VirtualTest:
    """A disc of 100 mm, whose points do not matter."""
    points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]])
    blank = np.zeros((1, 3, 3))
    return VirtualTest(BulgeTest.from_arrays(points, blank, np.array([0.1])), Setup(refine=refine))


def of(virtual: VirtualTest, height: NDArray[np.float64], above: float = ABOVE) -> Face:
    """A face above nodes at heights (n,) mm."""
    return Face(virtual.gradients, np.column_stack([virtual.mesh.nodes, height]), above)


def on_sphere(nodes: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Places (n, 3) mm of a flat disc that is laid over a sphere, and stretched by the way."""
    far = 1.05 * np.hypot(*nodes.T) / radius
    out = nodes / np.maximum(np.hypot(*nodes.T), 1e-300)[:, None] * np.sin(far)[:, None]
    return radius * np.column_stack([out, np.cos(far) - 1.0])


def test_a_flat_cloth_that_is_blown_to_a_sphere() -> None:
    """Its face lies on a sphere with the same centre, whose radius is larger by its height."""
    radius, misses = 120.0, []
    for refine in (1, 2):
        virtual = twin(refine)
        nodes = virtual.mesh.nodes
        there, flat = on_sphere(nodes, radius), np.column_stack([nodes, np.zeros(len(nodes))])
        found = of(virtual, flat[:, 2]).seen((there - flat)[None])[0]
        centre = np.array([0.0, 0.0, -radius])
        larger = there + ABOVE * (there - centre) / radius
        misses.append(np.abs(found - (larger - flat - [0.0, 0.0, ABOVE])).max())
        # beyond its middle it is stretched by its height times the curvature
        stretched = np.hypot(*(flat + found)[:, :2].T) / np.maximum(
            np.hypot(*there[:, :2].T), 1e-300
        )
        off_centre = np.hypot(*nodes.T) > 1.0
        np.testing.assert_allclose(stretched[off_centre], 1.0 + ABOVE / radius, atol=1e-4)
    assert misses[0] < 1e-3
    assert misses[1] < misses[0] / 4.0


def test_a_dome_that_turns_as_a_whole() -> None:
    """Its face turns about the same axis, from where it stood; what is left is of second order."""
    virtual = twin(2)
    nodes = virtual.mesh.nodes
    height = 8.0 * (1.0 - (nodes**2).sum(axis=1) / 1e4) + 0.02 * nodes[:, 0]
    rest = np.column_stack([nodes, height])
    turn = Rotation.from_rotvec([20.0, -30.0, 10.0], degrees=True)
    moved = (turn.apply(rest) - rest)[None]
    slope = np.column_stack([-0.0016 * nodes[:, 0] + 0.02, -0.0016 * nodes[:, 1]])
    size = np.sqrt(1.0 + (slope**2).sum(axis=1))
    misses = []
    for above in (0.8, 0.4):
        # the place of the face that is seen where the node was, and the middle's below it
        below = nodes + above * slope / size[:, None]
        high = 8.0 * (1.0 - (below**2).sum(axis=1) / 1e4) + 0.02 * below[:, 0]
        stands = np.column_stack([nodes, high + above / size])
        exact = turn.apply(stands) - stands
        found = of(virtual, height, above).seen(moved)[0]
        inside = np.hypot(*nodes.T) < 95.0
        misses.append(np.abs(found - exact)[inside].max())
        assert misses[-1] < 0.05 * np.abs(moved[0] - exact)[inside].max()
    assert misses[1] == pytest.approx(misses[0] / 4.0, rel=0.2)


@pytest.mark.parametrize("high", [0.0, 3.0])
def test_slope_is_that_of_differences(high: float) -> None:
    virtual, rng = twin(1), np.random.default_rng(4)
    nodes = virtual.mesh.nodes
    face = of(virtual, high * np.cos(nodes[:, 0] / 50.0))
    flat = np.column_stack([nodes, np.zeros(len(nodes))])
    moved = np.stack([on_sphere(nodes, radius) - flat for radius in (90.0, 300.0)])
    change, of_rest = rng.normal(size=moved.shape), rng.normal(size=flat.shape)
    step = 1e-4
    for rest in (None, of_rest):
        ends = []
        for side in (step, -step):
            there = face if rest is None else replace(face, rest=face.rest + side * rest)
            ends.append(there.seen(moved + side * change))
        difference = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(face.slope(moved)(change, rest), difference, atol=1e-8)


def test_of_no_height_it_is_the_middle() -> None:
    virtual = twin(1)
    nodes = virtual.mesh.nodes
    moved = on_sphere(nodes, 100.0)[None]
    np.testing.assert_array_equal(of(virtual, 0.1 * nodes[:, 0], 0.0).seen(moved), moved)
