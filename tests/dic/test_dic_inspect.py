"""Does the summary of a test count right, and say what looks wrong?"""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from bulgefit.dic import BulgeTest, describe
from bulgefit.dic.coverage import coverage
from bulgefit.dic.outliers import stray_points


def warned(made, text, **options):
    test = BulgeTest.from_arrays(made.reference, made.displacement, made.pressure, **options)
    found = [item for item in describe(test).warnings if text in item.text]
    assert len(found) == 1, describe(test).warnings
    assert found[0].code
    assert found[0].remedy
    return found[0].text


def test_a_good_test_is_described_without_warnings(made_test, made):
    info = describe(made_test)
    assert info.warnings == ()
    assert info.n_points == len(made.reference)
    assert info.points_per_frame == (info.n_points,) * 6
    assert info.n_lost == 0
    assert info.reference_range[0] == (-96.0, 96.0)
    assert info.displacement_range[2] == (
        made.displacement[..., 2].min(),
        made.displacement[..., 2].max(),
    )
    assert info.pressure_bar == pytest.approx(tuple(made.pressure * 10))
    assert info.apex_mm[-1] == pytest.approx(60 * 0.3 ** (1 / 3), abs=0.05)
    assert info.coverage > 0.93
    assert info.duration_s == 10.0
    assert info.n_static == 3
    assert info.static_noise_mm == pytest.approx((0.01, 0.01, 0.01), rel=0.1)
    json.dumps(dataclasses.asdict(info), allow_nan=False)


def test_coverage_of_a_half_and_of_a_quadrant():
    rng = np.random.default_rng(0)
    points = rng.uniform(-100, 100, (40_000, 3))
    points = points[np.hypot(*points[:, :2].T) < 100]
    assert coverage(points, 100.0) == (pytest.approx(1, abs=0.005), pytest.approx((1,) * 4, 0.01))
    half, quadrants = coverage(points[points[:, 1] > 0], 100.0)
    assert half == pytest.approx(0.5, abs=0.005)
    assert quadrants == pytest.approx((1, 1, 0, 0), abs=0.01)
    whole, quadrants = coverage(points[(points[:, 0] > 0) & (points[:, 1] < 0)], 100.0)
    assert whole == pytest.approx(0.25, abs=0.005)
    assert quadrants == pytest.approx((0, 0, 0, 1), abs=0.01)


def test_pressure_that_falls(made):
    made.pressure[3] = made.pressure[1]
    assert "frame 3" in warned(made, "pressure does not increase")


@pytest.mark.parametrize("factor", [1e-3, 10])
def test_pressure_of_an_unlikely_size(made, factor):
    made.pressure *= factor
    assert "are the pressures in the unit" in warned(made, "highest pressure")


def test_few_frames(made):
    made.displacement, made.pressure = made.displacement[-2:], made.pressure[-2:]
    warned(made, "only 2 frames")


def test_time_that_falls(made):
    warned(made, "time does not increase at frame 2", time=[0, 2, 1, 3, 4, 5])


def test_lost_points_and_components(made):
    made.displacement[4, :200] = np.nan
    assert "frame 4" in warned(made, "of the points are lost")
    made.displacement[..., 1] = np.nan
    warned(made, "dy was never measured")
    made.displacement[:, :100, 0] = np.nan
    warned(made, "dx is missing at")
    made.displacement[0] = np.nan
    warned(made, "1 frames without any measured point, first frame 0")


def test_points_only_near_the_centre(made):
    made.reference[:, :2] *= 0.3
    warned(made, "points only near the centre: the farthest is at")


def test_a_hole_on_one_side(made):
    hole = (made.reference[:, 0] > 10) & (made.reference[:, 1] > 10)
    made.displacement[:, hole] = np.nan
    warned(made, "coverage is uneven")


def test_reference_z(made):
    z = made.reference[:, 2].copy()
    made.reference[:, 2] = 0
    warned(made, "reference z was not kept")
    made.reference[:, 2] = z + 3 * (1 - np.hypot(*made.reference[:, :2].T) / 100)
    warned(made, "reference is not flat")
    made.reference[:, 2] = z + 500
    warned(made, "reference z is 500 mm on average")
    made.reference[:, 2] = z + 0.01 * made.reference[:, 0]  # a tilt is no shape
    leans = BulgeTest.from_arrays(made.reference, made.displacement, made.pressure)
    assert [one.code for one in describe(leans).warnings] == ["reference_tilted"]


def test_apex_that_does_not_grow(made):
    made.displacement[[2, 3]] = made.displacement[[3, 2]]
    assert "first from frame 2 to 3" in warned(made, "the apex does not grow")


@pytest.mark.parametrize("factor", [1e-3, 0.0])
def test_displacement_too_small_for_the_pressure(made, factor):
    made.displacement *= factor
    assert "is the displacement in mm?" in warned(made, "the stiffest material would rise by 2.")


def test_displacement_that_does_not_change(made):
    made.displacement[:] = made.displacement[-1]
    warned(made, "does not change with pressure")


def test_points_at_the_rim_may_hardly_rise(made):
    rim = np.hypot(*made.reference[:, :2].T) > 90
    made.reference, made.displacement = made.reference[rim], made.displacement[:, rim]
    made.displacement[..., 2] = 0.6 * np.linspace(0.5, 1, 6)[:, None]
    test = BulgeTest.from_arrays(made.reference, made.displacement, made.pressure)
    assert not any("the apex" in item.text for item in describe(test).warnings)


def test_z_the_wrong_way(made):
    made.displacement[..., 2] *= -1
    warned(made, "moves to -z")


def test_displacement_at_rest(made):
    static = np.full((2, *made.reference.shape), 0.3)
    warned(made, "images at rest are displaced", static_displacement=static)
    made.pressure[0] = 0.0
    warned(made, "at rest (frame 0) the apex already stands at")


def test_images_at_rest_without_a_component(made):
    static = np.zeros((2, *made.reference.shape))
    static[..., 0] = np.nan
    warned(made, "dx was never measured in the images at rest", static_displacement=static)


def test_motion_of_the_camera(made):
    made.displacement[..., 0] += 0.5
    assert "(0.50, " in warned(made, "symmetry gives 0")


def test_stray_points_are_found_one_by_one(made):
    rng = np.random.default_rng(5)
    hit = rng.choice(len(made.reference), 6, replace=False)
    displacement = made.displacement[-1].copy()
    assert not stray_points(made.reference, displacement, 100.0).any()
    displacement[hit, [0, 1, 2, 0, 1, 2]] += 3.0
    assert np.flatnonzero(stray_points(made.reference, displacement, 100.0)).tolist() == sorted(hit)
    made.displacement[-1] = displacement
    assert "most in frame 5 (6)" in warned(made, "6 stray displacements")


def test_stray_points_beside_lost_ones(made):
    displacement = made.displacement[-1].copy()
    displacement[::7] = np.nan
    displacement[10, 2] += 5.0
    found = stray_points(made.reference, displacement, 100.0)
    assert np.flatnonzero(found).tolist() == [10]


def test_too_few_points_for_neighbours(made):
    assert not stray_points(made.reference[:50], 100 * made.displacement[-1, :50], 100.0).any()


def test_one_point():
    test = BulgeTest.from_arrays(
        [[0.1, 0, 0]], [[[np.nan, np.nan, w]] for w in range(1, 8)], np.linspace(0.1, 0.3, 7)
    )
    info = describe(test)
    assert info.displacement_range[0] is None
    codes = [item.code for item in info.warnings]
    assert "one_point" in codes
    assert not {"low_coverage", "uneven_coverage", "near_centre_only"} & set(codes)
    json.dumps(dataclasses.asdict(info), allow_nan=False)


def test_ragged_tests(ragged):
    frames, pressure = ragged
    frames[1] = (np.empty((0, 3)), np.empty((0, 3)))
    info = describe(BulgeTest.from_frames(frames, pressure))
    assert info.n_blocks == 3
    assert info.points_per_frame == (30, 0, 20, 35)
    assert info.apex_mm[1] is None
    assert info.n_lost == 0


def test_static_images_that_show_no_noise(made):
    one = BulgeTest.from_arrays(
        made.reference,
        made.displacement,
        made.pressure,
        static_displacement=np.zeros((1, *made.reference.shape)),
    )
    assert describe(one).static_noise_mm is None
    static = np.random.default_rng(0).normal(size=(4, *made.reference.shape)) * 0.02
    static[0, :, 1] = np.nan
    part = BulgeTest.from_arrays(
        made.reference, made.displacement, made.pressure, static_displacement=static
    )
    noise = describe(part).static_noise_mm
    assert noise[1] is None
    assert noise[0] == pytest.approx(0.02, rel=0.1)
