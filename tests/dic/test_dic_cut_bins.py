"""Means over bins that the rim cuts, given at the bins' centres, are told and left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import read_test, write_test
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.cut_bins import cut_bins, of_whole_bins, whole_bins
from bulgefit.dic.suspicions import suspicions
from bulgefit.errors import InputError
from bulgefit.gap.caveats import left_out
from bulgefit.gap.prepare import prepare

WIDTH = 7.4
PRESSURE = np.array([0.01, 0.03, 0.06, 0.1, 0.15, 0.2])
NOISE = np.array([0.007, 0.007, 0.02])


def moved(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A bulge (frames, n, 3) mm about a clamp of 100 mm, of cloth that is stiffer along x."""
    rest = 1.0 - (x**2 + y**2) / 1e4
    shape = np.stack([0.02 * x, 0.03 * y, 30.0 + 8.0 * rest + 3e-4 * (x**2 - y**2)], axis=1)
    size = np.cbrt(PRESSURE / 0.2)[:, None, None] ** [2.0, 2.0, 1.0]
    return np.asarray(size * shape * rest[:, None])


def grid(pitch: float, reach: float) -> np.ndarray:
    """Square places (n, 2) mm within a circle, about the middle of one."""
    line = np.arange(-round(100.0 / pitch), round(100.0 / pitch) + 1) * pitch
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    return np.column_stack([x, y])[np.hypot(x, y) < reach]


def a_test(at: np.ndarray, displacement: np.ndarray) -> BulgeTest:
    noise = np.random.default_rng(1).normal(0.0, NOISE, displacement.shape)
    points = np.column_stack([at, np.zeros(len(at))])
    return BulgeTest.from_arrays(points, displacement + noise, PRESSURE)


def binned(at_centres: bool, hole: tuple[float, float, float] | None = None) -> BulgeTest:
    """A cloud that ends at 95 mm averaged over bins, given at their centres or mean positions."""
    cloud = grid(WIDTH / 11.0, 95.0)
    if hole is not None:
        cloud = cloud[np.hypot(*(cloud - hole[:2]).T) > hole[2]]
    cell, inverse = np.unique(np.round(cloud / WIDTH).astype(int), axis=0, return_inverse=True)
    number = np.bincount(inverse.ravel())

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(inverse.ravel(), values) / number

    field = moved(*cloud.T)
    means = np.array([[mean(one) for one in frame.T] for frame in field]).transpose(0, 2, 1)
    own = np.column_stack([mean(cloud[:, 0]), mean(cloud[:, 1])])
    return a_test(cell * WIDTH if at_centres else own, means)


def test_cut_bins_are_told_by_how_far_inside_they_show_the_field():
    test = binned(at_centres=True)
    (block,) = test.blocks
    found = cut_bins(block)
    assert found is not None
    assert found.width == pytest.approx(WIDTH)
    # as far as the means are from the centres, across the sides beyond which nothing is
    middle, own = (t.blocks[0].reference[:, :2] for t in (test, binned(at_centres=False)))
    inside = []
    for step in ([WIDTH, 0.0], [-WIDTH, 0.0], [0.0, WIDTH], [0.0, -WIDTH]):
        beyond = np.linalg.norm(middle[:, None] + step - middle, axis=2).min(axis=1)
        inside.append(((middle - own)[beyond > 0.1] @ step) / WIDTH)
    assert found.shift == pytest.approx(np.concatenate(inside).mean(), rel=0.05)
    assert 0.0 < found.error < 0.1 * found.shift
    left, lost = of_whole_bins(test)
    assert lost == test.n_points - left.n_points == found.lost > 50
    # what is left shows the field where it says, but for the curvature over a bin
    (kept,) = left.blocks
    wrong = np.abs(kept.displacement - moved(*kept.reference[:, :2].T)).max(axis=(0, 1))
    assert (wrong < 5.0 * NOISE + [0.02, 0.02, 0.1]).all()
    assert np.abs(block.displacement - moved(*block.reference[:, :2].T))[..., 2].max() > 1.0
    assert cut_bins(kept) is None


@pytest.mark.parametrize("reach", [80.0, 97.4])
def test_points_of_a_grid_that_are_where_they_say_are_kept(reach: float):
    at = grid(WIDTH, reach)
    test = a_test(at, moved(*at.T))
    assert cut_bins(test.blocks[0]) is None
    assert of_whole_bins(test) == (test, 0)
    assert "bins_cut" not in [one.code for one in suspicions(test)]
    with pytest.raises(InputError, match=r"--whole-bins: .* show the field where they say"):
        whole_bins(test)


def test_heights_alone_tell_it_too():
    (block,) = binned(at_centres=True).blocks
    displacement = np.array(block.displacement)
    displacement[..., :2] = np.nan
    test = BulgeTest.from_arrays(block.reference, displacement, PRESSURE)
    found = cut_bins(test.blocks[0])
    assert found is not None
    assert found.lost == cut_bins(block).lost


def test_mean_positions_are_on_no_grid():
    assert cut_bins(binned(at_centres=False).blocks[0]) is None


@pytest.mark.parametrize("closer", [1e-9, 1e-310])
def test_few_points_far_apart_are_no_grid(closer: float):
    """However close some of them are to each other: a table of all places would not be held."""
    at = np.concatenate([grid(WIDTH, 60.0) * closer, [[90.0, 0.0], [0.0, 90.0]]])
    assert cut_bins(a_test(at, moved(*at.T)).blocks[0]) is None


def test_bins_beside_a_hole_are_cut_too():
    test = binned(at_centres=True, hole=(30.0, -20.0, 9.0))
    left, _ = of_whole_bins(test)
    (block,) = left.blocks
    away = np.hypot(*(block.reference[:, :2] - [30.0, -20.0]).T)
    assert away.min() > 9.0 + 0.48 * WIDTH


def test_a_bin_is_cut_in_the_frames_in_which_its_neighbour_is_lost():
    test = binned(at_centres=True)
    (block,) = test.blocks
    at = int(np.argmin(np.hypot(*block.reference[:, :2].T)))
    displacement = np.array(block.displacement)
    displacement[2, at] = np.nan
    left, _ = of_whole_bins(BulgeTest.from_arrays(block.reference, displacement, PRESSURE))
    (kept,) = left.blocks
    near = np.hypot(*kept.reference[:, :2].T) < 1.5 * WIDTH
    assert near.sum() == 9
    lost = np.isnan(kept.displacement).all(axis=2)
    np.testing.assert_array_equal(lost[:, near].all(axis=1), np.arange(len(PRESSURE)) == 2)
    assert not lost[:, ~near].any()


def test_nothing_is_left_out_where_no_bin_is_whole():
    (block,) = binned(at_centres=True).blocks
    cell = np.round(block.reference[:, :2] / WIDTH).astype(int)
    displacement = np.array(block.displacement)
    for frame, moved_in in enumerate(displacement):
        # one of every nine
        moved_in[((cell - [frame, frame // 3]) % 3 == 0).all(axis=1)] = np.nan
    test = BulgeTest.from_arrays(block.reference, displacement, PRESSURE)
    assert of_whole_bins(test) == (test, 0)
    assert "bins_cut" not in [one.code for one in suspicions(test)]


def test_info_warns_and_convert_leaves_them_out(tmp_path: Path, capsys: pytest.CaptureFixture):
    test = binned(at_centres=True)
    write_test(test, tmp_path / "test.npz")
    assert main(["info", str(tmp_path / "test.npz")]) == 0
    said = capsys.readouterr().out
    assert "[bins_cut]" in said
    assert "--whole-bins" in said
    whole = tmp_path / "whole.npz"
    assert main(["convert", str(tmp_path / "test.npz"), str(whole), "--whole-bins"]) == 0
    converted = read_test(whole)
    assert converted.n_points == of_whole_bins(test)[0].n_points
    assert "--whole-bins" in converted.history[0]
    capsys.readouterr()
    assert main(["info", str(whole)]) == 0
    assert "[bins_cut]" not in capsys.readouterr().out
    assert main(["convert", str(whole), str(tmp_path / "again.npz"), "--whole-bins"]) == 2
    assert "leave it out" in capsys.readouterr().err


def test_a_diagnosis_leaves_them_out_and_says_so():
    test = binned(at_centres=True)
    prepared = prepare(test)
    assert prepared.cut == test.n_points - len(prepared.data.specimen.reference)
    (said,) = [line for line in left_out([prepared]) if "bins" in line]
    assert f"{prepared.cut} points at the edge of its grid were left out" in said
