"""Is the window's mean the mean over a disc?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.fem.mesh import disc
from bulgefit.model.smooth import smooth_field
from bulgefit.model.window import Window

MESH = disc(100.0, 4)
POINTS = np.random.default_rng(3).uniform(-60.0, 60.0, (200, 2))


@pytest.fixture(scope="module")
def window() -> Window:
    return Window(MESH.nodes, 100.0)


@pytest.mark.parametrize("width", [2.0, 5.0, 12.0])
def test_of_a_paraboloid_inside_the_rim(window: Window, width: float) -> None:
    """The mean of x² + y² over a disc of radius w is r² + w²/2."""
    x, y = MESH.nodes.T
    operator = window.mean(POINTS, width)
    rise = operator.value @ (x**2 + y**2) - (POINTS**2).sum(axis=1)
    np.testing.assert_allclose(rise, width**2 / 2, rtol=1e-6)
    np.testing.assert_allclose(operator.by_x @ (x**2 + y**2), 2 * POINTS[:, 0], atol=1e-7)
    np.testing.assert_allclose(operator.by_y @ (x * y), POINTS[:, 0], atol=1e-7)


def test_beyond_the_rim_nothing_is_seen(window: Window) -> None:
    """A window across the rim averages the part inside: its mean place lies further in."""
    x, _ = MESH.nodes.T
    rim = np.array([[99.0, 0.0]])
    assert (window.mean(rim, 10.0).value @ x)[0] < 96.0


def test_a_vanishing_window_is_the_smooth_field(window: Window) -> None:
    """Half a micrometre (rms) of a field of 40 mm; splines on other neighbours differ by more."""
    x, y = MESH.nodes.T
    wavy = 40.0 * np.cos(np.hypot(x, y) / 60.0) + np.sin(x / 15.0)
    point = smooth_field(MESH.nodes, POINTS).value @ wavy
    miss = window.mean(POINTS, 1e-6).value @ wavy - point
    assert np.sqrt(np.mean(miss**2)) < 5e-4


def test_the_value_alone_is_that_of_the_mean(window: Window) -> None:
    points = POINTS * 1.5  # some of them beside the rim
    assert abs(window.value(points, 12.0) - window.mean(points, 12.0).value).max() == 0.0


@pytest.mark.parametrize(("distance", "width"), [(95.0, 8.0), (99.0, 12.0), (91.0, 9.5)])
def test_of_what_the_rim_leaves(window: Window, distance: float, width: float) -> None:
    """Against a count over a fine grid of places inside both circles."""
    point = distance * np.array([[0.6, 0.8]])
    side = width * (np.arange(1200) + 0.5 - 600) / 600
    u, v = (g.ravel() for g in np.meshgrid(side, side))
    places = point + np.column_stack([u, v])[np.hypot(u, v) < width]
    places = places[np.hypot(*places.T) < 100.0]
    x, y = MESH.nodes.T
    operator = window.mean(point, width).value
    assert operator @ x == pytest.approx(places[:, 0].mean(), abs=2e-3)
    assert operator @ (x * y) == pytest.approx(places.prod(axis=1).mean(), abs=0.2)
