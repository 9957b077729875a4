"""Does align bring a raw cloud back into the clamp's frame, and say what it did?"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli import align, info
from bulgefit.dic import BulgeTest, read_test, write_test
from bulgefit.dic.align import centred, on_plane, outline
from bulgefit.dic.binning import binned
from bulgefit.dic.mend import shifted
from bulgefit.dic.rim_motion import rim_motions, without_rim_motion
from bulgefit.dic.suspicions import alarms
from bulgefit.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"


def rotation(*degrees):
    vector = np.deg2rad(degrees)
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


@pytest.fixture(scope="module")
def example():
    return read_test(EXAMPLE)


@pytest.fixture
def arrays(example):
    block = example.blocks[0]
    return {
        "reference": block.reference.copy(),
        "displacement": block.displacement.astype(float),
        "static_displacement": example.static_displacement.astype(float),
        "pressure": example.pressure,
        "radius": 100.0,
        "thickness": 0.81,
    }


def run(verb, *arguments):
    parser = argparse.ArgumentParser(prog="bulgefit")
    verb.add_arguments(parser)
    return verb.run(parser.parse_args([str(argument) for argument in arguments]))


@pytest.fixture
def aligned(tmp_path):
    """Write arrays, align them, and read what was written."""

    def write_and_align(arrays, *options):
        np.savez(tmp_path / "raw.npz", **arrays)
        run(align, tmp_path / "raw.npz", tmp_path / "o.npz", *options, "--force")
        return read_test(tmp_path / "o.npz")

    return write_and_align


def as_seen(arrays, turn, shift):
    """The cloud in the frame of cameras that look at it from anywhere."""
    for key in ("displacement", "static_displacement"):
        arrays[key] = arrays[key] @ turn.T
    arrays["reference"] = arrays["reference"] @ turn.T + shift
    return arrays


def test_a_raw_cloud_comes_back(arrays, example, aligned, capsys):
    turn = rotation(12, -7, 0)
    test = aligned(as_seen(arrays, turn, [40, -25, 530]), "--json", "-")
    told = json.loads(capsys.readouterr().out)
    assert told["before"]["rim_centre_mm"] is None
    assert told["before"]["outline_centre_mm"] == pytest.approx([40, -25], abs=1)
    assert told["after"]["tilt_deg"] < 0.02
    assert told["after"]["rim_radius_mm"] == pytest.approx(100, abs=0.15)
    assert len(told["steps"]) == 2
    assert alarms(test) == []
    assert len(test.history) == 1
    assert test.history[0].startswith("bulgefit align ")
    assert test.history[0].endswith(f"raw.npz: {'; '.join(told['steps'])}")
    # what neither plane nor centre tells is a turn about z; the tilts' product leaves 0.7 degrees
    seen, truth = test.blocks[0].reference, example.blocks[0].reference
    complex_seen, complex_truth = seen[:, 0] + 1j * seen[:, 1], truth[:, 0] + 1j * truth[:, 1]
    spin = np.angle((complex_seen * complex_truth.conj()).sum())
    assert abs(np.rad2deg(spin)) < 1
    back = rotation(0, 0, -np.rad2deg(spin))
    np.testing.assert_allclose(seen @ back.T, truth, atol=0.1)
    np.testing.assert_allclose(
        test.blocks[0].displacement @ back.T, example.blocks[0].displacement, atol=0.02
    )


@pytest.mark.parametrize("how", ["--angle=20", "--marks=-10,0,84.0,34.2", "--marks=84,34.2,-10,0"])
def test_axes_by_angle_or_marks(arrays, example, aligned, how):
    test = aligned(as_seen(arrays, rotation(0, 0, 20), [0, 0, 0]), "--no-plane", "--no-centre", how)
    np.testing.assert_allclose(test.blocks[0].reference, example.blocks[0].reference, atol=0.02)
    np.testing.assert_allclose(
        test.blocks[0].displacement, example.blocks[0].displacement, atol=0.02
    )


def test_an_origin_that_is_not_told_from_the_centre_stays(example):
    """What the heights say of the centre, 0.02 ± 0.08 mm, is no better than where it lies."""
    here = example.blocks[0].reference
    for shift, left in ([0, 0], [0, 0]), ([0.05, 0], [0.05, 0]), ([1, -1], [0.021, -0.014]):
        laid = centred(shifted(example, [*shift, 0]))
        wanted = np.broadcast_to([*left, 0], here.shape)
        np.testing.assert_allclose(laid.blocks[0].reference - here, wanted, atol=1e-3)


def test_levelling_leaves_the_origin(example):
    test = on_plane(shifted(example, [60, -30, 500]))
    moved = test.blocks[0].reference - example.blocks[0].reference
    np.testing.assert_allclose(moved, np.broadcast_to([60, -30, 0], moved.shape), atol=5e-3)


def test_rigid_motions_are_found_and_taken_off(arrays, example, aligned):
    turns = np.linspace([0.3, -0.2, 0.1], [-0.5, 0.4, 0.2], 15)
    shifts = np.linspace([0.5, -0.4, 0.2], [-1.0, 0.3, 0.7], 15)
    clean = arrays["displacement"].copy()
    for i in range(15):
        seen = arrays["reference"] + clean[i]
        arrays["displacement"][i] = seen @ rotation(*turns[i]).T + shifts[i] - arrays["reference"]
    own = rim_motions(example)
    found = rim_motions(BulgeTest.from_arrays(**arrays))
    # what the example's own field looks like is not 0, by the polynomial and the noise
    assert np.rad2deg(np.abs(own[0])).max() < 0.015
    assert np.abs(own[1]).max() < 0.02
    np.testing.assert_allclose(np.rad2deg(found[0]), turns, atol=0.02)
    np.testing.assert_allclose(found[1], shifts, atol=0.03)
    test = aligned(arrays, "--no-plane", "--no-centre", "--rigid")
    np.testing.assert_allclose(test.blocks[0].displacement, clean, atol=0.04)


def test_the_rigid_motion_of_a_practice_case(shared):
    """Made by a membrane code that is not the project's."""
    truth = json.loads((shared / "practice" / "truth.json").read_text())["case04.npz"]
    rotation_deg, shift_mm = rim_motions(read_test(shared / "practice" / "case04.npz"))
    wanted = truth["parameters"]
    np.testing.assert_allclose(
        np.rad2deg(rotation_deg).mean(axis=0), wanted["rotation_deg"], atol=0.01
    )
    np.testing.assert_allclose(shift_mm.mean(axis=0), wanted["shift_mm"], atol=0.02)


def cloud(noise, count=40_000):
    rng = np.random.default_rng(4)
    points = rng.uniform(-95, 95, (count, 2))
    points = points[np.hypot(*points.T) < 95]
    x, y = points.T / 100
    bulge = 1 - x**2 - y**2
    pressure = np.linspace(0.05, 0.25, 5)
    rise = 60 * np.cbrt(pressure)
    moved = np.stack(
        [
            np.column_stack([2 * x * bulge, 2 * y * bulge, w * bulge * (1 + 0.1 * x**2)])
            for w in rise
        ]
    )
    reference = np.column_stack([points, np.zeros(len(points))])
    return {
        "reference": reference,
        "displacement": moved + rng.normal(0, noise, moved.shape),
        "pressure": pressure,
        "static_displacement": rng.normal(0, noise, (3, *reference.shape)),
    }, rise


def test_bins_lie_on_the_surface_and_average_noise():
    clean, rise = cloud(0.0)
    test = binned(BulgeTest.from_arrays(**clean), 8.0)
    block = test.blocks[0]
    x, y = block.reference[:, :2].T / 100
    truth = rise[:, None] * (1 - x**2 - y**2) * (1 + 0.1 * x**2)
    off = block.displacement[..., 2] - truth
    # a plain mean lies rise h^2 / 6 a^2 = 0.04 mm low; a quadratic misses the fourth order
    whole = np.hypot(x, y) < 0.85
    assert np.abs(off[:, whole]).max() < 1e-3
    noisy, _ = cloud(0.05)
    seen = binned(BulgeTest.from_arrays(**noisy), 8.0)
    scatter = (seen.blocks[0].displacement - block.displacement)[:, whole].std()
    # the middle of a quadratic through n points of a square has 7/2 of the variance of their mean
    count = len(clean["reference"]) * 64 / (np.pi * 95**2)
    assert scatter == pytest.approx(0.05 * np.sqrt(3.5 / count), rel=0.05)
    # and images at rest tell that noise
    assert seen.static_displacement[:, whole].std() == pytest.approx(scatter, rel=0.1)


def test_lost_points_do_not_move_a_bin():
    clean, _ = cloud(0.0)
    whole = binned(BulgeTest.from_arrays(**clean), 8.0).blocks[0]
    lost = np.random.default_rng(1).random(clean["displacement"].shape[:2]) < 0.4
    clean["displacement"][lost] = np.nan
    thin = binned(BulgeTest.from_arrays(**clean), 8.0).blocks[0]
    row = {tuple(point): i for i, point in enumerate(whole.reference)}
    rows = [row[tuple(point)] for point in thin.reference]
    assert len(rows) > 0.95 * len(row)
    inside = np.hypot(*thin.reference[:, :2].T) < 85
    difference = np.abs(thin.displacement - whole.displacement[:, rows])[:, inside]
    assert np.nanmax(difference) < 3e-3
    assert np.isfinite(difference).mean() > 0.98


def test_frames_with_points_of_their_own_become_common_ones():
    rng = np.random.default_rng(2)
    frames = []
    for w in (10.0, 20.0):
        points = rng.uniform(-60, 60, (8000, 2))
        height = w * (1 - (points**2).sum(axis=1) / 1e4)
        zeros = np.zeros(len(points))
        frames.append((np.column_stack([points, zeros]), np.column_stack([zeros, zeros, height])))
    test = binned(BulgeTest.from_frames(frames, [0.05, 0.2]), 10.0)
    (block,) = test.blocks
    assert list(block.frames) == [0, 1]
    for row, w in enumerate((10.0, 20.0)):
        truth = w * (1 - (block.reference[:, :2] ** 2).sum(axis=1) / 1e4)
        known = np.isfinite(block.displacement[row, :, 2])
        assert known.mean() > 0.9
        np.testing.assert_allclose(block.displacement[row, known, 2], truth[known], atol=1e-9)


def test_bins_without_enough_points(example):
    with pytest.raises(InputError, match=r"no bin of 6 mm has 12 points; give larger ones"):
        binned(example, 6.0)


def test_masks_crops_and_strays(arrays, aligned, capsys):
    arrays["displacement"][3, 100] += 4.0
    test = aligned(arrays, "--mask", "10,5,12", "--mask=-30,0,5", "--crop", "80", "--drop-strays")
    points = test.blocks[0].reference[:, :2]
    assert np.hypot(*(points - [10, 5]).T).min() > 12
    assert np.hypot(*(points - [-30, 0]).T).min() > 5
    assert np.hypot(*points.T).max() <= 80
    assert "strays lost" in test.history[0]
    assert "stray displacements       1 " in capsys.readouterr().out


def test_strays_are_lost(arrays, aligned):
    arrays["displacement"][3, 100] += 4.0
    test = aligned(arrays, "--drop-strays", "--no-plane", "--no-centre")
    was_lost = np.isnan(arrays["displacement"]).any(axis=2)
    lost = np.isnan(test.blocks[0].displacement).any(axis=2)
    assert lost[3, 100]
    assert lost.sum() == was_lost.sum() + 1


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_history_goes_along(arrays, tmp_path, suffix, capsys):
    test = BulgeTest.from_arrays(**arrays).with_history("first\nthing").with_history("zwei: ä")
    write_test(test, tmp_path / f"t{suffix}")
    again = read_test(tmp_path / f"t{suffix}")
    assert again.history == ("first thing", "zwei: ä")
    assert again.rotated(30).select(frames=[1, 2]).history == again.history
    run(info, tmp_path / f"t{suffix}")
    assert "history         zwei: ä" in capsys.readouterr().out


def test_history_that_is_no_text(arrays, tmp_path):
    np.savez(tmp_path / "t.npz", **arrays, history=np.zeros(3))
    with pytest.raises(InputError, match="history is not the bytes of a text"):
        read_test(tmp_path / "t.npz")
    escape = np.frombuffer(b"\x1b[31mred\nnext\xff", dtype=np.uint8)
    np.savez(tmp_path / "t.npz", **arrays, history=escape)
    assert read_test(tmp_path / "t.npz").history == ("[31mred", "next\ufffd")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        (["--marks", "1,2,3"], "--marks 1,2,3: give 4 numbers"),
        (["--marks", "1,2,1,2"], "one point"),
        (["--angle", "nan"], "--angle nan: give a number"),
        (["--mask", "1,2"], "--mask 1,2: give 3 numbers"),
        (["--mask", "0,0,200"], "no measured point is left"),
        (["--crop", "-1"], "--crop -1: give a length above 0"),
        (["--bin", "0"], "--bin 0: give a length above 0"),
        (["--bin", "nan"], "--bin nan: give a number"),
        (["--bin", "5"], "no bin of 5 mm"),
    ],
)
def test_options_that_make_no_sense(arrays, aligned, options, match):
    with pytest.raises(InputError, match=match) as caught:
        aligned(arrays, *options)
    assert "\n" not in str(caught.value)


def test_a_plane_that_cannot_be_told_is_left_by_an_option_of_this_verb(arrays, aligned):
    few = {**arrays, "reference": arrays["reference"][::60]}
    for key in ("displacement", "static_displacement"):
        few[key] = arrays[key][:, ::60]
    with pytest.raises(InputError, match=r"needs points all around.*; leave the plane with --no-p"):
        aligned(few)


def test_what_does_not_tell_is_said(arrays, aligned, example, tmp_path):
    few = {key: value for key, value in arrays.items() if key != "static_displacement"}
    few["reference"], few["displacement"] = few["reference"][:60], few["displacement"][:, :60]
    with pytest.raises(InputError, match="too few points to tell how its rim moved"):
        aligned(few, "--no-plane", "--no-centre", "--rigid")
    line = BulgeTest.from_arrays([[x, 0, 0] for x in range(9)], np.ones((1, 9, 3)), [0.1])
    assert outline(line)[1] == 4
    with pytest.raises(InputError, match="too few points"):
        without_rim_motion(line)


def test_input_is_never_replaced(tmp_path):
    file = tmp_path / "t.npz"
    file.write_bytes(EXAMPLE.read_bytes())
    with pytest.raises(InputError, match="would replace what is read"):
        run(align, file, file, "--force")
    with pytest.raises(InputError, match="would replace what is read"):
        run(align, file, tmp_path / "o.npz", "--json", file, "--force")
    run(align, file, tmp_path / "o.npz")
    with pytest.raises(InputError, match="exists; use --force"):
        run(align, file, tmp_path / "o.npz")
    assert file.read_bytes() == EXAMPLE.read_bytes()


def test_what_is_no_file_of_a_test_is_refused_before_the_work(tmp_path, capsys):
    with pytest.raises(InputError, match=r"o.txt: a test is written as .npz, .h5, .hdf5"):
        run(align, EXAMPLE, tmp_path / "o.txt", "--json", tmp_path / "o.json")
    assert capsys.readouterr().out == ""
    assert [*tmp_path.iterdir()] == []
