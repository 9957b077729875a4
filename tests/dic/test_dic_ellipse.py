"""Is an elliptic clamp kept, shown, aligned and checked as one?"""

from __future__ import annotations

import json

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, describe, read_test, write_test
from bulgefit.dic.align import centred, outline
from bulgefit.dic.mend import shifted, swapped
from bulgefit.dic.rim import rim_semi_axes
from bulgefit.dic.rim_motion import rim_motions
from bulgefit.errors import InputError

A, B = 120.0, 80.0


def made(shift=(0.0, 0.0), turn=0.0) -> BulgeTest:
    """Bulges of (1 - (x/A)² - (y/B)²) q on a grid, from a tenth off the rim inwards."""
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-A, A, 61), np.linspace(-B, B, 41)))
    part = (x / A) ** 2 + (y / B) ** 2
    x, y, part = x[part < 0.95], y[part < 0.95], part[part < 0.95]
    pressure = np.linspace(0.02, 0.2, 6)
    height = 40 * np.cbrt(pressure)[:, None] * (1 - part) * (1 + 0.2 * part + 1e-3 * x)
    moved = np.zeros((6, len(x), 3))
    moved[..., 2] = height + turn * y * (pressure / pressure.max())[:, None]
    test = BulgeTest.from_arrays(
        np.column_stack([x, y, 0 * x]),
        moved,
        pressure,
        radius=(A + B) / 2,
        ellipticity=(A - B) / (A + B),
        time=np.arange(6.0),
    )
    return shifted(test, np.array([*shift, 0.0]))


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_it_is_written_and_read_back(tmp_path, suffix):
    path = tmp_path / f"t{suffix}"
    write_test(made(), path)
    back = read_test(path)
    assert (back.radius, back.ellipticity) == (100.0, 0.2)
    np.testing.assert_array_equal(back.semi_axes, [A, B])
    # what is asked for goes before what the file says; a radius makes a circle of it
    assert read_test(path, radius=125).ellipticity == 0.0
    assert read_test(path, semi_axes=(130, 90)).ellipticity == pytest.approx(40 / 220)


def test_a_circle_is_written_as_ever(tmp_path):
    round_one = made().cropped(70)
    write_test(BulgeTest.from_arrays(*_arrays(round_one)), tmp_path / "t.npz")
    with np.load(tmp_path / "t.npz") as found:
        assert "ellipticity" not in found
    assert describe(read_test(tmp_path / "t.npz")).semi_axes is None
    same = read_test(tmp_path / "t.npz", semi_axes=(100, 100))
    assert (same.radius, same.ellipticity) == (100.0, 0.0)


def _arrays(test):
    (block,) = test.blocks
    return block.reference, block.displacement, test.pressure


def test_the_command_line(tmp_path, capsys):
    write_test(BulgeTest.from_arrays(*_arrays(made().cropped(78))), tmp_path / "circle.npz")
    oval = tmp_path / "oval.npz"
    axes = ["--semi-axes", "120", "80"]
    assert main(["convert", str(tmp_path / "circle.npz"), str(oval), *axes]) == 0
    capsys.readouterr()
    assert main(["info", str(oval)]) == 0
    assert "clamp semi-axes 120 mm along x, 80 along y" in capsys.readouterr().out
    assert main(["info", str(oval), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["semi_axes"] == [120.0, 80.0]
    config = tmp_path / "run.toml"
    config.write_text("semi-axes = [120, 80]\n")
    circle = str(tmp_path / "circle.npz")
    assert main(["info", circle, "--config", str(config), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["semi_axes"] == [120.0, 80.0]
    assert main(["info", str(oval), *axes, "--radius", "100"]) == 2
    assert "--radius and --semi-axes do not go together" in capsys.readouterr().err
    assert main(["info", str(oval), "--semi-axes", "120", "-80"]) == 2
    assert "--semi-axes 120 -80: give two lengths above 0 mm" in capsys.readouterr().err


def test_points_outside_the_ellipse_are_refused():
    (block,) = made().blocks
    arrays = (block.reference, block.displacement, made().pressure)
    with pytest.raises(
        InputError, match=r"outside the clamp.*semi-axes are 80 and 120 mm; correct"
    ):
        BulgeTest.from_arrays(*arrays, radius=100, ellipticity=-0.2)
    with pytest.raises(InputError, match="ellipticity 1 must lie between -1 and 1"):
        BulgeTest.from_arrays(*arrays, radius=100, ellipticity=1.0)


def test_turning_it():
    test = made()
    np.testing.assert_allclose(test.rotated(90).semi_axes, [B, A])
    np.testing.assert_allclose(test.rotated(-90).semi_axes, [B, A])
    np.testing.assert_allclose(test.rotated(180).semi_axes, [A, B])
    with pytest.raises(InputError, match="lie along x and y, so it turns by 90 degrees, not by 30"):
        test.rotated(30)


def test_its_semi_axes_change_places_with_x_and_y(tmp_path):
    test = made()
    both = swapped(test, "all")
    np.testing.assert_allclose(both.semi_axes, [B, A])
    np.testing.assert_allclose(
        both.on_circle(both.blocks[0].reference[:, :2])[:, ::-1],
        test.on_circle(test.blocks[0].reference[:, :2]),
    )
    for arrays in ("reference", "displacement"):
        np.testing.assert_allclose(swapped(test, arrays).semi_axes, [A, B])
    write_test(test, tmp_path / "t.npz")
    assert main(["convert", str(tmp_path / "t.npz"), str(tmp_path / "s.npz"), "--swap-xy"]) == 0
    np.testing.assert_allclose(read_test(tmp_path / "s.npz").semi_axes, [B, A])


def test_its_field_is_covered_and_nothing_looks_wrong():
    info = describe(made())
    assert info.coverage > 0.9
    assert not [w.code for w in info.warnings if "coverage" in w.code or "centre" in w.code]
    as_circle = BulgeTest.from_arrays(*_arrays(made()), radius=120)
    assert describe(as_circle).coverage < 0.75


def test_alignment_finds_its_centre_and_semi_axes():
    test = made(shift=(2.0, -1.5))
    centre, radius = outline(test)
    np.testing.assert_allclose(centre, [2.0, -1.5], atol=0.2)
    assert radius == pytest.approx(97.5, abs=1)
    laid = centred(test)
    np.testing.assert_allclose(laid.blocks[0].reference, made().blocks[0].reference, atol=0.02)
    # whatever semi-axes were stated, near those that are
    other = BulgeTest.from_arrays(*_arrays(made()), radius=101, ellipticity=0.19)
    found, error = rim_semi_axes(other)
    assert (np.abs(found - [A, B]) < np.maximum(error, 0.1)).all()
    assert error.max() < 3


def test_the_rims_motion_on_an_ellipse():
    rotation, shift = rim_motions(made(turn=1e-3))
    np.testing.assert_allclose(rotation[-1], [1e-3, 0, 0], atol=1e-6)
    np.testing.assert_allclose(shift, 0, atol=1e-6)
