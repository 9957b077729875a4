"""Is the window's mean the mean over a disc?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.effects.registry import effect_named
from bulgefit.errors import InputError
from bulgefit.fem.mesh import disc
from bulgefit.model.opening import Opening
from bulgefit.model.smooth import smooth_field
from bulgefit.model.window import Window

MESH = disc(100.0, 4)
CIRCLE = Opening(np.array([100.0, 100.0]))
POINTS = np.random.default_rng(3).uniform(-60.0, 60.0, (200, 2))


@pytest.fixture(scope="module")
def window() -> Window:
    return Window(MESH.nodes, 100.0)


@pytest.mark.parametrize("width", [2.0, 5.0, 12.0])
def test_of_a_paraboloid_inside_the_rim(window: Window, width: float) -> None:
    """The mean of x² + y² over a disc of radius w is r² + w²/2."""
    x, y = MESH.nodes.T
    operator = window.value(POINTS / 100.0, width, CIRCLE)
    rise = operator @ (x**2 + y**2) - (POINTS**2).sum(axis=1)
    np.testing.assert_allclose(rise, width**2 / 2, rtol=1e-6)
    np.testing.assert_allclose(operator @ (x * y), POINTS.prod(axis=1), atol=1e-6)


def test_beyond_the_rim_nothing_is_seen(window: Window) -> None:
    """A window across the rim averages the part inside: its mean place lies further in."""
    x, _ = MESH.nodes.T
    rim = np.array([[99.0, 0.0]])
    assert (window.value(rim / 100.0, 10.0, CIRCLE) @ x)[0] < 96.0


def test_a_vanishing_window_is_the_smooth_field(window: Window) -> None:
    """Half a micrometre (rms) of a field of 40 mm; splines on other neighbours differ by more."""
    x, y = MESH.nodes.T
    wavy = 40.0 * np.cos(np.hypot(x, y) / 60.0) + np.sin(x / 15.0)
    point = smooth_field(MESH.nodes, POINTS).value @ wavy
    miss = window.value(POINTS / 100.0, 1e-6, CIRCLE) @ wavy - point
    assert np.sqrt(np.mean(miss**2)) < 5e-4


@pytest.mark.parametrize(("distance", "width"), [(95.0, 8.0), (99.0, 12.0), (91.0, 9.5)])
def test_of_what_the_rim_leaves(window: Window, distance: float, width: float) -> None:
    """Against a count over a fine grid of places inside both circles."""
    point = distance * np.array([[0.6, 0.8]])
    side = width * (np.arange(1200) + 0.5 - 600) / 600
    u, v = (g.ravel() for g in np.meshgrid(side, side))
    places = point + np.column_stack([u, v])[np.hypot(u, v) < width]
    places = places[np.hypot(*places.T) < 100.0]
    x, y = MESH.nodes.T
    operator = window.value(point / 100.0, width, CIRCLE)
    assert operator @ x == pytest.approx(places[:, 0].mean(), abs=2e-3)
    assert operator @ (x * y) == pytest.approx(places.prod(axis=1).mean(), abs=0.2)


def test_of_a_window_that_comes_to_touch_the_rim(window: Window) -> None:
    """What its mean leaps by there is little of what it does, so that differences by it hold."""
    x, _ = MESH.nodes.T
    point = np.array([[91.0, 0.0]])
    below, above = (
        window.value(point / 100.0, width, CIRCLE) @ np.stack([x**2, x**4], axis=1)
        for width in (9.0 - 1e-8, 9.0 + 1e-8)
    )
    leap = np.abs(above - below)[0] / (below[0] - [91.0**2, 91.0**4])
    assert leap[0] < 1e-5
    assert leap[1] < 1e-4


@pytest.mark.parametrize("size", [0.25, 1.5])
def test_a_rim_that_is_bent_too_far_is_refused(size: float) -> None:
    """Corrections that shrink slowly, or grow, tell no places."""
    lobes = {"c3": size, "s3": 0.0}
    opening = Opening(np.array([100.0, 100.0]), [(effect_named("clamp_lobes"), lobes)])
    places = 90.0 * np.stack([np.cos(np.arange(9.0)), np.sin(np.arange(9.0))], axis=1)
    with pytest.raises(InputError, match="the rim is bent too far by clamp_lobes"):
        opening.unit(places)


@pytest.mark.parametrize("place", [(12.0, -30.0), (70.0, 55.0), (-66.0, 68.0), (-91.5, 1.0)])
def test_a_disc_on_the_fabric_whatever_the_rim_is(window: Window, place: tuple) -> None:
    """Of an opening with lobes: against a count over a fine grid of places inside it."""
    lobes = (effect_named("clamp_lobes"), {"c3": 0.012, "s3": 0.012})
    opening = Opening(np.array([104.0, 97.0]), [lobes])
    unit = opening.unit(np.array([place]))
    np.testing.assert_allclose(opening.fabric(unit)[0], place, atol=1e-12)
    side = 11.0 * (np.arange(1200) + 0.5 - 600) / 600
    seen = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    seen = place + seen[np.hypot(*seen.T) < 11.0]
    seen = seen[np.hypot(*opening.unit(seen).T) < 1.0]
    x, y = opening.fabric(MESH.nodes / 100.0).T
    operator = window.value(unit, 11.0, opening)
    assert operator @ x == pytest.approx(seen[:, 0].mean(), abs=3e-3)
    assert operator @ (x * y) == pytest.approx(seen.prod(axis=1).mean(), abs=0.3)


def test_the_rim_beside_a_place_is_its_osculating_circle() -> None:
    """At the ends of an ellipse's axes: radii of b²/a and a²/b."""
    opening = Opening(np.array([110.0, 90.0]))
    distance, radius, out = opening.rim_circles(np.array([[100.0, 0.0], [0.0, -85.0]]))
    np.testing.assert_allclose(radius, [90.0**2 / 110.0, 110.0**2 / 90.0], rtol=2e-4)
    np.testing.assert_allclose(radius - distance, [10.0, 5.0], rtol=1e-9)
    np.testing.assert_allclose(out, [[1.0, 0.0], [0.0, -1.0]], atol=1e-12)
