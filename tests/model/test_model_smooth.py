"""Is the smooth field as fine as it claims to be between the nodes?"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bulgefit.fem.mesh import disc
from bulgefit.model.smooth import smooth_field, smooth_value

Floats = NDArray[np.float64]

POINTS = np.random.default_rng(5).uniform(-67.0, 67.0, (400, 2))


def bulge(place: Floats) -> Floats:
    """About what a disc of fabric does at 3 bar, mm."""
    x, y = place.T / 100.0
    inside = 1.0 - x * x - y * y
    return 40.0 * inside + 0.5 * x**4 * y - 0.7 * np.cos(3.0 * x + 2.0 * y) * inside


@pytest.mark.parametrize("refine", [1, 4])
def test_cubics_are_met(refine: int) -> None:
    nodes = disc(100.0, refine).nodes
    found = smooth_field(nodes, POINTS)
    (x, y), (u, v) = nodes.T / 100.0, POINTS.T / 100.0
    cubic = 3.0 + x - 2.0 * y + x * y - y * y + 0.5 * x**3 - x * x * y + 2.0 * y**3
    value = 3.0 + u - 2.0 * v + u * v - v * v + 0.5 * u**3 - u * u * v + 2.0 * v**3
    np.testing.assert_allclose(found.value @ cubic, value, atol=1e-8)
    by_x = (1.0 + v + 1.5 * u * u - 2.0 * u * v) / 100.0
    by_y = (-2.0 + u - 2.0 * v - u * u + 6.0 * v * v) / 100.0
    np.testing.assert_allclose(found.by_x @ cubic, by_x, atol=1e-8)
    np.testing.assert_allclose(found.by_y @ cubic, by_y, atol=1e-8)


def test_nodes_are_met() -> None:
    nodes = disc(100.0, 4).nodes
    np.testing.assert_allclose(
        smooth_field(nodes, nodes).value @ bulge(nodes), bulge(nodes), rtol=0.0, atol=1e-8
    )


def test_the_error_of_a_bulge_falls_with_the_fourth_power_of_the_cell() -> None:
    def error(refine: int) -> float:
        nodes = disc(100.0, refine).nodes
        miss = smooth_field(nodes, POINTS).value @ bulge(nodes) - bulge(POINTS)
        return float(np.sqrt(np.mean(miss**2)))

    errors = [error(refine) for refine in (3, 4, 6, 8)]
    slope, _ = np.polyfit(np.log([3, 4, 6, 8]), np.log(errors), 1)
    assert slope < -3.7
    assert errors[1] < 5e-5  # mm


def test_gradients_are_those_of_the_value() -> None:
    nodes, step = disc(100.0, 4).nodes, 1e-4
    field = bulge(nodes)
    found = smooth_field(nodes, POINTS)
    for gradient, move in ((found.by_x, [step, 0.0]), (found.by_y, [0.0, step])):
        up, down = (smooth_field(nodes, POINTS + s * np.array(move)).value for s in (1, -1))
        slope = (up - down) @ field / (2.0 * step)
        # where the nearest node changes within a step, the splines differ
        close = np.abs(gradient @ field - slope) < 1e-6
        assert close.mean() > 0.99


def test_a_value_has_the_same_bits_with_derivatives_and_without() -> None:
    """What was asked for before may not change what is predicted, nor what a journal goes on to."""
    nodes = disc(100.0, 4).nodes
    alone, beside = smooth_value(nodes, POINTS), smooth_field(nodes, POINTS).value
    np.testing.assert_array_equal(alone.toarray(), beside.toarray())
