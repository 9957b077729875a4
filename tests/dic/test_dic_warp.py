"""Is what is said of the warp's angle kept, turned with the test, and shown?"""

from __future__ import annotations

import json

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, describe, read_test, write_test
from bulgefit.dic.align import along_warp, by_marks
from bulgefit.dic.mend import flipped, swapped
from bulgefit.errors import InputError


def made(angle: float | None = None, stiff: int = 0) -> BulgeTest:
    """Caps on a grid whose points move less along one axis, that of the stiffer yarns."""
    x, y = (g.ravel() for g in np.meshgrid(*[np.linspace(-90, 90, 25)] * 2))
    points = np.column_stack([x, y, 0 * x])[np.hypot(x, y) < 92]
    pressure = np.linspace(0.02, 0.2, 6)
    part = (points[:, 0] ** 2 + points[:, 1] ** 2) / 1e4
    height = 40 * np.cbrt(pressure)
    moved = np.zeros((6, len(points), 3))
    moved[..., 2] = height[:, None] * (1 - part)
    # what an even cap stretches, by half along the stiffer yarns
    moved[..., :2] = (height**2)[:, None, None] * 1e-4 * (points[:, :2] * (1 - part)[:, None])
    moved[..., stiff] *= 0.5
    return BulgeTest.from_arrays(points, moved, pressure, warp_angle=angle)


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("angle", [None, 0.0, 90.0, -37.5])
def test_it_is_written_and_read_back(tmp_path, suffix, angle):
    path = tmp_path / f"t{suffix}"
    write_test(made(angle), path)
    assert read_test(path).warp_angle == angle
    # what is asked for goes before what the file says
    assert read_test(path, warp_angle=12).warp_angle == 12.0


def test_hdf5_may_hold_radians(tmp_path):
    import h5py

    write_test(made(1.0), tmp_path / "t.h5")
    with h5py.File(tmp_path / "t.h5", "r+") as file:
        assert file["warp_angle"].attrs["unit"] == "degree"
        file["warp_angle"][()] = 0.5 * np.pi
        file["warp_angle"].attrs["unit"] = "rad"
    assert read_test(tmp_path / "t.h5").warp_angle == pytest.approx(90.0)


@pytest.mark.parametrize("angle", [np.nan, np.inf])
def test_what_is_no_angle_is_refused(angle):
    with pytest.raises(InputError, match=r"warp_angle .* must be a number of degrees"):
        made(angle)


def test_it_turns_with_the_test():
    assert made(20.0).rotated(30).warp_angle == 50.0
    assert made(170.0).rotated(30).warp_angle == -160.0
    assert made(450.0).warp_angle == 90.0
    assert made().rotated(30).warp_angle is None
    # x comes to run along the warp
    assert along_warp(made(20.0), 20.0).warp_angle is None
    assert by_marks(made(45.0), (0, 0, 1, 1)).warp_angle is None


def test_it_mirrors_with_the_test():
    assert swapped(made(20.0), "all").warp_angle == 70.0
    assert swapped(made(-120.0), "all").warp_angle == -150.0
    assert swapped(made(20.0), "reference").warp_angle == 20.0
    assert flipped(made(20.0), ["x", "dx"]).warp_angle == -20.0
    assert flipped(made(20.0), ["y", "dy", "z", "dz"]).warp_angle == -20.0
    # a turn by half, which lets a yarn lie as it lay, and arrays that contradicted each other
    assert flipped(made(20.0), ["x", "dx", "y", "dy"]).warp_angle == 20.0
    assert flipped(made(20.0), ["dx", "dy"]).warp_angle == 20.0
    assert swapped(made(), "all").warp_angle is None
    assert flipped(made(), ["x", "dx"]).warp_angle is None


def test_the_command_line(tmp_path, capsys):
    write_test(made(), tmp_path / "t.npz")
    given, turned = str(tmp_path / "t.npz"), str(tmp_path / "turned.h5")
    assert main(["info", given]) == 0
    assert "warp            along x; nothing says otherwise" in capsys.readouterr().out
    assert main(["convert", given, turned, "--warp-angle", "90"]) == 0
    assert main(["info", turned, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["warp_angle"] == 90.0
    assert main(["info", turned]) == 0
    assert "warp            at 90 degree to x" in capsys.readouterr().out
    assert main(["info", given, "--warp-angle", "nan"]) == 2
    assert "warp_angle nan must be a number of degrees" in capsys.readouterr().err


def test_a_folder_says_it(tmp_path):
    (tmp_path / "pressure.csv").write_text("file,pressure_bar\na.csv,1\n")
    points, moved = made().frame(5)
    rows = [",".join(f"{v:.6f}" for v in row) for row in np.hstack([points, moved])]
    (tmp_path / "a.csv").write_text("\n".join(["x,y,z,dx,dy,dz", *rows]) + "\n")
    (tmp_path / "test.json").write_text('{"radius": 100, "thickness": 0.81, "warp_angle": 90}')
    assert read_test(tmp_path).warp_angle == 90.0


@pytest.mark.parametrize(
    ("angle", "stiff", "suspect"),
    [(None, 0, False), (None, 1, True), (90.0, 0, True), (90.0, 1, False), (0.0, 1, True)],
)
def test_the_stiffer_yarns_are_looked_for_along_the_warp(angle, stiff, suspect):
    found = {w.code: w for w in describe(made(angle, stiff)).warnings}
    assert ("fill_stiffer_than_warp" in found) == suspect
    if suspect and angle is not None:
        assert "--warp-angle" in found["fill_stiffer_than_warp"].remedy


def test_they_are_not_where_poissons_ratio_is_large(tmp_path):
    """At nu12 of 0.8 the stiffer yarns, along the warp, move more in plane: E1/E2 is 1.3 here."""
    path = str(tmp_path / "wide.npz")
    words = "simulate --E1 303 --E2 229 --G12 30 --nu12 0.8 --pressure 1,2,3 --refine 2 --output"
    assert main([*words.split(), path]) == 0
    told = {w.code for w in describe(read_test(path)).warnings}
    assert "fill_stiffer_than_warp" not in told
    told = {w.code for w in describe(read_test(path, poisson_ratio=0.24)).warnings}
    assert "fill_stiffer_than_warp" in told
