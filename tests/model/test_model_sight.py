"""Sums of derivatives over points: are they those of the derivatives at every point?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

FRAMES, POINTS = 3, 40
MODULI = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
NAMES = ("E1", "G12", "pressure_offset.offset", "dic_scale.scale", "registration.x0")


def measured() -> BulgeTest:
    """Where the cameras look; what they saw is no matter here."""
    rng = np.random.default_rng(1)
    radius, angle = 95 * np.sqrt(rng.random(POINTS)), 2 * np.pi * rng.random(POINTS)
    where = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(POINTS)])
    return BulgeTest.from_arrays(where, np.zeros((FRAMES, POINTS, 3)), [0.05, 0.1, 0.2])


@pytest.mark.parametrize(
    ("evaluation", "names", "effects"),
    [
        ("smooth", NAMES, {}),
        ("rbf", ("E1", "G12"), {}),
        ("smooth", NAMES, {"fixture_motion.rotation_x": 0.1, "lens_distortion.k1": 0.01}),
        ("smooth", ("E2", "dic_smoothing.window"), {"dic_smoothing.window": 6.0}),
    ],
)
def test_sums_over_groups_of_points(
    evaluation: str, names: tuple[str, ...], effects: dict[str, float]
) -> None:
    virtual = VirtualTest(measured(), Setup(refine=2, evaluation=evaluation, correct_mesh=False))
    shapes = virtual.shapes({**MODULI, **effects}, names)
    some = np.arange(3, 33)
    sight = virtual.sight(shapes, names, points=some)
    rng = np.random.default_rng(2)
    pull = rng.normal(size=(FRAMES, len(some), 3))
    group = rng.permutation(np.arange(len(some)) % 4)
    by_point = np.einsum("pkmc,kmc->pmk", virtual.observe(shapes, names, 0, some).derivative, pull)
    wanted = np.stack([by_point[:, group == g].sum(axis=1) for g in range(4)], axis=1)
    size = np.abs(by_point).sum(axis=(1, 2))[:, None, None]
    assert size.min() > 0.0
    np.testing.assert_allclose(sight.gathered(pull, group) / size, wanted / size, atol=1e-12)
    alone = sight.gathered(pull)[:, 0]
    np.testing.assert_allclose(alone / size[:, 0], wanted.sum(axis=1) / size[:, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("window", "share", "tolerance"),
    [(0.3, 0.5, 2e-2), (1.5, 1e-2, 1e-3), (6.0, 3e-3, 1e-3)],
    ids=["narrow", "by which 8 mm² reach down to none", "touching the rim"],
)
def test_derivative_by_the_square_of_a_window(
    window: float, share: float, tolerance: float
) -> None:
    """Also of so small a window that a wide difference would compare it with none at all.

    By a difference over 8 mm² these were off by 21, 12 and 6 %. A narrow window has points about
    the kinks of the grid's interpolation, of which two spans tell 1 % apart.
    """
    virtual = VirtualTest(measured(), Setup(refine=2, correct_mesh=False))
    name = "dic_smoothing.window"
    shapes = virtual.shapes({**MODULI, name: window}, (name,))
    (found,) = virtual.observe(shapes, (name,), 0, slice(None)).derivative
    squares = [window**2 * (1.0 - share), window**2 * (1.0 + share)]
    below, above = (
        virtual.observe(
            virtual.shapes({**MODULI, name: float(np.sqrt(square))}), (), 0, slice(None)
        ).displacement
        for square in squares
    )
    expected = (above - below) / (squares[1] - squares[0])
    assert np.linalg.norm(found - expected) < tolerance * np.linalg.norm(expected)
