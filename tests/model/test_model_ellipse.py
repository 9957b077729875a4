"""Does an elliptic clamp balance as an ellipse: strips, mirrored ones, oval discs, circles?"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from bulgefit.dic import BulgeTest
from bulgefit.model.opening import Opening
from bulgefit.model.virtual_test import VirtualTest
from bulgefit.model.window import Window

MODULI = {"E1": 300.0, "E2": 200.0, "G12": 40.0, "nu12": 0.0}
PRESSURE = np.array([0.025, 0.05])
POINTS = np.array([[0.0, 0, 0], [30, 10, 0], [-20, 35, 0], [45, -5, 0], [-10, -38, 0]])


def clamped(along_x, along_y, points=POINTS) -> VirtualTest:
    test = BulgeTest.from_arrays(
        points,
        np.zeros((len(PRESSURE), len(points), 3)),
        PRESSURE,
        radius=(along_x + along_y) / 2,
        thickness=0.8,
        ellipticity=(along_x - along_y) / (along_x + along_y),
        poisson_ratio=0.0,
    )
    return VirtualTest(test)


def strip_height(pressure: float, half: float, modulus: float, thickness: float) -> float:
    """A long strip is a circular cylinder: p R = N, with N = E t ln(l)/l for an energy in ln(l)."""

    def unbalanced(radius):
        stretch = radius * np.arcsin(half / radius) / half
        return pressure * radius - thickness * modulus * np.log(stretch) / stretch

    radius = brentq(unbalanced, 1.0001 * half, 200 * half)
    return radius - np.sqrt(radius**2 - half**2)


def test_a_long_ellipse_is_a_strip_at_its_centre():
    """What is off falls with the ratio of the semi-axes, faster than its square."""
    truth = np.array([strip_height(p, 50, 300, 0.8) for p in PRESSURE])
    even = {**MODULI, "E2": 300.0}
    off = {}
    for ratio in (2, 4):
        found = clamped(50 * ratio, 50).predict(even).displacement[:, 0, 2]
        off[ratio] = 1 - found / truth
    assert (off[4] > 0).all()
    assert off[4].max() < 2.5e-3
    assert (off[4] < off[2] / 8).all()


def test_an_ellipse_turned_by_a_right_angle_is_the_same():
    turned = clamped(50, 80, POINTS[:, [1, 0, 2]])
    swapped = {**MODULI, "E1": MODULI["E2"], "E2": MODULI["E1"]}
    there = turned.predict(swapped).displacement[..., [1, 0, 2]]
    np.testing.assert_allclose(clamped(80, 50).predict(MODULI).displacement, there, atol=2e-5)


def test_an_oval_disc_is_an_ellipse():
    """The effect bends a disc's mesh, the clamp has its own: nodes lie and balance alike."""
    oval = {**MODULI, "clamp_shape.ellipticity": 0.03}
    bent = clamped(60, 60).shapes(oval).displacement
    np.testing.assert_allclose(clamped(61.8, 58.2).shapes(MODULI).displacement, bent, atol=1e-6)
    # and effects act on top: here they make a circle of it, but for their product
    both = {**MODULI, "clamp_shape.ellipticity": -0.03, "clamp_shape.radius_error": 1 / 0.9991 - 1}
    back = clamped(61.8, 58.2)
    oblong = (1.03 * 0.97) / 0.9991, (0.97 * 1.03) / 0.9991
    assert oblong == pytest.approx((1, 1))
    found = back.predict(both).displacement
    np.testing.assert_allclose(found, clamped(60, 60).predict(MODULI).displacement, atol=2e-3)


@pytest.mark.parametrize("name", ["clamp_shape.ellipticity", "registration.x0", "E2"])
def test_derivatives_on_an_ellipse(name):
    virtual = clamped(80, 50)
    here = {**MODULI, "clamp_shape.ellipticity": 0.01, "registration.x0": 1.0}
    rate = virtual.predict(here, [name]).derivative[0]
    step = {"E2": 1.0}.get(name, 1e-3 if "clamp" in name else 0.05)
    ends = [
        virtual.predict({**here, name: here[name] + side * step}).displacement for side in (1, -1)
    ]
    difference = (ends[0] - ends[1]) / (2 * step)
    assert np.abs(rate - difference).max() < 1e-3 * np.abs(difference).max()


def test_a_window_sees_what_the_ellipse_leaves_of_it():
    """The mean of x² and of y over disc and ellipse, as a fine grid of points has it."""
    virtual = clamped(80, 50)
    nodes, (a, b) = virtual.mesh.nodes, virtual.test.semi_axes
    window_of = Window(virtual.circle.nodes, virtual.test.radius)
    window, angle = 8.0, np.array([0.1, 0.8, 1.5, 2.5, 4.0, 5.5])
    points = 0.96 * np.stack([a * np.cos(angle), b * np.sin(angle)], axis=1)
    points = np.concatenate([points, [[5.0, -3.0]]])
    mean = window_of.value(points / (a, b), window, Opening(virtual.test.semi_axes))
    ticks = np.linspace(-window, window, 801)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= window]
    for field in (lambda p: p[:, 0] ** 2, lambda p: p[:, 1]):
        expected = []
        for point in points:
            seen = point + grid
            inside = (seen[:, 0] / a) ** 2 + (seen[:, 1] / b) ** 2 <= 1
            expected.append(field(seen[inside]).mean())
        found = mean @ field(nodes)
        # the rim's osculating circle leaves it by the cube of the window
        scale = np.abs(field(nodes)).max()
        np.testing.assert_allclose(found, expected, atol=4e-4 * scale)
