"""Does each mend of convert do what it says, and refuse what it cannot do?"""

from __future__ import annotations

import argparse

import numpy as np
import pytest

from bulgefit.cli import convert
from bulgefit.dic import BulgeTest, mend, read_test
from bulgefit.errors import InputError

AWAY = np.array([50.0, 0.0, 0.0])


@pytest.fixture
def spoilt(made, tmp_path):
    """Write the made arrays with some of them changed, and convert them."""

    def write_and_convert(*options, **changes):
        specimen = {"radius": 100.0, "thickness": 0.81, "poisson_ratio": 0.3}
        np.savez(tmp_path / "t.npz", **{**vars(made), **specimen, **changes})
        parser = argparse.ArgumentParser(prog="bulgefit")
        convert.add_arguments(parser)
        target = tmp_path / "o.npz"
        convert.run(parser.parse_args([str(tmp_path / "t.npz"), str(target), *options, "--force"]))
        return read_test(target)

    return write_and_convert


def test_mends_come_before_the_test_is_refused(spoilt, made):
    with pytest.raises(InputError, match="it looks like kPa"):
        spoilt(pressure=made.pressure * 1e3)
    test = spoilt("--unit", "pressure=kPa/MPa", pressure=made.pressure * 1e3)
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-14)
    with pytest.raises(InputError, match="outside the clamp"):
        spoilt(reference=made.reference + AWAY)
    test = spoilt("--shift=-50,0", reference=made.reference + AWAY)
    np.testing.assert_allclose(test.blocks[0].reference, made.reference, atol=1e-12)
    test = spoilt("--unit=reference=um/mm", "--crop", "50", reference=made.reference * 1e3)
    assert np.hypot(*test.blocks[0].reference[:, :2].T).max() <= 50
    # what is mended is checked all the same
    with pytest.raises(InputError, match="outside the clamp"):
        spoilt("--flip", "x", reference=made.reference + AWAY)


@pytest.mark.parametrize("unit", ["N/mm^2/bar", "N/mm^2 / bar"])
def test_several_units_at_once(spoilt, made, unit):
    test = spoilt(
        "--unit",
        f"pressure={unit}",
        "--unit=thickness=um/mm",
        "--unit=radius=in/mm",
        pressure=made.pressure / 10,
        thickness=810.0,
        radius=100 / 25.4,
    )
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-14)
    assert test.thickness == pytest.approx(0.81)
    assert test.radius == pytest.approx(100)


def test_what_was_done_stands_in_the_file(spoilt, tmp_path):
    assert spoilt().history == ()
    options = ["--unit=radius=mm/mm", "--swap-xy", "--flip", "dx,x", "--shift=1,2"]
    test = spoilt(*options, "--level", "--crop", "90", "--rotate=30")
    done = "--unit radius=mm/mm --swap-xy all --flip dx,x --shift 1,2 --level --crop 90 --rotate 30"
    assert test.history == (f"bulgefit convert {tmp_path / 't.npz'}: {done}",)


def test_float32_stays_and_images_at_rest_go_along(made):
    static = np.full((2, *made.reference.shape), 0.01, dtype=np.float32)
    test = BulgeTest.from_arrays(
        made.reference,
        made.displacement.astype(np.float32),
        made.pressure,
        static_displacement=static,
    )
    turned = mend.flipped(mend.swapped(test, "displacement"), ["dz"])
    assert turned.blocks[0].displacement.dtype == np.float32
    np.testing.assert_array_equal(turned.static_displacement[0, 0], static[0, 0] * [1, 1, -1])
    np.testing.assert_array_equal(turned.blocks[0].reference, test.blocks[0].reference)
    grown = mend.in_unit(test, "displacement", "cm", "mm")
    np.testing.assert_array_equal(grown.static_displacement, static * np.float32(10))
    assert grown.blocks[0].displacement.dtype == np.float32


def tilted(points, rotation, height):
    return points @ rotation.T + [0, 0, height]


def test_level_undoes_a_tilt(spoilt, made):
    made.reference[:, 2] = 0
    angle_x, angle_y = np.deg2rad([3.0, -5.0])
    cx, sx, cy, sy = np.cos(angle_x), np.sin(angle_x), np.cos(angle_y), np.sin(angle_y)
    rotation = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]) @ [
        [cy, 0, sy],
        [0, 1, 0],
        [-sy, 0, cy],
    ]
    test = spoilt(
        "--level",
        reference=tilted(made.reference, rotation, 40.0),
        displacement=made.displacement @ rotation.T,
    )
    block = test.blocks[0]
    assert np.abs(block.reference[:, 2]).max() < 1e-10
    # what is left is a turn about z: lengths and heights are those of before
    np.testing.assert_allclose(
        np.linalg.norm(block.reference, axis=1),
        np.linalg.norm(made.reference, axis=1),
        atol=1e-10,
    )
    np.testing.assert_allclose(block.displacement[..., 2], made.displacement[..., 2], atol=1e-10)
    twist = (
        block.reference[:, 0] * made.reference[:, 1]
        - block.reference[:, 1] * (made.reference[:, 0])
    )
    # the shortest way to level leaves but the product of half the tilts: 0.0023 rad
    spin = np.abs(twist / (made.reference**2).sum(axis=1).clip(1))
    assert spin.max() < 1.01 * angle_x * abs(angle_y) / 2


def test_level_is_of_the_rim_alone(made):
    # a dome stays a dome: the plane goes through its foot
    dome = 5 * (1 - (made.reference[:, :2] ** 2).sum(axis=1) / 97**2)
    made.reference[:, 2] = dome + 12
    test = mend.levelled(BulgeTest.from_arrays(**vars(made)))
    ring = np.hypot(*made.reference[:, :2].T) > 90
    assert abs(test.blocks[0].reference[ring, 2].mean()) < 1e-9
    assert test.blocks[0].reference[:, 2].max() == pytest.approx(5 - dome[ring].mean(), abs=1e-6)


def test_what_does_not_tell_is_refused(made):
    test = BulgeTest.from_arrays(**vars(made))
    near = np.hypot(*made.reference[:, :2].T) < 60
    half = made.reference[:, 0] > 0
    for mask in (near, half):
        with pytest.raises(InputError, match=r"needs points all around.*--shift 0,0,DZ"):
            mend.levelled(test.select(points=mask))
    with pytest.raises(InputError, match=r"too few frames or points .* --shift"):
        mend.centred(test.select(frames=[1]), "rim")
    line = np.abs(made.reference[:, 1]) < 1
    with pytest.raises(InputError, match=r"do not tell the apex; .* --shift"):
        mend.centred(test.select(points=line), "apex")
    made.displacement[..., 2] *= -1
    with pytest.raises(InputError, match="the heights have no top"):
        mend.centred(BulgeTest.from_arrays(**vars(made)), "apex")


@pytest.mark.parametrize(
    ("unit", "of_a_bar"),
    [
        ("psi", 14.503774),
        ("hPa", 1000.0),
        ("mmHg", 750.06158),
        ("mmH2O", 10197.162),
        ("inH2O", 401.46309),
    ],
)
def test_units_of_pressure(spoilt, made, unit, of_a_bar):
    test = spoilt(f"--unit=pressure={unit}/bar", pressure=made.pressure * of_a_bar)
    np.testing.assert_allclose(test.pressure, made.pressure, rtol=1e-7)


@pytest.mark.parametrize(
    ("option", "match"),
    [
        ("--unit=pressure", "WHAT=UNIT/TAKEN"),
        ("--unit=force=N/kN", "WHAT one of pressure, reference, displacement"),
        ("--unit=pressure=psi", "pressure=UNIT/TAKEN.*known|pressure=UNIT/TAKEN.*one of MPa"),
        ("--unit=pressure=psi/", "has the unit ''"),
        ("--unit=pressure=psi/torr", "unit 'torr'"),
        ("--unit=radius=psi/mm", "radius=UNIT/TAKEN"),
        ("--flip=", "unknown ''"),
        ("--flip=dx,w", "unknown 'w'; known are x, y, z, dx, dy, dz"),
        ("--shift=1", "X,Y or X,Y,Z"),
        ("--shift=1,nan", "X,Y or X,Y,Z"),
        ("--shift=1,b", "X,Y or X,Y,Z"),
    ],
)
def test_options_that_make_no_sense(spoilt, option, match):
    with pytest.raises(InputError, match=match) as caught:
        spoilt(option)
    assert "\n" not in str(caught.value)


def test_frames_with_points_of_their_own(ragged):
    frames, pressure = ragged
    test = BulgeTest.from_frames(
        frames, pressure, mends=[lambda found: mend.swapped(mend.shifted(found, [1, 2, 0]), "all")]
    )
    for i, (reference, displacement) in enumerate(frames):
        found = test.frame(i)
        np.testing.assert_array_equal(found[0], (reference + np.array([1, 2, 0]))[:, [1, 0, 2]])
        np.testing.assert_array_equal(found[1], displacement[:, [1, 0, 2]])
