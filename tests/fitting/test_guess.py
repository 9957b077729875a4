"""Do the tests' own apex heights tell where moduli lie?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fitting.guess import bounds_from, implied_modulus, start_box
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup


def at_the_centre(
    radius: float,
    thickness: float,
    material: dict[str, float],
    highest: float = 0.2,
    *,
    x: float = 0.0,
) -> BulgeTest:
    """Heights of a centre, or so far beside it, up to a pressure (MPa), by the virtual test."""
    points = np.array([[x, 0.0, 0.0]])
    pressure = highest * np.array([0.1, 0.25, 0.5, 1.0])
    shape = {"radius": radius, "thickness": thickness}
    blank = BulgeTest.from_arrays(points, np.zeros((4, 1, 3)), pressure, **shape)
    seen = predict(blank, material, setup=Setup(refine=2)).displacement
    return BulgeTest.from_arrays(points, seen, pressure, **shape)


@pytest.mark.parametrize("modulus", [60.0, 250.0, 2000.0])
@pytest.mark.parametrize(("radius", "thickness"), [(100.0, 0.81), (25.0, 0.2)])
def test_the_cap_formula_is_right_within_a_third(
    modulus: float, radius: float, thickness: float
) -> None:
    test = at_the_centre(radius, thickness, {"E": modulus, "nu": 0.24}, 8e-4 * modulus)
    assert implied_modulus([test]) == pytest.approx(modulus, rel=1 / 3)


def test_of_warp_and_fill_it_is_between() -> None:
    test = at_the_centre(100.0, 0.81, {"E1": 400.0, "E2": 150.0, "G12": 15.0, "nu12": 0.24})
    found = implied_modulus([test])
    assert found is not None
    assert 150.0 < found < 400.0
    for name, value in (("E1", 400.0), ("E2", 150.0), ("G12", 15.0)):
        low, high = bounds_from([test])[name]
        first, last = start_box([test])[name]
        assert low < first < value < last < high


@pytest.mark.parametrize("x", [40.0, 60.0, 80.0, 90.0])
def test_a_centre_that_was_not_seen_is_told_by_what_is_nearest(x: float) -> None:
    material = {"E": 250.0, "nu": 0.24}
    seen = implied_modulus([at_the_centre(100.0, 0.81, material, x=x)])
    assert seen == pytest.approx(implied_modulus([at_the_centre(100.0, 0.81, material)]), rel=0.2)


def test_what_stands_at_the_clamp_implies_nothing() -> None:
    beside = at_the_centre(100.0, 0.81, {"E": 250.0, "nu": 0.24}, x=97.0)
    assert implied_modulus([beside]) is None


def test_without_a_rise_nothing_is_implied() -> None:
    flat = BulgeTest.from_arrays(np.zeros((1, 3)), np.zeros((2, 1, 3)), [0.1, 0.2])
    assert implied_modulus([flat]) is None
    assert bounds_from([flat]) == {}
