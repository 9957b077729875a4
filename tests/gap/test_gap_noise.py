"""How noisy a test is: also where points are lost, and where the noise is correlated in space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.noise import estimate_noise, noise_of
from bulgefit.errors import InputError
from bulgefit.gap.bands import BANDS, excess_roughness
from bulgefit.gap.caveats import left_out
from bulgefit.gap.data import Data
from bulgefit.gap.prepare import (
    _usable_frames,
    drop_outliers,
    fix_units,
    prepare,
    renew_noise,
)
from bulgefit.gap.specimen import Specimen

SIGMA = np.array([0.006, 0.006, 0.015])
FRAMES = 8


@pytest.fixture
def points(grid: Callable[..., np.ndarray]) -> np.ndarray:
    return grid(6.0)


def dome(points: np.ndarray, frames: int = FRAMES) -> np.ndarray:
    """A smooth displacement (frames, n, 3) mm that grows."""
    x, y = points[:, :2].T / 100.0
    rise = np.cbrt(np.linspace(0.1, 2.5, frames))[:, None]
    return np.stack([0.5 * rise * x, 0.5 * rise * y, 20.0 * rise * (1 - x * x - y * y)], axis=-1)


def bulge_test(points: np.ndarray, displacement: np.ndarray, **more: object) -> BulgeTest:
    pressure = np.linspace(0.01, 0.25, len(displacement))
    return BulgeTest.from_arrays(points, displacement, pressure, **more)


def test_strays_are_looked_for_in_all_that_was_measured(points: np.ndarray) -> None:
    """What a poor model left out comes back by a better one; what is left out is told."""
    seen = dome(points) + np.random.default_rng(4).normal(size=(FRAMES, len(points), 3)) * SIGMA
    seen[3, 10, 2] += 5.0
    seen[5, 20] = np.nan
    prepared = prepare(bulge_test(points, seen))
    poor = dome(points)
    poor[6, 30, 2] += 5.0
    for modelled, strays in ((poor, 2), (dome(points), 1), (dome(points), 1)):
        drop_outliers(prepared, modelled)
        assert prepared.strays == strays
    used = np.ones(seen.shape, dtype=bool)
    used[[3, 5], [10, 20]] = False
    np.testing.assert_array_equal(prepared.data.used, used)
    (warning,) = left_out([prepared])
    assert warning.startswith("test: 1 of ")


@pytest.mark.parametrize("lost", [0.0, 0.1, 0.3])
def test_scattered_lost_points_do_not_change_the_noise(points: np.ndarray, lost: float) -> None:
    rng = np.random.default_rng(1)
    seen = dome(points) + rng.normal(size=(FRAMES, len(points), 3)) * SIGMA
    seen[rng.random(seen.shape[:2]) < lost] = np.nan
    noise = estimate_noise(bulge_test(points, seen))
    assert noise.source == "the field itself"
    np.testing.assert_allclose(noise.sigma, SIGMA, rtol=0.1)
    assert noise.inflation < 1.5


@pytest.mark.parametrize("lost_in", [0, 9])
def test_rough_frames_are_left_out_though_points_are_lost(points: np.ndarray, lost_in: int) -> None:
    """Three of ten frames deform in bands; a third of the points is lost in one frame."""
    rng = np.random.default_rng(2)
    seen = dome(points, 10) + rng.normal(size=(10, len(points), 3)) * SIGMA
    seen[7:, :, :2] += 0.2 * rng.normal(size=(3, len(points), 2))
    seen[lost_in, rng.random(len(points)) < 0.33] = np.nan
    test = bulge_test(points, seen)
    frames, rough_from = _usable_frames(test)
    # the frame before the first rough one may already begin to
    np.testing.assert_array_equal(frames, np.arange(6))
    assert rough_from == pytest.approx(10.0 * test.pressure[6])


@pytest.mark.parametrize("sigma", [0.0, 1e-4, 5e-3])
def test_what_a_surface_leaves_of_a_smooth_field_is_no_band(
    points: np.ndarray, sigma: float
) -> None:
    """It grows as the field does: without noise five times, from the first frame to the last."""
    x, y = points[:, :2].T / 100.0
    growth = np.linspace(0.1, 2.5, 12)[:, None] ** (2 / 3)
    seen = dome(points, 12)
    seen[..., 0] = growth * np.sin(3.0 * np.pi * x) * (1 - y * y)
    seen += sigma * np.random.default_rng(6).normal(size=seen.shape)
    frames, rough_from = _usable_frames(bulge_test(points, seen))
    assert rough_from is None
    np.testing.assert_array_equal(frames, np.arange(12))


def test_bands_that_grow_by_and_by_are_seen_where_they_have_outgrown_the_field(
    points: np.ndarray,
) -> None:
    rng = np.random.default_rng(8)
    seen = dome(points, 14) + SIGMA * rng.normal(size=(14, len(points), 3))
    grown = SIGMA.max() * 1.6 ** np.arange(6.0)
    seen[8:, :, :2] += grown[:, None, None] * rng.normal(size=(len(points), 2))
    frames, rough_from = _usable_frames(bulge_test(points, seen))
    assert rough_from is not None
    assert 7 <= len(frames) <= 10


@pytest.mark.parametrize("moved", ["turned", "shifted"])
def test_a_camera_that_has_moved_is_no_roughness(points: np.ndarray, moved: str) -> None:
    """By a degree, or by two millimetres, before the first frame."""
    seen = dome(points, 14) + SIGMA * np.random.default_rng(9).normal(size=(14, len(points), 3))
    where = points + seen
    if moved == "turned":
        c, s = np.cos(np.deg2rad(1.0)), np.sin(np.deg2rad(1.0))
        where = where @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    else:
        where[..., 0] += 2.0
    still, other = (excess_roughness(points[:, :2], d) for d in (seen, where - points))
    np.testing.assert_allclose(other, still, rtol=0.1)


def test_frames_in_which_nothing_moved_bound_no_other(points: np.ndarray) -> None:
    rng = np.random.default_rng(9)
    seen = dome(points, 10) + SIGMA * rng.normal(size=(10, len(points), 3))
    seen[:3] = 0.0
    assert excess_roughness(points[:, :2], seen)[3:].max() < BANDS


def correlated(points: np.ndarray, power: int) -> tuple[BulgeTest, float]:
    """A test with noise that is correlated over 10 mm, and what that does to a mean's variance."""
    rng = np.random.default_rng(3)
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    correlation = 0.36 * np.exp(-((distance / 10.0) ** power))
    root = np.linalg.cholesky(correlation + 0.64 * np.eye(len(points)))
    rest = np.einsum("nm,fmc->fnc", root, rng.normal(size=(12, len(points), 3))) * SIGMA
    inside = np.hypot(*points[:, :2].T) < 70.0
    exact = 1.0 + correlation[inside].sum(axis=1).mean() - 0.36
    return bulge_test(points, dome(points), static_displacement=rest), exact


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("jitter", [0.0, 0.25])
def test_inflation_is_that_of_a_mean_of_correlated_noise(
    grid: Callable[..., np.ndarray], jitter: float, power: int
) -> None:
    """Points that are scattered are as many to the area as those of a regular grid."""
    points = grid(4.6)
    rng = np.random.default_rng(3)
    points[:, :2] += rng.uniform(-jitter, jitter, (len(points), 2)) * 4.6
    test, exact = correlated(points, power)
    assert estimate_noise(test).inflation == pytest.approx(exact, rel=0.2)


def test_some_of_many_points_tell_the_inflation_of_all(
    grid: Callable[..., np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bulgefit.dic.noise.MOST_POINTS", 500)
    test, exact = correlated(grid(4.6), 2)
    found = noise_of(test)
    assert found is not None
    assert found.inflation == pytest.approx(exact, rel=0.25)


def test_what_comes_back_in_every_frame_counts_as_often_among_more_points(
    grid: Callable[..., np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is independent from point to point: it counts by the frames, however dense they lie."""
    points, frames = grid(4.6), 20
    rng = np.random.default_rng(7)
    fresh, same = (rng.normal(size=(n, len(points), 3)) * SIGMA for n in (frames, 1))
    test = bulge_test(points, dome(points, frames) + fresh + same)
    monkeypatch.setattr("bulgefit.dic.noise.MOST_POINTS", len(points) // 4)
    found = noise_of(test, fresh + same)
    assert found is not None
    assert found.persistent == pytest.approx(0.5, abs=0.1)
    assert found.inflation == pytest.approx(0.5 * frames + 0.5, rel=0.2)


def test_what_comes_back_in_every_frame_is_not_averaged_away(points: np.ndarray) -> None:
    """Half the variance is each frame's own, half is that of the points."""
    rng = np.random.default_rng(5)
    fresh, same = (rng.normal(size=(n, len(points), 3)) * SIGMA for n in (20, 1))
    test = bulge_test(points, dome(points, 20) + fresh + same)
    noise = estimate_noise(test, fresh + same)
    np.testing.assert_allclose(noise.sigma, np.sqrt(2.0) * SIGMA, rtol=0.1)
    assert noise.persistent == pytest.approx(0.5, abs=0.1)
    assert noise.inflation == pytest.approx(0.5 * 20 + 0.5, rel=0.2)


def test_means_over_frames_and_over_points_are_as_sure_as_they_are(points: np.ndarray) -> None:
    """Three tenths of the variance come back in every frame: in one frame they are noise as any."""
    rng, frames, persistent = np.random.default_rng(3), 20, 0.3
    same = np.sqrt(persistent) * rng.normal(size=(200, 1, len(points)))
    fresh = np.sqrt(1.0 - persistent) * rng.normal(size=(200, frames, len(points)))
    blank = bulge_test(points, dome(points, frames))
    data = Data(
        Specimen(blank), SIGMA, np.ones((frames, len(points), 3), dtype=bool),
        inflation=persistent * frames + 1.0 - persistent, persistent=persistent,
    )  # fmt: skip
    seen = same + fresh
    assert data.of_frames_mean(np.array([frames]))[0] == pytest.approx(
        seen.mean(axis=1).var(), rel=0.05
    )
    assert data.in_a_frame / len(points) == pytest.approx(seen.mean(axis=2).var(), rel=0.05)


def test_what_a_mesh_leaves_is_forgotten_where_it_is_not_known_any_more(
    points: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepared = prepare(bulge_test(points, dome(points)))
    specimen = prepared.data.specimen
    shapes = specimen.shapes({"E1": 300.0, "E2": 220.0, "G12": 20.0})
    fix_units(prepared, shapes)
    assert prepared.data.mesh is not None
    monkeypatch.setattr("bulgefit.gap.prepare.mesh_remainder", lambda *_: None)
    fix_units(prepared, shapes)
    assert prepared.data.mesh is None


def test_images_at_rest_that_lack_a_component_are_left_out(points: np.ndarray) -> None:
    rng = np.random.default_rng(4)
    rest = rng.normal(size=(4, len(points), 3)) * SIGMA
    rest[1, :, 2] = np.nan
    noise = estimate_noise(bulge_test(points, dome(points), static_displacement=rest))
    assert noise.source == "static images"
    np.testing.assert_allclose(noise.sigma, SIGMA, rtol=0.1)
    rest[..., 0] = np.nan
    seen = dome(points) + rng.normal(size=(FRAMES, len(points), 3)) * SIGMA
    noise = estimate_noise(bulge_test(points, seen, static_displacement=rest))
    assert noise.source == "the field itself"
    np.testing.assert_allclose(noise.sigma, SIGMA, rtol=0.1)


def test_a_component_that_was_never_measured_is_refused(points: np.ndarray) -> None:
    seen = dome(points)
    seen[..., :2] = np.nan
    with pytest.raises(InputError, match="dx, dy was never measured"):
        prepare(bulge_test(points, seen))


@pytest.mark.parametrize("squeeze", [(1.0, 0.0), (0.0, 0.0), (0.01, 1.0)])
def test_points_that_span_no_area_are_refused(
    points: np.ndarray, squeeze: tuple[float, float]
) -> None:
    turned = (points[:, :2] * squeeze) @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    points = np.column_stack([turned, points[:, 2]])
    with pytest.raises(InputError, match="the points lie in a line or at one place"):
        prepare(bulge_test(points, dome(points)))


def test_a_patch_of_points_is_a_field(points: np.ndarray) -> None:
    points = 0.1 * points
    assert prepare(bulge_test(points, dome(points))).data.used.all()


def test_a_field_without_noise_has_none(points: np.ndarray) -> None:
    noise = estimate_noise(
        bulge_test(points, dome(points), static_displacement=np.zeros((4, len(points), 3)))
    )
    assert noise.inflation == 1.0
    assert (noise.sigma < 1e-4).all()


def test_mixtures_count_as_what_was_recorded(points: np.ndarray) -> None:
    """Of 7 frames 16 are made: variances of means are those of 7, whatever points are left out.

    Straight in the root of pressure, which nothing undoes.
    """
    rng = np.random.default_rng(5)
    test = bulge_test(points, dome(points, 7) + rng.normal(size=(7, len(points), 3)) * SIGMA)
    common = np.linspace(test.pressure[0], test.pressure[-1], 16)
    flat = test.blocks[0].displacement.reshape(7, -1)
    root, roots = np.sqrt(common), np.sqrt(test.pressure)
    moved = np.stack([np.interp(root, roots, c) for c in flat.T], axis=1)
    mixed = bulge_test(points, moved.reshape(16, -1, 3))
    plain, other = prepare(test).data, prepare(mixed)
    assert plain.mixture == 1.0
    assert other.data.mixture == pytest.approx(16 / 7)
    assert other.data.inflation == pytest.approx(16 / 7 * other.noise.inflation)
    # of thinned points each counts as one, but frames as many as before
    thinned = other.data.thinned(3)
    assert thinned.mixture == other.data.mixture
    alone = 1.0 + (other.noise.inflation - 1.0) / 3
    assert thinned.inflation == pytest.approx(16 / 7 * alone)
    (warning,) = [w for w in left_out([other]) if "mixtures" in w]
    assert "its 16 frames are linear mixtures of 7" in warning


@pytest.mark.parametrize("persistent", [0.0, 0.5])
def test_noise_of_mixtures_is_that_of_what_was_recorded(
    points: np.ndarray, persistent: float
) -> None:
    """Of 12 frames 24 are made by a spline; half of the noise is there in every one of them."""
    rng = np.random.default_rng(6)
    fresh, same = (rng.normal(size=(n, len(points), 3)) * SIGMA for n in (12, 1))
    noise = np.sqrt(1.0 - persistent) * fresh + np.sqrt(persistent) * same
    test = bulge_test(points, dome(points, 12) + noise)
    root = np.cbrt(np.linspace(test.pressure[0], test.pressure[-1], 24))
    mixed = CubicSpline(np.cbrt(test.pressure), test.blocks[0].displacement)(root)
    prepared = prepare(bulge_test(points, mixed))
    assert prepared.data.mixture == 2.0
    clean = CubicSpline(np.cbrt(test.pressure), dome(points, 12))(root)
    renew_noise(prepared, clean)
    data, left = prepared.data, (mixed - clean) / SIGMA
    assert data.persistent == pytest.approx(persistent, abs=0.05)
    # each point and component has a mean over the frames
    truth = 24 * left.mean(axis=0).var() / left.var()
    assert data.inflation == pytest.approx(truth, rel=0.15)
    # of every third point as much, where nothing is correlated in space
    assert data.thinned(3).inflation == pytest.approx(truth, rel=0.15)
    assert data.in_space == pytest.approx(1.0, abs=0.3)
    # of every second frame what persists comes back half as often
    some = data.of_frames(np.arange(0, 24, 2))
    assert some.in_space == pytest.approx(data.in_space)
    assert some.inflation == pytest.approx(data.inflation - 12 * data.persistent)


def test_what_was_interpolated_straight_is_judged_by_what_was_recorded(points: np.ndarray) -> None:
    rng = np.random.default_rng(5)
    test = bulge_test(points, dome(points, 7) + rng.normal(size=(7, len(points), 3)) * SIGMA)
    common = np.linspace(test.pressure[0], test.pressure[-1], 18)
    flat = test.blocks[0].displacement.reshape(7, -1)
    moved = np.stack([np.interp(common, test.pressure, c) for c in flat.T], axis=1)
    mixed = BulgeTest.from_arrays(points, moved.reshape(18, -1, 3), common)
    prepared = prepare(mixed)
    assert prepared.interpolated == 18
    assert prepared.data.mixture == 1.0
    assert prepared.data.specimen.recorded == pytest.approx(test.pressure, rel=1e-6)
    (warning,) = [w for w in left_out([prepared]) if "interpolated" in w]
    assert "its 18 frames were interpolated straight in pressure" in warning


def test_mixtures_without_noise_have_none(points: np.ndarray) -> None:
    """Nor is any of it there in every frame."""
    seen = np.repeat(dome(points, 5), 2, axis=0)
    found = estimate_noise(bulge_test(points, seen), 0.0 * seen)
    assert (found.sigma < 1e-4).all()
    assert found.persistent == 0.0
