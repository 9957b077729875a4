"""Is a test that was written down wrongly named for what is wrong, and mended by what is said?"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli import convert, info, tests_in
from bulgefit.dic import BulgeTest, describe, read_test
from bulgefit.dic.rim import rim_of
from bulgefit.dic.suspicions import alarms, suspicions
from bulgefit.dic.suspicions.in_plane import in_plane
from bulgefit.dic.suspicions.sizes import implied_stiffness
from bulgefit.fem.mesh import disc
from bulgefit.model.simulation import simulate

DATA = Path(__file__).parents[2] / "data"
PSI = 4.4482216152605 / 25.4**2  # MPa


def arrays_of(test):
    block = test.blocks[0]
    return {
        "reference": block.reference.copy(),
        "displacement": block.displacement.astype(np.float64),
        "static_displacement": test.static_displacement.astype(np.float64),
        "pressure": test.pressure.copy(),
        "radius": test.radius,
        "thickness": test.thickness,
        "poisson_ratio": test.poisson_ratio,
    }


@pytest.fixture(scope="module")
def example():
    return read_test(DATA / "example_bulge.npz")


@pytest.fixture
def arrays(example):
    return arrays_of(example)


def both(key):
    return ("displacement", "static_displacement") if key == "d" else ("reference",)


def swap(arrays, *keys):
    for key in keys:
        arrays[key] = arrays[key][..., [1, 0, 2]]


def sign(arrays, key, *signs):
    for name in both(key):
        arrays[name] = arrays[name] * signs


def positions(arrays):
    for key in both("d"):
        arrays[key] = arrays[key] + arrays["reference"]


def scaled(arrays, key, factor):
    arrays[key] = arrays[key] * factor


#: What went wrong, the code that must name it, and what convert is told to mend it.
ROWS = {
    "deformed positions": (positions, "positions_not_displacements", "--from-positions"),
    "warp and fill swapped in the displacement": (
        lambda a: swap(a, *both("d")),
        "dx_dy_swapped",
        "--swap-xy displacement",
    ),
    "warp and fill swapped in the reference": (
        lambda a: swap(a, "reference"),
        "dx_dy_swapped",
        "--swap-xy reference",
    ),
    "warp and fill swapped in all arrays": (
        lambda a: swap(a, "reference", *both("d")),
        "fill_stiffer_than_warp",
        "--swap-xy",
    ),
    "dx mirrored": (lambda a: sign(a, "d", -1, 1, 1), "dx_mirrored", "--flip dx"),
    "x mirrored": (lambda a: sign(a, "r", -1, 1, 1), "dx_mirrored", "--flip x"),
    "dy mirrored": (lambda a: sign(a, "d", 1, -1, 1), "dy_mirrored", "--flip dy"),
    "displacement turned by 180": (
        lambda a: sign(a, "d", -1, -1, 1),
        "dx_dy_mirrored",
        "--flip dx,dy",
    ),
    "displacement turned by 90": (
        lambda a: (swap(a, *both("d")), sign(a, "d", -1, 1, 1)),
        "dx_dy_turned",
        "--swap-xy displacement --flip dy",
    ),
    "displacement turned by -90": (
        lambda a: (swap(a, *both("d")), sign(a, "d", 1, -1, 1)),
        "dx_dy_turned",
        "--swap-xy displacement --flip dx",
    ),
    "displacement mirrored at a diagonal": (
        lambda a: (swap(a, *both("d")), sign(a, "d", -1, -1, 1)),
        "dx_dy_turned",
        "--swap-xy displacement --flip dx,dy",
    ),
    "z reversed": (
        lambda a: (sign(a, "d", 1, 1, -1), sign(a, "r", 1, 1, -1)),
        "z_reversed",
        "--flip z,dz",
    ),
    "pressures ten times too small": (
        lambda a: scaled(a, "pressure", 0.1),
        "modulus",
        "--unit pressure=MPa/bar",
    ),
    "psi taken for bar": (
        lambda a: scaled(a, "pressure", 0.1 / PSI),
        "pressure_size",
        "--unit pressure=psi/bar",
    ),
    "psi taken for kPa": (
        lambda a: scaled(a, "pressure", 1e-3 / PSI),
        "modulus",
        "--unit pressure=psi/kPa",
    ),
    "thickness ten times too large": (
        lambda a: scaled(a, "thickness", 10),
        "thickness_size",
        "--thickness 0.81",
    ),
    "displacement in metres": (
        lambda a: [scaled(a, key, 1e-3) for key in both("d")],
        "rise_too_small",
        "--unit displacement=m/mm",
    ),
    "displacement in centimetres": (
        lambda a: [scaled(a, key, 0.1) for key in both("d")],
        "stiffness",
        "--unit displacement=cm/mm",
    ),
}


def run(verb, *arguments):
    parser = argparse.ArgumentParser(prog="bulgefit")
    verb.add_arguments(parser)
    return verb.run(parser.parse_args([str(argument) for argument in arguments]))


@pytest.mark.parametrize("row", ROWS)
def test_it_is_named_and_mended(row, arrays, example, tmp_path, capsys):
    spoil, code, mend = ROWS[row]
    spoil(arrays)
    np.savez(tmp_path / "spoilt.npz", **arrays)
    run(info, tmp_path / "spoilt.npz", "--json", "-")
    warnings = json.loads(capsys.readouterr().out)["warnings"]
    found = {entry["code"]: entry for entry in warnings}
    assert code in found
    assert all(entry["text"] and entry["remedy"] for entry in warnings)
    # where two arrays disagree, the remedy speaks of the displacement
    told = (
        mend if mend.startswith(("--from-positions", "--swap-xy displ", "--flip d")) else mend[:6]
    )
    assert told in found[code]["remedy"]
    run(convert, tmp_path / "spoilt.npz", tmp_path / "mended.npz", *shlex.split(mend))
    mended = read_test(tmp_path / "mended.npz")
    assert suspicions(mended) == []
    for key, value in arrays_of(example).items():
        np.testing.assert_allclose(arrays_of(mended)[key], value, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("shift", [(3, 0), (0, -3), (-2.1, 2.1)])
@pytest.mark.parametrize("by", ["rim", "apex"])
def test_a_centre_that_is_off(arrays, tmp_path, shift, by):
    arrays["reference"][:, :2] += shift
    np.savez(tmp_path / "off.npz", **arrays)
    test = read_test(tmp_path / "off.npz")
    (found,) = alarms(test)
    assert found.code == "off_centre"
    assert "--centre rim" in found.remedy
    rim = rim_of(test)
    assert (np.abs(rim.centre - shift) < rim.centre_error).all()
    run(convert, tmp_path / "off.npz", tmp_path / "mended.npz", "--centre", by)
    mended = read_test(tmp_path / "mended.npz")
    assert alarms(mended) == []
    left = mended.blocks[0].reference[:, :2] - arrays["reference"][:, :2] + shift
    np.testing.assert_allclose(left, np.broadcast_to(left[0], left.shape), atol=1e-12)
    assert np.hypot(*left[0]) < 0.15


@pytest.mark.parametrize("radius", [97.5, 100.0, 103.0])
def test_the_radius_that_the_heights_tell(arrays, radius):
    """The heights fall to zero at 100 mm, whatever the file says."""
    arrays["radius"] = radius
    rim = rim_of(BulgeTest.from_arrays(**arrays))
    # the estimate is linear in what is missing
    assert abs(rim.radius - 100) < rim.radius_error + (radius - 100) ** 2 / 100
    assert rim.radius_error < 0.3


def test_a_tilt_and_a_moving_fixture_are_no_centre_that_is_off(arrays):
    x, y = arrays["reference"][:, :2].T
    pressure = arrays["pressure"][:, None]
    # 0.3 degrees of camera, 0.4 degrees a bar of fixture
    arrays["displacement"][..., 2] += np.deg2rad(0.3) * x + np.deg2rad(4.0) * pressure * y
    test = BulgeTest.from_arrays(**arrays)
    assert "off_centre" not in [item.code for item in alarms(test)]


def test_displacement_from_the_first_loaded_frame(arrays):
    arrays["displacement"] -= np.nan_to_num(arrays["displacement"][0])
    (found,) = alarms(BulgeTest.from_arrays(**arrays))
    assert found.code == "zero_under_pressure"
    # the rise of a flat membrane at 0.1 bar of 2.5: 11.4 mm in this one
    assert "at 1 bar" not in found.text
    assert "by about 8.7" in found.text


def test_a_frame_at_rest_or_a_pretension_count_from_rest(arrays, example):
    at_rest = np.concatenate([arrays["static_displacement"][:1], arrays["displacement"]])
    gauge = np.concatenate([[0.0], arrays["pressure"]]) + 0.001  # 0.01 bar too much
    test = BulgeTest.from_arrays(arrays["reference"], at_rest, gauge)
    assert alarms(test) == []
    # a pretension makes the first rises proportional to pressure
    mesh, pressure = disc(100.0, 2), np.linspace(0.01, 0.25, 6)
    points = np.column_stack([mesh.nodes, np.zeros(len(mesh.nodes))])
    bulge = 1 - (mesh.nodes**2).sum(axis=1) / 1e4
    displacement = np.zeros((6, len(points), 3))
    displacement[..., 2] = 0.2 * pressure[:, None] * 100 * bulge
    pretensioned = BulgeTest.from_arrays(points, displacement, pressure, radius=100.001)
    assert "zero_under_pressure" not in [item.code for item in alarms(pretensioned)]


@pytest.mark.parametrize(
    "moduli",
    [
        {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24},
        {"E1": 1000.0, "E2": 200.0, "G12": 30.0, "nu12": 0.24},
        {"E1": 300.0, "E2": 280.0, "G12": 100.0, "nu12": 0.4},
        {"E1": 3000.0, "E2": 2000.0, "G12": 100.0, "nu12": 0.0},
    ],
)
def test_in_plane_motion_of_membranes(moduli):
    """What the theory of a fibre of even strain says, against the membrane's own solution."""
    pressure = np.array([0.01, 0.05, 0.1]) * moduli["E1"] / 300
    made = simulate(moduli, pressure, mesh=disc(100.0, 2))
    points = np.column_stack([made.mesh.nodes, np.zeros(len(made.mesh.nodes))])
    test = BulgeTest.from_arrays(points, made.displacement, pressure, poisson_ratio=moduli["nu12"])
    motion = in_plane(test)
    assert (np.diag(motion.swelling) > 0.9).all()
    assert (np.diag(motion.swelling) < 1.3).all()
    assert abs(motion.swelling[0, 1]) + abs(motion.swelling[1, 0]) < 0.01
    assert np.abs(motion.slope).max() < 0.02
    assert alarms(test) == []
    # the cap's E t against the mean of the moduli
    rise = test.apex_displacement[-1]
    mean = (moduli["E1"] + moduli["E2"]) / 2 * test.thickness
    cap = implied_stiffness(pressure[-1], rise, test.radius, test.poisson_ratio)
    assert 0.6 * mean < cap < 1.1 * mean


def test_a_cap_of_known_stiffness():
    # a tenth of the radius: strain 2/3 (w/a)^2 to second order, tension p a^2 / 4 w
    found = implied_stiffness(0.01, 10.0, 100.0, 0.0)
    assert found == pytest.approx(0.01 * 100**2 / 40 / (2 / 3 * 0.01), rel=0.02)


@pytest.mark.parametrize("name", ["example_bulge", "example_slip"])
def test_what_is_shipped_is_not_suspected(name):
    assert suspicions(read_test(DATA / f"{name}.npz")) == []


@pytest.mark.parametrize("case", [1, 2, 3, 4])
def test_practice_cases_raise_no_alarm(shared, case):
    assert alarms(read_test(shared / "practice" / f"case0{case}.npz")) == []


def test_heights_that_are_next_to_nothing_say_nothing_of_the_axes(arrays):
    """The plane's motion is by far more than such a rise asks for, be the axes what they may."""
    sign(arrays, "d", -1, -1, 1)
    arrays["displacement"][..., 2] *= 1e-6
    arrays["displacement"][0, :, 2] = -0.0
    test = BulgeTest.from_arrays(**arrays)
    codes = {suspicion.code for suspicion in suspicions(test)}
    assert "rise_too_small" in codes
    assert not {code for code in codes if code.startswith(("dx", "dy"))}
    table = info._table(describe(test))
    assert "apex            dz 0 mm at the first frame" in table
    assert "-0 " not in table


def test_a_patch_near_the_centre_says_nothing_of_the_disc(arrays):
    """Of a test in metres, over a clamp in mm: a slope of 1 over a tenth of a mm is no alarm."""
    for key in ("reference", "displacement", "static_displacement"):
        scaled(arrays, key, 1e-3)
    positions(arrays)
    said = {one.code for one in suspicions(BulgeTest.from_arrays(**arrays))}
    assert "near_centre_only" in said
    assert "positions_not_displacements" not in said


@pytest.mark.parametrize("degrees", [1.0, 6.0])
def test_a_reference_that_leans_is_told(example, degrees):
    """Of a test that was left in the cameras' axes; a cloth that hangs askew does not lean."""
    block, angle = example.blocks[0], np.deg2rad(degrees)
    turn = np.array(
        [[np.cos(angle), 0.0, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]]
    )
    flat = {"radius": example.radius, "thickness": example.thickness}
    turned = BulgeTest.from_arrays(
        block.reference @ turn, block.displacement @ turn, example.pressure, **flat
    )
    (said,) = [one for one in alarms(turned) if one.code == "reference_tilted"]
    assert f"leans by {degrees:.2g} degrees" in said.text
    x, y = (block.reference[:, :2] / example.radius).T
    hangs = np.array(block.reference, dtype=float)
    hangs[:, 2] += (1.0 - x * x - y * y) * (3.0 + 1.5 * x - 1.0 * y)
    askew = BulgeTest.from_arrays(hangs, block.displacement, example.pressure, **flat)
    assert "reference_tilted" not in {one.code for one in suspicions(askew)}


def test_a_dome_under_suction_is_told(arrays):
    arrays["pressure"][0] *= -1.0
    (said,) = [s for s in alarms(BulgeTest.from_arrays(**arrays)) if s.code == "dome_under_suction"]
    assert "less than outside, the apex stands at 1" in said.text


def test_positions_that_were_taken_off_twice_are_told(arrays):
    for key in both("d"):
        arrays[key] = arrays[key] - arrays["reference"]
    said = {one.code: one for one in alarms(BulgeTest.from_arrays(**arrays))}
    one = said["positions_not_displacements"]
    assert "the positions were taken off a displacement" in one.text
    assert one.remedy == "convert the export without --from-positions"


def test_single_frames_lines_and_rings_are_not_judged(example):
    block = example.blocks[0]
    r = np.hypot(*block.reference[:, :2].T)
    for points in (np.abs(block.reference[:, 1]) < 4, r > 80, r < 15):
        assert alarms(example.select(points=points)) == []
    alone = example.select(frames=[7])
    assert alarms(alone) == []
    assert [s.text for s in suspicions(alone) if s.code == "few_frames"] == [
        "only 1 frame: little to tell stiffness from other effects"
    ]


def test_fits_are_warned_too(arrays, tmp_path, capsys):
    positions(arrays)
    np.savez(tmp_path / "t.npz", **arrays)
    parser = argparse.ArgumentParser()
    tests_in.add_tests_argument(parser)
    tests_in.add_reader_arguments(parser)
    tests_in.tests_from(parser.parse_args([str(tmp_path / "t.npz")]))
    said = capsys.readouterr().err
    assert "warning: t: dx changes by 1.0" in said or "warning: t: dy changes by 1.0" in said
    assert "convert IN OUT --from-positions" in said


def test_codes_stay_plain_words(arrays):
    scaled(arrays, "pressure", 20)
    found = suspicions(BulgeTest.from_arrays(**arrays))
    assert found
    for item in found:
        assert item.code.replace("_", "").isalpha()
        assert item.code == item.code.lower()
        assert "\n" not in item.text + item.remedy
        assert set(dataclasses.asdict(item)) == {"code", "text", "remedy"}
