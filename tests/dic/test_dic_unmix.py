"""Recorded frames are told from those that were interpolated between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.readers import read_test
from bulgefit.dic.suspicions import suspicions
from bulgefit.dic.unmix import recorded_frames
from bulgefit.dic.writers import write_test

NOISE = 0.004
#: MPa; the second and third lie between two of the common ones below, as the last two do not.
RECORDED = np.array(
    [0.0041, 0.0312, 0.0561, 0.0733, 0.1058, 0.1391, 0.1748, 0.1966, 0.2417, 0.2692]
)


def recorded(pressure: np.ndarray = RECORDED, lost: bool = False) -> BulgeTest:
    """A dome that rises as the cube root of pressure, seen with noise, at times that are kept."""
    side = np.arange(-95.0, 96.0, 5.0)
    x, y = (g.ravel() for g in np.meshgrid(side, side))
    points = np.column_stack([x, y, np.zeros(len(x))])[np.hypot(x, y) < 96.0]
    square = (points[:, :2] ** 2).sum(axis=1) / 100.0**2
    rise = np.cbrt(pressure / 0.25)[:, None]
    moved = np.zeros((len(pressure), len(points), 3))
    moved[..., 2] = 30.0 * rise * (1.0 - square) * (1.0 - 0.05 * rise**2 * square)
    moved[..., :2] = 0.06 * points[:, :2] * (rise**2 * (1.0 - square))[..., None]
    moved += NOISE * np.random.default_rng(11).normal(size=moved.shape)
    if lost:
        moved[4, :200:3] = np.nan
    time = 20.0 * np.arange(len(pressure)) ** 1.2
    return BulgeTest.from_arrays(points, moved, pressure, time=time)


def interpolated(test: BulgeTest, common: np.ndarray, dtype: type = np.float64) -> BulgeTest:
    """At other pressures; what was lost in a frame is lost in all that it has a share in."""
    (block,) = test.blocks
    share = np.stack(
        [np.interp(common, test.pressure, one) for one in np.eye(test.n_frames)], axis=1
    )
    moved = np.empty((len(common), *block.displacement.shape[1:]))
    for out, row in zip(moved, share, strict=True):
        has = row > 0.0
        out[:] = np.tensordot(row[has], block.displacement[has], 1)
    return BulgeTest.from_arrays(
        np.asarray(block.reference), moved.astype(dtype), common, time=share @ test.time
    )


COMMON = np.linspace(RECORDED[0], RECORDED[-1], 20)


def test_all_frames_are_told_with_their_pressures_and_times() -> None:
    truth = recorded()
    found = recorded_frames(interpolated(truth, COMMON))
    assert found is not None
    assert found.pressure == pytest.approx(RECORDED, rel=1e-9)
    assert found.time == pytest.approx(truth.time, abs=1e-6)
    np.testing.assert_array_equal(found.schedule, found.time)
    seen, true = (test.blocks[0].displacement for test in (found, truth))
    assert np.abs(seen - true).max() < 1e-8


def test_single_precision_is_enough() -> None:
    truth = recorded()
    found = recorded_frames(interpolated(truth, COMMON, np.float32))
    assert found is not None
    assert found.pressure == pytest.approx(RECORDED, rel=1e-4)
    seen, true = (test.blocks[0].displacement for test in (found, truth))
    assert np.abs(seen - true).max() < 0.05 * NOISE


def test_corners_that_no_frame_parts_are_left_out() -> None:
    """Two recorded frames between the same two common ones: nothing tells either."""
    pressure = np.sort(np.append(RECORDED, 0.109))
    found = recorded_frames(interpolated(recorded(pressure), COMMON))
    assert found is not None
    rest = pressure[(pressure < 0.105) | (pressure > 0.11)]
    assert found.pressure == pytest.approx(rest, rel=1e-9)


def test_a_stretch_with_a_single_frame_is_told_by_its_neighbours() -> None:
    pressure = np.delete(RECORDED, [1, 5])
    common = np.sort(
        np.append(
            pressure[[0, -1]], [0.02, 0.03, 0.06, 0.09, 0.1, 0.12, 0.15, 0.19, 0.2, 0.23, 0.26]
        )
    )
    found = recorded_frames(interpolated(recorded(pressure), common))
    assert found is not None
    # uneven steps do not say that the ends were recorded
    assert found.pressure == pytest.approx(pressure[1:-1], rel=1e-7)


def test_ends_inside_the_recorded_range_are_mixtures() -> None:
    low = 0.7 * RECORDED[0] + 0.3 * RECORDED[1]
    high = 0.7 * RECORDED[-1] + 0.3 * RECORDED[-2]
    found = recorded_frames(interpolated(recorded(), np.linspace(low, high, 20)))
    assert found is not None
    assert found.pressure == pytest.approx(RECORDED[1:-1], rel=1e-7)


def test_round_steps_do_not_say_that_the_ends_were_recorded() -> None:
    pressure = np.concatenate([[0.0], RECORDED[1:-1], [0.28]])
    found = recorded_frames(interpolated(recorded(pressure), np.linspace(0.0, 0.28, 29)))
    assert found is not None
    assert found.pressure == pytest.approx(RECORDED[1:-1], rel=1e-7)


def test_an_image_at_rest_has_no_noise_to_compare() -> None:
    """It stands at the end of the common pressures, where nothing has moved at all."""
    truth = recorded(np.array([0.0, *RECORDED[1:]]))
    (block,) = truth.blocks
    moved = block.displacement.copy()
    moved[0] = 0.0
    truth = BulgeTest.from_arrays(
        np.asarray(block.reference), moved, truth.pressure, time=truth.time
    )
    found = recorded_frames(interpolated(truth, np.linspace(0.0, RECORDED[-1], 20)))
    assert found is not None
    assert found.pressure[:8] == pytest.approx(RECORDED[1:-1], rel=1e-9)


def test_points_that_were_lost_stay_lost_there_alone() -> None:
    truth = recorded(lost=True)
    found = recorded_frames(interpolated(truth, COMMON))
    assert found is not None
    seen, true = (test.blocks[0].displacement for test in (found, truth))
    assert found.pressure == pytest.approx(RECORDED, rel=1e-9)
    assert np.isnan(seen[4, :200:3]).all()
    told = np.isfinite(seen)
    assert told[[0, 1, 2, 6, 7, 8, 9]].all()
    assert np.abs((seen - true)[told]).max() < 1e-8


def test_what_was_recorded_or_bent_between_is_left_alone() -> None:
    assert recorded_frames(recorded()) is None
    truth = recorded()
    bent = interpolated(truth, COMMON)
    (block,) = truth.blocks
    share = np.stack(
        [np.interp(np.cbrt(COMMON), np.cbrt(RECORDED), one) for one in np.eye(len(RECORDED))], 1
    )
    moved = np.einsum("cf,fnk->cnk", share, block.displacement)
    bent = BulgeTest.from_arrays(np.asarray(block.reference), moved, COMMON)
    assert recorded_frames(bent) is None


def test_info_tells_them_and_convert_writes_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixed = interpolated(recorded(), COMMON)
    (said,) = [s for s in suspicions(mixed) if s.code == "frames_interpolated"]
    assert "0.041, 0.312, 0.561, 0.733, 1.058, 1.391, 1.748, 1.966, 2.417, 2.692 bar" in said.remedy
    write_test(mixed, tmp_path / "mixed.npz")
    assert (
        main(["convert", str(tmp_path / "mixed.npz"), str(tmp_path / "out.npz"), "--recorded"]) == 0
    )
    out = read_test(tmp_path / "out.npz")
    assert out.pressure == pytest.approx(RECORDED, rel=1e-9)
    assert out.history[-1].endswith("--recorded")
    again = ["convert", str(tmp_path / "out.npz"), str(tmp_path / "no.npz"), "--recorded"]
    assert main(again) == 2
    assert "were not interpolated straight in pressure" in capsys.readouterr().err
    assert not (tmp_path / "no.npz").exists()


@pytest.mark.parametrize("number", [2, 4])
def test_the_studys_binned_frames_tell_those_between_the_ends(shared: Path, number: int) -> None:
    folder = shared / "data" / "dic"
    found = recorded_frames(read_test(folder / f"valmex_test{number}_binned.npz"))
    true = read_test(folder / f"valmex_test{number}_recorded.npz")
    assert found is not None
    assert found.pressure == pytest.approx(true.pressure[1:-1], abs=1e-7)
    # points that were corrupt in every recorded frame are not in its file
    (here, there) = (np.asarray(test.blocks[0].reference) for test in (found, true))
    same = [int(np.argmin(np.linalg.norm(here - one, axis=1))) for one in there]
    seen, known = found.blocks[0].displacement[:, same], true.blocks[0].displacement[1:-1]
    both = np.isfinite(seen) & np.isfinite(known)
    assert both.mean() > 0.9
    assert np.abs((seen - known)[both]).max() < 1e-5
