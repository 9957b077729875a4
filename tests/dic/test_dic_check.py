"""Is what cannot be a bulge test refused, with one line that says why?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic import BulgeTest
from bulgefit.errors import InputError


def refused(made, match, **changes):
    arrays = {**vars(made), **changes}
    given = [arrays.pop(key) for key in ("reference", "displacement", "pressure")]
    with pytest.raises(InputError, match=match) as caught:
        BulgeTest.from_arrays(*given, name="bad", **arrays)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("bad: ")


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"radius": 0.1}, "radius 0.1 mm is too small, it looks like metres"),
        ({"radius": 1e5}, "too large"),
        ({"radius": -100.0}, "must be positive"),
        ({"radius": np.nan}, "must be positive"),
        ({"thickness": 0.0}, "must be positive"),
        ({"thickness": 0.00081}, "looks like metres"),
        ({"thickness": 810.0}, "looks like micrometres"),
        ({"poisson_ratio": 24.0}, "poisson_ratio 24 must lie between -2 and 2"),
        ({"poisson_ratio": np.nan}, "between -2 and 2"),
        ({"time": [1.0, 2.0]}, "time has 2 values for 6 frames"),
        ({"time": [0, 1, 2, np.nan, 4, 5]}, "time of frame 3 is nan"),
        ({"schedule": np.arange(9)}, "no time tells which"),
        ({"time": np.arange(6), "schedule": np.arange(5)}, "schedule is no list of the times"),
        ({"time": np.arange(6), "schedule": np.arange(3, 12)}, "among them the 6 of this test"),
        ({"time": np.arange(6), "schedule": [0, 1, 2, 3, 4, 5, np.nan]}, "schedule is no list"),
        ({"time": np.arange(6), "schedule": []}, "schedule is no list"),
        ({"pressure": np.zeros(6)}, "no frame is under pressure"),
        ({"pressure": [0.1, 0.2]}, "6 frames and pressure 2"),
        ({"pressure": np.ones((6, 2))}, r"shape \(6, 2\)"),
        ({"pressure": ["a"] * 6}, "not real numbers"),
        ({"reference": np.zeros((4, 2))}, "reference has shape"),
        ({"reference": np.zeros((4, 3))}, "points and reference 4"),
        ({"displacement": np.zeros((6, 3))}, "displacement has shape"),
        ({"static_displacement": np.zeros((2, 3))}, "static_displacement has shape"),
        ({"static_displacement": np.zeros((2, 4, 3))}, "static_displacement has 4 points"),
    ],
)
def test_what_cannot_be(made, changes, match):
    refused(made, match, **changes)


@pytest.mark.parametrize(("factor", "unit"), [(1e6, "Pa"), (1e3, "kPa"), (100.0, "kPa or bar")])
def test_pressure_in_another_unit(made, factor, unit):
    refused(made, f"MPa cannot be, it looks like {unit}; give MPa", pressure=made.pressure * factor)


def test_pressure_in_no_unit(made):
    refused(made, "pressure 3e\\+19 MPa cannot be; give MPa", pressure=made.pressure * 1e20)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_pressure_not_finite(made, bad):
    made.pressure[3] = bad
    refused(made, "pressure of frame 3 is")


def test_negative_pressure_beyond_a_gauges_offset(made):
    made.pressure[0] = -0.1 * made.pressure.max()
    refused(made, "pressure of frame 0 is negative")
    made.pressure[0] = -0.04 * made.pressure.max()
    BulgeTest.from_arrays(made.reference, made.displacement, made.pressure)


def test_no_frames():
    with pytest.raises(InputError, match="no pressure"):
        BulgeTest.from_arrays(np.zeros((2, 3)), np.zeros((0, 2, 3)), [])
    with pytest.raises(InputError, match="no pressure"):
        BulgeTest.from_frames([], [])


def test_all_points_lost(made):
    refused(made, "all points are lost", displacement=np.full_like(made.displacement, np.nan))
    with pytest.raises(InputError, match="all points are lost"):
        BulgeTest.from_frames([(np.empty((0, 3)), np.empty((0, 3)))], [0.1])


def test_points_outside_the_clamp(made):
    made.reference[3] = [120.0, 0.0, 0.0]
    made.reference[4] = [0.0, 110.0, 0.0]
    refused(made, r"2 points lie outside the clamp, at up to r = 120 mm.*--crop 100")
    made.displacement[:, 3:5] = np.nan  # lost points may lie anywhere
    BulgeTest.from_arrays(made.reference, made.displacement, made.pressure)


def test_crop_comes_before_the_check(made):
    made.reference[3] = [120.0, 0.0, 0.0]
    test = BulgeTest.from_arrays(made.reference, made.displacement, made.pressure, crop=98.0)
    assert test.n_points == len(made.reference) - 1


def test_infinite_displacement(made):
    made.displacement[2, 7, 1] = np.inf
    refused(made, "point 7 in frame 2 is infinite")


def test_displacement_larger_than_the_specimen(made):
    made.displacement[2, 7, 1] = -201.0
    refused(made, "displacement 201 mm of point 7 in frame 2")


def test_static_displacement_that_cannot_be(made):
    static = np.zeros((2, *made.reference.shape))
    static[0, 0, 0] = 1e4
    refused(made, "static_displacement exceeds", static_displacement=static)
    refused(made, "no measured point", static_displacement=np.full_like(static, np.nan))


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_reference_that_is_no_position(made, bad):
    made.reference[5, 2] = bad
    refused(made, "reference of 1 points is no position in mm, first at point 5")


def test_bad_frames_are_named(ragged):
    frames, pressure = ragged
    frames[2] = (frames[2][0], frames[2][1][:5])
    with pytest.raises(InputError, match="bad: frame 2: displacement has 5 points"):
        BulgeTest.from_frames(frames, pressure, name="bad")
    with pytest.raises(InputError, match="4 frames and 2 pressures"):
        BulgeTest.from_frames(frames, pressure[:2])


def test_arrays_that_are_not_rectangular():
    with pytest.raises(InputError, match="not a rectangular array"):
        BulgeTest.from_arrays([[1, 2, 3], [1, 2]], np.zeros((1, 2, 3)), [0.1])
