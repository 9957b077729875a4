"""Does a bulge test hold its points, frames and turns?"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from bulgefit.dic import BulgeTest, read_test, write_test
from bulgefit.errors import InputError


def test_counts(made_test, made):
    assert made_test.n_frames == 6
    assert made_test.n_points == len(made.reference)
    assert made_test.n_measured == 6 * len(made.reference)
    assert made_test.pressure_increases


def test_arrays_are_copied_and_read_only(made):
    test = BulgeTest.from_arrays(made.reference, made.displacement, made.pressure)
    made.displacement[0, 0, 0] = 99.0
    assert test.blocks[0].displacement[0, 0, 0] != 99.0
    for array in (test.pressure, test.blocks[0].reference, test.blocks[0].displacement):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    made.reference[0] = 1.0  # the caller's own stay writable


def test_float32_is_kept_and_other_types_become_float64(made):
    single = BulgeTest.from_arrays(
        made.reference, made.displacement.astype(np.float32), made.pressure
    )
    assert single.blocks[0].displacement.dtype == np.float32
    assert single.rotated(30).blocks[0].displacement.dtype == np.float32
    assert single.blocks[0].reference.dtype == np.float64
    for kind in (np.float16, np.int32, ">f8"):
        other = BulgeTest.from_arrays(
            made.reference, np.rint(made.displacement).astype(kind), made.pressure
        )
        assert other.blocks[0].displacement.dtype == np.float64
        assert other.blocks[0].displacement.dtype.isnative


def test_arrays_that_are_not_contiguous(made):
    wide = np.repeat(made.displacement, 2, axis=1)
    test = BulgeTest.from_arrays(
        np.asfortranarray(made.reference), wide[:, ::2], made.pressure[::-1][::-1]
    )
    np.testing.assert_array_equal(test.blocks[0].displacement, made.displacement)
    assert test.blocks[0].displacement.flags.c_contiguous


def test_pickle_round_trip(made_test, same):
    again = pickle.loads(pickle.dumps(made_test))
    same(made_test, again)
    assert again.name == "made"
    assert not again.blocks[0].displacement.flags.writeable
    assert not again.pressure.flags.writeable


def test_frame_drops_lost_points_but_keeps_part_measured_ones(made):
    made.displacement[2, :5] = np.nan
    made.displacement[2, 5, 0] = np.nan
    test = BulgeTest.from_arrays(made.reference, made.displacement, made.pressure)
    reference, displacement = test.frame(2)
    assert len(reference) == len(displacement) == len(made.reference) - 5
    assert np.isnan(displacement[0]).tolist() == [True, False, False]
    assert test.n_measured == 6 * len(made.reference) - 5
    np.testing.assert_array_equal(test.frame(-1)[1], made.displacement[5])
    with pytest.raises(IndexError):
        test.frame(6)


def test_rotation_is_counter_clockwise_seen_from_plus_z():
    test = BulgeTest.from_arrays(
        [[10.0, 0.0, 1.0]], [[[1.0, 0.0, 5.0]]], [0.1], static_displacement=[[[0.0, 0.1, 0.2]]]
    )
    turned = test.rotated(30.0)
    c, s = np.sqrt(3) / 2, 0.5
    np.testing.assert_allclose(turned.blocks[0].reference, [[10 * c, 10 * s, 1.0]], rtol=1e-14)
    np.testing.assert_allclose(turned.blocks[0].displacement, [[[c, s, 5.0]]], rtol=1e-14)
    np.testing.assert_allclose(turned.static_displacement, [[[-0.1 * s, 0.1 * c, 0.2]]], rtol=1e-14)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(90, (-2, 1)), (180, (-1, -2)), (270, (2, -1)), (-90, (2, -1)), (360, (1, 2)), (450, (-2, 1))],
)
def test_quarter_turns_are_exact(angle, expected):
    test = BulgeTest.from_arrays([[1.0, 2.0, 0.0]], [[[1.0, 2.0, 3.0]]], [0.1])
    turned = test.rotated(angle)
    assert turned.blocks[0].reference[0, :2].tolist() == list(expected)
    assert turned.blocks[0].displacement[0, 0].tolist() == [*expected, 3.0]


def test_lost_components_when_turned():
    test = BulgeTest.from_arrays([[1.0, 2.0, 0.0]], [[[1.0, np.nan, 3.0]]], [0.1])
    quarter = test.rotated(90).blocks[0].displacement[0, 0]
    assert np.isnan(quarter[0])
    assert quarter[1:].tolist() == [1.0, 3.0]
    oblique = test.rotated(45).blocks[0].displacement[0, 0]
    assert np.isnan(oblique[:2]).all()
    assert oblique[2] == 3.0


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_of_frames_that_are_written_alone_all_times_are_kept(made_test, tmp_path, suffix):
    """What goes by time is counted by all that was recorded, also when some is read again."""
    part, path = made_test.select(frames=[4, 1]), tmp_path / f"part{suffix}"
    write_test(part, path)
    again = read_test(path)
    np.testing.assert_array_equal(again.time, [2.0, 8.0])
    np.testing.assert_array_equal(again.schedule, made_test.time)
    # of a whole test its own times are all there are
    write_test(made_test, tmp_path / "whole.npz")
    with np.load(tmp_path / "whole.npz") as file:
        assert "time" in file
        assert "schedule" not in file


def test_turning_back_gives_the_test_again(made_test):
    back = made_test.rotated(33.0).rotated(-33.0)
    np.testing.assert_allclose(
        back.blocks[0].displacement, made_test.blocks[0].displacement, atol=1e-13
    )


def test_turning_ragged_tests_keeps_them_ragged(ragged):
    frames, pressure = ragged
    turned = BulgeTest.from_frames(frames, pressure).rotated(90)
    assert len(turned.blocks) == 4
    np.testing.assert_array_equal(turned.frame(2)[0][:, 0], -frames[2][0][:, 1])


def test_select_frames_and_points(made_test, made):
    mask = made.reference[:, 0] > 0
    part = made_test.select(frames=[4, 1], points=mask)
    assert part.n_frames == 2
    np.testing.assert_array_equal(part.pressure, made.pressure[[1, 4]])
    np.testing.assert_array_equal(part.time, [2.0, 8.0])
    np.testing.assert_array_equal(part.select(frames=[1]).schedule, made_test.time)
    np.testing.assert_array_equal(part.blocks[0].displacement, made.displacement[[1, 4]][:, mask])
    assert part.static_displacement.shape == (3, mask.sum(), 3)
    assert part.blocks[0].frames.tolist() == [0, 1]
    assert made_test.select(frames=slice(None, None, 2)).n_frames == 3


def test_select_frames_of_a_ragged_test(ragged):
    frames, pressure = ragged
    part = BulgeTest.from_frames(frames, pressure).select(frames=[False, True, False, True])
    assert [block.frames.tolist() for block in part.blocks] == [[0], [1]]
    np.testing.assert_array_equal(part.frame(1)[1], frames[3][1])


def test_crop(made_test, made, ragged):
    part = made_test.cropped(50.0)
    assert part.n_points == (np.hypot(*made.reference[:, :2].T) <= 50).sum()
    frames, pressure = ragged
    part = BulgeTest.from_frames(frames, pressure).cropped(50.0)
    inside = sum(int((np.hypot(*points[:, :2].T) <= 50).sum()) for points, _ in frames)
    assert part.n_measured == inside
    with pytest.raises(InputError, match="all points are lost"):
        made_test.select(points=np.zeros(made_test.n_points, dtype=bool))


def test_apex_is_the_measured_point_nearest_the_centre():
    reference = [[3.0, 0, 0], [1.0, 0, 0], [0.0, -2, 0]]
    displacement = np.arange(27.0).reshape(3, 3, 3)
    displacement[1, 1, 2] = np.nan
    displacement[2, :, 2] = np.nan
    test = BulgeTest.from_arrays(reference, displacement, [0.1, 0.2, 0.3])
    assert test.apex.tolist() == [1, 2, -1]
    np.testing.assert_array_equal(test.apex_displacement, [5.0, 17.0, np.nan])


def test_apex_of_a_ragged_test(ragged):
    frames, pressure = ragged
    test = BulgeTest.from_frames(frames, pressure)
    for i, (points, moved) in enumerate(frames):
        nearest = np.hypot(*points[:, :2].T).argmin()
        assert test.apex[i] == nearest
        assert test.apex_displacement[i] == moved[nearest, 2]


def test_frames_that_share_points_merge(made):
    rng = np.random.default_rng(0)
    frames = []
    for moved in made.displacement:
        kept = rng.permutation(len(made.reference))[:400]
        jitter = rng.uniform(-3e-10, 3e-10, (400, 3))
        frames.append((np.round(made.reference[kept], 6) + jitter, moved[kept]))
    test = BulgeTest.from_frames(frames, made.pressure)
    assert len(test.blocks) == 1
    assert test.n_points == len(made.reference)
    assert test.n_measured == 2400
    for i, (points, moved) in enumerate(frames):
        found, displacement = test.frame(i)
        order, expected = np.lexsort(found.T), np.lexsort(np.round(points, 6).T)
        np.testing.assert_allclose(found[order], points[expected], atol=1e-9)
        np.testing.assert_array_equal(displacement[order], moved[expected])


def test_points_of_merged_frames_keep_their_order(made):
    frames = [(made.reference, moved) for moved in made.displacement]
    test = BulgeTest.from_frames(frames, made.pressure)
    np.testing.assert_array_equal(test.blocks[0].reference, made.reference)
    np.testing.assert_array_equal(test.blocks[0].displacement, made.displacement)


def test_frames_with_points_of_their_own_stay_apart(ragged):
    frames, pressure = ragged
    test = BulgeTest.from_frames(frames, pressure)
    assert len(test.blocks) == 4
    assert test.n_points == test.n_measured == 125
    np.testing.assert_array_equal(test.frame(3)[0], frames[3][0])


@pytest.mark.parametrize(("own", "blocks"), [(16, 1), (17, 4)])
def test_frames_merge_up_to_one_and_a_half_times_the_largest(own, blocks):
    # 4 frames of 100 points, `own` of them in no other frame: 148 or 151 distinct points
    points = np.random.default_rng(0).uniform(-50, 50, (100 + 3 * own, 3))
    shared = np.arange(100 - own)
    frames = [
        (points[np.r_[shared, 100 - own + i * own + np.arange(own)]], np.ones((100, 3)))
        for i in range(4)
    ]
    test = BulgeTest.from_frames(frames, [0.1, 0.2, 0.3, 0.4])
    assert len(test.blocks) == blocks
    assert test.n_points == len(points)


def test_a_point_twice_in_a_frame_is_not_merged():
    points = np.array([[1.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    frames = [(points, np.full((3, 3), i + 1.0)) for i in range(2)]
    test = BulgeTest.from_frames(frames, [0.1, 0.2])
    assert len(test.blocks) == 2
    assert test.n_measured == 6


def test_points_without_position_or_displacement_are_dropped():
    points = np.array([[1.0, 0, 0], [np.nan, 0, 0], [2.0, 0, 0]])
    moved = np.array([[1.0, 1, 1], [1.0, 1, 1], [np.nan] * 3])
    test = BulgeTest.from_frames([(points, moved)], [0.1])
    assert test.n_points == 1


def test_a_frame_without_points_among_ragged_ones(ragged):
    frames, pressure = ragged
    frames[1] = (np.empty((0, 3)), np.empty((0, 3)))
    test = BulgeTest.from_frames(frames, pressure)
    assert test.n_frames == 4
    assert len(test.blocks) == 3
    assert test.frame(1)[0].shape == (0, 3)
    assert test.apex[1] == -1
    assert np.isnan(test.apex_displacement[1])


def test_float32_frames_stay_float32(ragged):
    frames, pressure = ragged
    frames = [(frames[0][0], moved[:20].astype(np.float32)) for _, moved in frames]
    frames = [(points[:20], moved) for points, moved in frames]
    assert BulgeTest.from_frames(frames, pressure).blocks[0].displacement.dtype == np.float32


def test_pressures_may_fall(made):
    pressure = made.pressure.copy()
    pressure[4] = pressure[2]
    test = BulgeTest.from_arrays(made.reference, made.displacement, pressure, name="cycle")
    assert not test.pressure_increases
    assert test.select(frames=slice(0, 4)).pressure_increases
