"""Do the measured tests of the study read as they should?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bulgefit.dic import describe, read_test, write_test
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.cut_bins import cut_bins, whole_bins
from bulgefit.dic.suspicions import alarms

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "dic"

pytestmark = pytest.mark.skipif(
    not FOLDER.is_dir(), reason="the study's measured data (../shared/data/dic) are not here"
)


@pytest.mark.parametrize(
    ("name", "frames", "points", "lost"),
    [
        ("valmex_test1_binned", 20, 537, 0),
        ("valmex_test2_binned", 20, 537, 0),
        ("valmex_test4_binned", 20, 537, 120),
        ("valmex_test1_apex", 49, 1, 0),
        ("valmex_test2_apex", 7, 1, 0),
        ("valmex_test3_apex", 36, 1, 0),
        ("valmex_test4_apex", 11, 1, 0),
        ("valmex_test1_profiles", 49, 438, 0),
        ("valmex_test2_profiles", 7, 743, 237),
        ("valmex_test4_profiles", 11, 376, 2),
    ],
)
def test_counts(name, frames, points, lost, tmp_path, same):
    test = read_test(FOLDER / f"{name}.npz")
    info = describe(test)
    assert (info.n_frames, info.n_points, info.n_lost) == (frames, points, lost)
    assert info.pressure_increases
    assert (info.radius, info.thickness, info.poisson_ratio) == (100.0, 0.81, 0.24)
    write_test(test, tmp_path / "t.h5")
    same(test, read_test(tmp_path / "t.h5"))


def test_apex_of_the_first_test():
    test = read_test(FOLDER / "valmex_test1_apex.npz")
    assert test.apex.tolist() == [0] * 49
    assert test.apex_displacement[[0, -1]].tolist() == [6.620507, 40.043591]
    info = describe(test)
    assert info.displacement_range[:2] == (None, None)
    assert any("dx was never measured" in item.text for item in info.warnings)


def test_corrupted_values_beside_the_holes_are_seen():
    info = describe(read_test(FOLDER / "valmex_test4_binned.npz"))
    assert "stray_points" in [item.code for item in info.warnings]


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.npz")), ids=lambda path: path.stem)
def test_measured_tests_raise_no_alarm(path):
    # with its cut bins the centre of the first test would seem to be off by 2 mm
    assert alarms(read_test(path)) == []


@pytest.mark.parametrize(
    ("name", "lost"),
    [("test1_binned", 100), ("test2_recorded", 100), ("test4_recorded", 149)],
)
def test_bins_that_the_rim_cuts_are_told(name, lost):
    test = read_test(FOLDER / f"valmex_{name}.npz")
    (found,) = map(cut_bins, test.blocks)
    assert found is not None
    assert found.lost == lost
    assert found.width == pytest.approx(7.41, abs=0.01)
    assert 1.4 < found.shift < 1.9
    assert found.error < 0.15


def test_profiles_tell_which_bins_are_where_they_say():
    """On the line y = 0 at the highest pressure, where points stand 0.9 to 2 mm apart."""
    binned = read_test(FOLDER / "valmex_test4_recorded.npz")
    profile = read_test(FOLDER / "valmex_test4_profiles.npz")
    reference, displacement = profile.frame(profile.n_frames - 1)
    line = np.isfinite(displacement[:, [0, 2]]).all(axis=1) & (np.abs(reference[:, 1]) < 0.3)
    order = np.argsort(reference[line, 0])
    x, height = reference[line, 0][order], displacement[line, 2][order]
    # beyond its last points the profile goes on as straight as between the last two
    ends = [(0, 1), (-1, -2)]
    below, above = ((height[j] - height[i]) / (x[j] - x[i]) for i, j in ends)

    def off(test: BulgeTest) -> float:
        points, moved = test.frame(test.n_frames - 1)
        known = np.isfinite(moved).all(axis=1) & (np.abs(points[:, 1]) < 0.1)
        at = points[known, 0]
        seen = np.interp(at, x, height)
        seen += below * np.minimum(at - x[0], 0.0) + above * np.maximum(at - x[-1], 0.0)
        return float(np.abs(moved[known, 2] - seen).max())

    # a bin's mean lies below its centre by up to 0.02 mm
    assert off(whole_bins(binned)) < 0.15
    assert off(binned) > 1.0


def test_a_quarter_turn_swaps_warp_and_fill():
    test = read_test(FOLDER / "valmex_test1_profiles.npz")
    turned = test.rotated(90)
    np.testing.assert_array_equal(
        turned.blocks[0].displacement[..., 1], test.blocks[0].displacement[..., 0]
    )
    assert turned.n_measured == test.n_measured
