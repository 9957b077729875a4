"""Azimuthal modes of a residual that is known: which order, how large, how it grows."""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.gap.data import Data
from bulgefit.gap.normal import normal_equations
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.locate import Mode, azimuthal_modes
from bulgefit.gap.residual.structure import cells_of
from bulgefit.gap.specimen import Specimen
from bulgefit.model.sight import Prediction

BARS = np.linspace(0.1, 2.5, 12)
GROWTH = {
    "constant": np.ones_like(BARS),
    "p^(1/3)": np.cbrt(BARS),
    "growing": BARS,
    # falls to a sixth: a constant misses 15 % of its sum of squares
    "mixed": 1.2 - 0.4 * BARS,
}


def data_of(dz: np.ndarray, points: np.ndarray, ellipticity: float = 0.0) -> Data:
    """Of a test whose model is at rest: the displacement is the residual."""
    displacement = np.zeros((*dz.shape, 3))
    displacement[..., 2] = dz
    test = BulgeTest.from_arrays(points, displacement, BARS / 10, ellipticity=ellipticity)
    return Data(Specimen(test, refine=2), np.full(3, 0.01), np.ones(displacement.shape, dtype=bool))


def modes(
    dz: np.ndarray, points: np.ndarray, ellipticity: float = 0.0
) -> dict[tuple[str, int], Mode]:
    data = data_of(dz, points, ellipticity)
    shape = data.specimen.measured.shape
    at_rest = Prediction(np.zeros(shape), np.zeros((0, *shape)), None)
    normal = normal_equations([data], [at_rest], ())
    fit = Regression((), {}, normal, [at_rest], [None], converged=True, covariance=np.zeros((0, 0)))
    return {(m.component, m.order): m for m in azimuthal_modes([data], fit)}


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    side = np.arange(-95.0, 96.0, 5.0)
    x, y = (g.ravel() for g in np.meshgrid(side, side))
    inside = np.hypot(x, y) < 95.0
    return np.column_stack([x[inside], y[inside], np.zeros(inside.sum())])


@pytest.mark.parametrize("growth", GROWTH)
@pytest.mark.parametrize("order", [0, 1, 3])
def test_a_mode_and_how_it_grows(points: np.ndarray, growth: str, order: int) -> None:
    angle = np.arctan2(points[:, 1], points[:, 0])
    wave = 0.2 * np.cos(order * (angle - 0.4))
    found = modes(GROWTH[growth][:, None] * wave, points)
    mode = found["dz", order]
    assert mode.growth == growth
    size = 0.2 * np.abs(GROWTH[growth])
    np.testing.assert_allclose(np.abs(mode.amplitude), size, rtol=0.02, atol=1e-3)
    others = [m for (_, n), m in found.items() if n != order]
    assert {m.growth for m in others} == {"within noise"}


def test_in_an_ellipse_places_are_told_where_it_is_a_circle(points: np.ndarray) -> None:
    """What depends on the place in the circle alone is found as it is there."""
    order, ellipticity = 2, 0.3
    wave = 0.2 * np.cos(order * (np.arctan2(points[:, 1], points[:, 0]) - 0.4))
    # beyond 0.9 of the radius it is another one
    dz = np.where(np.hypot(*points[:, :2].T) < 91.0, wave, 5.0)[None] * np.ones((len(BARS), 1))
    stretched = points * [1.0 + ellipticity, 1.0 - ellipticity, 1.0]
    found = modes(dz, stretched, ellipticity)
    for name, mode in modes(dz, points).items():
        if name[0] == "dz":
            np.testing.assert_allclose(found[name].amplitude, mode.amplitude, atol=1e-12)
    residual = np.zeros((*dz.shape, 3))
    residual[..., 2] = dz
    told = [
        {(c.component, c.region, c.band): c.mean for c in cells_of(data_of(dz, *given), residual)}
        for given in ((points,), (stretched, ellipticity))
    ]
    assert told[0].keys() == told[1].keys()
    assert told[1] == pytest.approx(told[0])


def test_the_stated_error_is_that_of_the_amplitudes(points: np.ndarray) -> None:
    rng = np.random.default_rng(4)
    found = [modes(0.01 * rng.normal(size=(len(BARS), len(points))), points) for _ in range(40)]
    for order in (0, 2):
        several = [m["dz", order] for m in found]
        # along its own mean direction an amplitude is a little larger, by what that one fits
        spread = np.sqrt(np.mean([m.amplitude**2 for m in several]))
        assert spread == pytest.approx(several[0].noise, rel=0.1)
