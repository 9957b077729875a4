"""Are images that stand before the others taken for images at rest?"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, read_test, write_test
from bulgefit.dic.mend import images_at_rest
from bulgefit.dic.noise import Noise, Source, noise_of
from bulgefit.dic.suspicions import alarms
from bulgefit.errors import InputError

SIGMA = np.array([0.004, 0.006, 0.011])


def made(images: int = 9, rest: float = 0.0, **given) -> BulgeTest:
    """The reference itself, images at rest, then five frames of a cap; noise of each its own."""
    x, y = (g.ravel() for g in np.meshgrid(*[np.linspace(-90, 90, 31)] * 2))
    points = np.column_stack([x, y, 0 * x])[np.hypot(x, y) < 92]
    load = np.linspace(0.02, 0.2, 5)
    pressure = np.concatenate([np.full(images + 1, rest), load])
    moved = np.random.default_rng(3).normal(size=(images + 6, len(points), 3)) * SIGMA
    part = (points[:, 0] ** 2 + points[:, 1] ** 2) / 1e4
    moved[images + 1 :, :, 2] += 40 * np.cbrt(load)[:, None] * (1 - part)
    moved[0] = 0.0
    return BulgeTest.from_arrays(points, moved, pressure, **given)


def test_they_tell_the_noise_and_are_no_frames():
    test = made(time=np.arange(15.0))
    apart = images_at_rest(test, 10)
    assert (apart.n_frames, apart.blocks[0].frames.tolist()) == (5, [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(apart.pressure, test.pressure[10:])
    np.testing.assert_array_equal(apart.time, np.arange(10.0, 15.0))
    # what goes by time is not counted by images before any load
    np.testing.assert_array_equal(apart.schedule, apart.time)
    moved = test.blocks[0].displacement
    np.testing.assert_array_equal(apart.blocks[0].displacement, moved[10:])
    # the reference itself would make the noise look smaller
    np.testing.assert_array_equal(apart.static_displacement, moved[1:10])
    noise = noise_of(apart)
    assert noise.source is Source.AT_REST
    np.testing.assert_allclose(noise.sigma, SIGMA, rtol=0.03)
    more = images_at_rest(apart, 1)
    assert (len(more.static_displacement), more.n_frames) == (10, 4)


def of_few(count: int, images: int) -> Noise | None:
    """The noise of so many points by so many images at rest."""
    apart = images_at_rest(made(images), images + 1)
    return noise_of(apart.select(points=np.arange(len(apart.blocks[0].reference)) < count))


@pytest.mark.parametrize("count", [4, 12, 24, 30])
def test_they_tell_it_of_a_few_points_too(count):
    noise = of_few(count, 600)
    assert noise.source is Source.AT_REST
    np.testing.assert_allclose(noise.sigma, SIGMA, rtol=0.1)
    assert noise.inflation < 1.5


def test_of_too_few_points_and_images_they_tell_none():
    # of a point alone nothing is known beside a camera that moves
    assert of_few(1, 300) is None
    # as many values as a frame needs points, of which each image spends one on its mean
    assert of_few(9, 5) is None
    assert of_few(9, 6) is not None


def test_what_cannot_be_is_refused():
    test = made()
    for count in (0, -1, 15, 99):
        with pytest.raises(InputError, match=r"at rest, of 15 frames; leave some frames"):
            images_at_rest(test, count)
    with pytest.raises(InputError, match=r"10 images .* taken at 0\.3 bar, above .* 0\.2 bar"):
        images_at_rest(made(rest=0.03), 10)
    with pytest.raises(InputError, match="1 image at rest: zero all over"):
        images_at_rest(test, 1)
    (block,) = test.blocks
    frames = [(block.reference + 0.1 * i, block.displacement[i]) for i in range(1, 15)]
    own = BulgeTest.from_frames(frames, test.pressure[1:])
    with pytest.raises(InputError, match="frames have points of their own"):
        images_at_rest(own, 3)


def test_the_command_line(tmp_path, capsys):
    write_test(made(), tmp_path / "t.npz")
    given, out = str(tmp_path / "t.npz"), str(tmp_path / "out.npz")
    assert main(["info", given, "--at-rest", "10"]) == 0
    assert "images at rest  9, noise of dx, dy, dz 0.00" in capsys.readouterr().out
    assert main(["convert", given, out, "--at-rest", "10"]) == 0
    back = read_test(out)
    assert (back.n_frames, len(back.static_displacement)) == (5, 9)
    assert back.history[-1].endswith("--at-rest 10")
    assert main(["info", given, "--at-rest", "15"]) == 2
    assert "t.npz: 15 images at rest, of 15 frames" in capsys.readouterr().err


def test_a_folder_says_it(tmp_path):
    test, rows = made(images=2), []
    for i in range(test.n_frames):
        points, moved = test.frame(i)
        lines = [",".join(f"{v:.6f}" for v in row) for row in np.hstack([points, moved])]
        (tmp_path / f"f{i}.csv").write_text("\n".join(["x,y,z,dx,dy,dz", *lines]) + "\n")
        rows.append(f"f{i}.csv,{10 * test.pressure[i]:.6f}")
    (tmp_path / "pressure.csv").write_text("\n".join(["file,pressure_bar", *rows]) + "\n")
    about = tmp_path / "test.json"
    about.write_text('{"radius": 100, "thickness": 0.81, "at_rest": 3}')
    found = read_test(tmp_path)
    assert (found.n_frames, len(found.static_displacement)) == (5, 2)
    # what is asked for goes before what the folder says
    assert read_test(tmp_path, at_rest=0).static_displacement is None
    about.write_text('{"radius": 100, "thickness": 0.81, "at_rest": 2.5}')
    with pytest.raises(InputError, match=r"at_rest cannot be 2\.5; it must be a whole number"):
        read_test(tmp_path)


def test_an_image_under_pressure_is_no_image_at_rest(tmp_path, capsys):
    test = made()
    assert "static_inflated" not in [a.code for a in alarms(images_at_rest(test, 10))]
    (alarm,) = (a for a in alarms(images_at_rest(test, 11)) if a.code == "static_inflated")
    part = (test.blocks[0].reference[:, :2] ** 2).sum(axis=1).max() / 1e4
    rise = 40 * np.cbrt(0.02) * part  # of which a part lies within the measured points
    assert f"of the 10 images at rest (from 0) 9 shows a dome of {rise:.2g} mm" in alarm.text
    write_test(test, tmp_path / "t.npz")
    out = str(tmp_path / "out.json")
    said = ["--at-rest", "11", "--E", "400", "--json", out]
    assert main(["evaluate", str(tmp_path / "t.npz"), *said]) == 0
    assert "9 shows a dome of" in capsys.readouterr().err


@pytest.mark.parametrize("height", [0.05, 0.2])
def test_a_camera_that_moved_is_no_dome(height):
    apart = images_at_rest(made(), 10)
    x, y = apart.blocks[0].reference[:, :2].T
    still = apart.static_displacement.copy()
    still[3, :, 2] += 1.0 + 0.01 * x - 0.02 * y
    still[5, :, 2] -= height * (1 - (x**2 + y**2) / 1e4)
    moved = dataclasses.replace(apart, static_displacement=still)
    found = [a.text for a in alarms(moved) if a.code == "static_inflated"]
    assert len(found) == (height > 0.1)
    assert all("(from 0) 5 shows a dome of -0.17 mm" in text for text in found)
