"""Do the measured tests of the study read as they should?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bulgefit.dic import describe, read_test, write_test
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
def test_alarms_of_measured_tests(path):
    # the centre of the first test is off: its whole diagnosis says registration, 1.7 mm along x
    expected = ["off_centre"] if path.stem == "valmex_test1_binned" else []
    assert [item.code for item in alarms(read_test(path))] == expected


def test_a_quarter_turn_swaps_warp_and_fill():
    test = read_test(FOLDER / "valmex_test1_profiles.npz")
    turned = test.rotated(90)
    np.testing.assert_array_equal(
        turned.blocks[0].displacement[..., 1], test.blocks[0].displacement[..., 0]
    )
    assert turned.n_measured == test.n_measured
