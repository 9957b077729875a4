"""Each effect does what it says, by definition and sign: against what can be said without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.places import LEAST_SLIP, Clock, Load
from bulgefit.effects.registry import catalogue
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.model.description import Description, active_effects, describe
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

MODULI = {"E1": 330.0, "E2": 200.0, "G12": 20.0}

#: Followed so closely that paths and single balances agree.
SETUP = Setup(refine=2, tolerance=1e-6, correct_mesh=False)


def of_points(points: np.ndarray, pressure: np.ndarray, setup: Setup = SETUP) -> VirtualTest:
    """The virtual twin of a test that was never made."""
    blank = np.zeros((len(pressure), len(points), 3))
    return VirtualTest(BulgeTest.from_arrays(points, blank, pressure), setup)


@pytest.fixture(scope="module")
def specimen() -> VirtualTest:
    """Points whose heights before inflation are known."""
    rng = np.random.default_rng(3)
    points = rng.uniform(-90, 90, (60, 3)) * [1, 1, 0.01]
    points = points[np.hypot(points[:, 0], points[:, 1]) < 92]
    return of_points(points, np.array([0.02, 0.1, 0.2]))


def reference_of(specimen: VirtualTest) -> np.ndarray:
    """Where the points were seen, (n, 3) mm."""
    return np.asarray(specimen.test.blocks[0].reference)


def centre_of(specimen: VirtualTest) -> int:
    """The point nearest the centre."""
    return int(np.argmin(np.hypot(*reference_of(specimen)[:, :2].T)))


def test_a_clamp_that_does_not_slip_yet_may_begin_to(specimen: VirtualTest) -> None:
    """At the null, which stands for the least compliance of the springs, there is one side."""
    key = "clamp_slip.compliance"
    (exact,) = specimen.predict(MODULI, [key]).derivative
    step = 2e-5
    low, middle, high = (
        specimen.predict({**MODULI, key: LEAST_SLIP + c}).displacement
        for c in (0.0, 0.5 * step, step)
    )
    one_sided = (4.0 * middle - 3.0 * low - high) / step  # of second order
    np.testing.assert_allclose(exact, one_sided, rtol=0.0, atol=2e-3 * np.abs(one_sided).max())


def _change(specimen: VirtualTest, **changed: float) -> np.ndarray:
    """Reported displacement with an effect, minus without it."""
    values = {**MODULI, **{k.replace("__", "."): v for k, v in changed.items()}}
    return specimen.predict(values).displacement - specimen.predict(MODULI).displacement


def test_offset_and_gain_are_recorded_over_true(specimen: VirtualTest) -> None:
    """Recorded pressure reads high: the fabric sees less and rises less."""
    centre = centre_of(specimen)
    assert (_change(specimen, pressure_offset__offset=0.02)[:, centre, 2] < 0).all()
    assert (_change(specimen, pressure_gain__gain=0.02)[:, centre, 2] < 0).all()
    shifted = of_points(reference_of(specimen), (specimen.recorded - 0.002) / 1.03)
    with_effects = specimen.predict(
        {**MODULI, "pressure_offset.offset": 0.02, "pressure_gain.gain": 0.03}
    )
    np.testing.assert_allclose(
        with_effects.displacement, shifted.predict(MODULI).displacement, atol=1e-6
    )


def test_pressure_gain_is_a_gain_of_every_modulus(specimen: VirtualTest) -> None:
    stiffer = {k: 1.04 * v for k, v in MODULI.items()}
    np.testing.assert_allclose(
        specimen.predict({**MODULI, "pressure_gain.gain": 0.04}).displacement,
        specimen.predict(stiffer).displacement,
        atol=2e-5,  # the springs of the clamp that holds are not scaled
    )


def test_rigid_motion_moves_the_frame(specimen: VirtualTest) -> None:
    turn, shift = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.3])
    values = {f"rigid_motion.rotation_{a}": t for a, t in zip("xyz", turn, strict=True)}
    values |= {f"rigid_motion.shift_{a}": s for a, s in zip("xyz", shift, strict=True)}
    plain = specimen.predict(MODULI).displacement
    rotation = Rotation.from_rotvec(turn, degrees=True)
    place = reference_of(specimen)
    expected = np.stack([rotation.apply(place + u) + shift - place for u in plain])
    found = specimen.predict({**MODULI, **values}).displacement
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_fixture_moves_with_the_true_pressure(specimen: VirtualTest) -> None:
    load = {**MODULI, "pressure_offset.offset": 0.02, "pressure_gain.gain": 0.03}
    moved = specimen.predict({**load, "fixture_motion.shift_x": 0.1}).displacement
    found = moved - specimen.predict(load).displacement
    expected = 0.1 * (10.0 * specimen.recorded - 0.02) / 1.03
    np.testing.assert_allclose(
        found[..., 0], np.broadcast_to(expected[:, None], found.shape[:2]), atol=1e-12
    )


def test_a_fixture_whose_screws_stiffen_moves_less_and_less(specimen: VirtualTest) -> None:
    moved = _change(specimen, fixture_motion__shift_x=0.1, fixture_motion__shape=0.5)
    bar = 10.0 * specimen.recorded
    expected = 0.1 * (1.0 - np.exp(-0.5 * bar)) / 0.5
    np.testing.assert_allclose(
        moved[..., 0], np.broadcast_to(expected[:, None], moved.shape[:2]), atol=1e-12
    )


def test_what_begins_to_be_concave_is_told_as_such(specimen: VirtualTest) -> None:
    """By a difference about a motion that is straight: (1 - exp(-s p))/s is p - s p²/2."""
    values = {"E1": 300.0, "E2": 200.0, "G12": 20.0, "fixture_motion.shift_x": 0.1}
    (slope,) = specimen.predict(values, ["fixture_motion.shape"]).derivative[..., 0]
    expected = -0.05 * (10.0 * specimen.recorded) ** 2
    np.testing.assert_allclose(slope, np.broadcast_to(expected[:, None], slope.shape), rtol=1e-6)


def test_reference_state_is_taken_off(specimen: VirtualTest) -> None:
    x = reference_of(specimen)[:, 0] / 100.0
    found = _change(specimen, reference_state__z10=0.5)
    np.testing.assert_allclose(found[..., 2], np.broadcast_to(-0.5 * x, found.shape[:2]), atol=1e-9)


def test_pressure_flattens_the_reference_state(specimen: VirtualTest) -> None:
    """Half of it is gone at the flattening pressure."""
    whole = _change(specimen, reference_state__z10=0.5)
    part = _change(specimen, reference_state__z10=0.5, reference_state__flattening=0.2)
    share = np.array([1 / 2, 5 / 6, 10 / 11])  # at 0.2, 1 and 2 bar
    np.testing.assert_allclose(part, share[:, None, None] * whole, atol=1e-9)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_slack_raises_and_pretension_lowers_the_dome(specimen: VirtualTest, axis: str) -> None:
    centre, name = centre_of(specimen), f"prestrain__slack_{axis}"
    slack, tense = (_change(specimen, **{name: value}) for value in (0.002, -0.002))
    assert (slack[:, centre, 2] > 0).all()
    assert (tense[:, centre, 2] < 0).all()


def test_slip_moves_the_rim_inwards_by_compliance_times_traction() -> None:
    specimen = of_points(np.zeros((1, 3)), np.array([0.2]))
    values = {**MODULI, "nu12": 0.24, "clamp_slip.compliance": 0.02}
    shapes = specimen.shapes(values)
    given = described(specimen, values)
    membrane = specimen.inflation.membrane(given)
    assert membrane.clamp is not None
    rim, radial = membrane.mesh.rim, membrane.clamp.radial
    moved = (shapes.displacement[0, rim, :2] * radial).sum(axis=1)
    held = membrane.clamp.length  # mm of rim a node stands for
    membrane.clamp.stiffness[:] = 0.0  # the fabric's pull alone
    stiffness = orthotropic_stiffness(330.0, 200.0, 20.0, 0.24)
    pull = membrane.state(shapes.displacement[0], 0.2, stiffness, tangent=False).reaction
    traction = (pull[rim, :2] * radial).sum(axis=1) / held
    assert traction.min() > 0
    np.testing.assert_allclose(moved, -0.02 * traction, rtol=1e-5)


def described(specimen: VirtualTest, values: dict[str, float]) -> Description:
    """Specimen, clamp and load that the values describe."""
    active = active_effects(values, specimen.nulls())
    return describe(specimen.mesh, specimen.test.radius, specimen.recorded, None, values, active)


def rim_of(specimen: VirtualTest, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Radius (mm) of the rim's nodes, and their angle (rad) from x."""
    surface = described(specimen, {**MODULI, "nu12": 0.24, **values}).fabric.surface
    assert surface is not None
    x, y, _ = surface[specimen.mesh.rim].T
    return np.hypot(x, y), np.arctan2(y, x)


def at_angle(radius: np.ndarray, angle: np.ndarray, degree: float) -> float:
    """Radius of the rim's node at an angle."""
    turn = np.angle(np.exp(1j * (angle - np.deg2rad(degree))))
    node = int(np.argmin(np.abs(turn)))
    assert abs(turn[node]) < 1e-6
    return float(radius[node])


def test_oval_clamp_is_longer_along_x(specimen: VirtualTest) -> None:
    radius, angle = rim_of(specimen, {"clamp_shape.ellipticity": 0.01})
    assert at_angle(radius, angle, 0.0) == pytest.approx(101.0, rel=1e-12)
    assert at_angle(radius, angle, 90.0) == pytest.approx(99.0, rel=1e-12)
    radius, _ = rim_of(specimen, {"clamp_shape.radius_error": 0.02})
    np.testing.assert_allclose(radius, 102.0, rtol=1e-12)


def test_lobes_lie_where_the_cosine_and_the_sine_of_three_angles_do(specimen: VirtualTest) -> None:
    radius, angle = rim_of(specimen, {"clamp_lobes.c3": 0.01})
    for degree, expected in ((0.0, 101.0), (60.0, 99.0), (120.0, 101.0), (180.0, 99.0)):
        assert at_angle(radius, angle, degree) == pytest.approx(expected, rel=1e-12)
    radius, angle = rim_of(specimen, {"clamp_lobes.s3": 0.01})
    for degree, expected in ((0.0, 100.0), (30.0, 101.0), (90.0, 99.0)):
        assert at_angle(radius, angle, degree) == pytest.approx(expected, rel=1e-12)


def test_points_near_a_lobe_stand_on_the_same_fabric_as_further_in(specimen: VirtualTest) -> None:
    """A point at 90 mm of a rim at 101 mm rises as the disc does that is as much smaller."""
    points = np.array([[90.0, 0.0, 0.0], [0.0, 90.0, 0.0]])
    lobes = of_points(points, np.array([0.1]))
    rise = lobes.predict({**MODULI, "clamp_lobes.c3": 0.01}).displacement[0, :, 2]
    plain = lobes.predict(MODULI).displacement[0, :, 2]
    assert rise[0] > plain[0]  # the rim is further off
    assert rise[1] == pytest.approx(plain[1], rel=0.02)  # cos 270° = 0


def test_a_lens_moves_points_by_the_cube_of_their_distance(specimen: VirtualTest) -> None:
    """Seen at p (1 + k1 p²/a²) before and after; the fabric below is at the undone place."""
    k1 = 0.01
    found = specimen.predict({**MODULI, "lens_distortion.k1": k1}).displacement
    seen = reference_of(specimen)[:, :2]
    # undone by Newton's method in the distance, apart from the effect's own way
    distance = np.hypot(*seen.T)
    true = distance.copy()
    for _ in range(20):
        true -= (true * (1 + k1 * true**2 / 1e4) - distance) / (1 + 3 * k1 * true**2 / 1e4)
    place = seen * (true / distance)[:, None]
    points = np.column_stack([place, reference_of(specimen)[:, 2]])
    straight = of_points(points, specimen.recorded).predict(MODULI).displacement
    after = place + straight[..., :2]
    bent = after * (1 + k1 * (after**2).sum(axis=-1, keepdims=True) / 1e4)
    np.testing.assert_allclose(found[..., :2], bent - seen, atol=1e-9)
    np.testing.assert_allclose(found[..., 2], straight[..., 2], atol=1e-9)
    assert (true < distance).all()  # what is seen too far out lies further in


def test_depth_scale_is_of_heights_alone(specimen: VirtualTest) -> None:
    plain = specimen.predict(MODULI).displacement
    found = specimen.predict({**MODULI, "depth_scale.scale_z": 0.02}).displacement
    np.testing.assert_allclose(found, plain * [1.0, 1.0, 1.02], atol=1e-12)


def test_the_seen_face_moves_with_its_normal(specimen: VirtualTest) -> None:
    """Along the normal of what the middle does about each point; before inflation it is flat."""
    at, step = reference_of(specimen)[:, :2], 1.0
    around = [at + step * np.array(d) for d in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    points = np.column_stack([np.concatenate([at, *around]), np.zeros(5 * len(at))])
    many = of_points(points, specimen.recorded, replace(SETUP, refine=4))
    moved = many.predict(MODULI).displacement
    _, east, west, north, south = np.split(points + moved, 5, axis=1)
    normal = np.cross(east - west, north - south)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    share, here = 0.4, slice(len(at))
    found = many.predict({**MODULI, "surface_offset.share": share}).displacement
    expected = share * specimen.test.thickness * (normal - [0.0, 0.0, 1.0])
    np.testing.assert_allclose(found[:, here] - moved[:, here], expected, atol=5e-4)
    # a cloth that bulges towards the cameras: its face goes outwards, and comes less far
    change = found[:, here] - moved[:, here]
    outwards = (change[..., :2] * at).sum(axis=-1) / np.hypot(*at.T)
    assert (outwards[:, np.hypot(*at.T) > 20.0] > 0.0).all()
    assert outwards.max() > 0.1
    assert (change[..., 2] < 0.0).all()


def test_dic_scale_is_of_places_too(specimen: VirtualTest) -> None:
    found = specimen.predict({**MODULI, "dic_scale.scale": 0.02}).displacement
    smaller = of_points(reference_of(specimen) / 1.02, specimen.recorded)
    np.testing.assert_allclose(found, 1.02 * smaller.predict(MODULI).displacement, atol=1e-9)


def test_a_turned_frame_turns_displacements_and_moves_nothing(specimen: VirtualTest) -> None:
    turn = np.array([0.5, -0.7, 1.1])
    names = (f"frame_misalignment.rotation_{axis}" for axis in "xyz")
    values = dict(zip(names, turn, strict=True))
    plain = specimen.predict(MODULI).displacement
    found = specimen.predict({**MODULI, **values}).displacement
    rotation = Rotation.from_rotvec(turn, degrees=True)
    np.testing.assert_allclose(found, np.stack([rotation.apply(u) for u in plain]), atol=1e-12)
    # counter-clockwise about z: what moved along +x is reported to move along +y as well
    quarter = specimen.predict({**MODULI, "frame_misalignment.rotation_z": 90.0}).displacement
    np.testing.assert_allclose(quarter[..., 1], plain[..., 0], atol=1e-12)


def test_the_rim_lifts_on_its_side_by_the_amplitude_a_bar(specimen: VirtualTest) -> None:
    """Height of the rim's nodes: amplitude x bar x cos(φ - direction) where that is positive."""
    values = {"rim_lift.amplitude": 0.2, "rim_lift.direction": 30.0}
    shapes = specimen.shapes({**MODULI, **values})
    rim = specimen.mesh.rim
    angle = np.arctan2(*specimen.mesh.nodes[rim].T[::-1])
    side = np.maximum(np.cos(angle - np.pi / 6), 0.0)
    for frame, bar in enumerate((0.2, 1.0, 2.0)):
        np.testing.assert_allclose(shapes.displacement[frame, rim, 2], 0.2 * bar * side, atol=1e-12)
        np.testing.assert_allclose(shapes.displacement[frame, rim, :2], 0.0, atol=1e-12)
    # concave in pressure: (1 - exp(-s p))/sp of what it were
    bent = specimen.shapes({**MODULI, **values, "rim_lift.shape": 0.5})
    share = bent.displacement[:, rim, 2].max(axis=1) / shapes.displacement[:, rim, 2].max(axis=1)
    bar = np.array([0.2, 1.0, 2.0])
    np.testing.assert_allclose(share, (1.0 - np.exp(-0.5 * bar)) / (0.5 * bar), rtol=1e-12)


def test_the_centre_of_the_clamp_lies_at_the_registration(specimen: VirtualTest) -> None:
    """Points that were seen a centre further are the same ones."""
    centre = {"registration.x0": 2.0, "registration.y0": -1.0}
    points = reference_of(specimen) * 0.9
    shifted = of_points(points + np.array([2.0, -1.0, 0.0]), specimen.recorded)
    plain = of_points(points, specimen.recorded).predict(MODULI).displacement
    np.testing.assert_allclose(shifted.predict({**MODULI, **centre}).displacement, plain, atol=1e-9)


def test_stiffness_falls_by_the_decade_of_frame_intervals() -> None:
    """By hand: frames every ten seconds, and one a decade and more later."""
    pressure, time = np.array([0.1, 0.2, 0.2, 0.2]), np.array([5.0, 15.0, 25.0, 995.0])
    expected = 1.0 - 0.05 * np.array([0.0, np.log10(2.0), np.log10(3.0), 2.0])
    # also where some of the frames alone are looked at
    for some in (slice(None), slice(1, None, 2)):
        load = Load(pressure[some], Clock(time[some], time), pressure[some])
        softened = catalogue()["creep"].load({"rate": 0.05}, load).softening
        np.testing.assert_allclose(softened, expected[some], rtol=1e-12)


def test_what_goes_by_time_is_that_of_all_frames(specimen: VirtualTest) -> None:
    """Some of the frames alone are predicted as they are among the others."""
    count = len(specimen.recorded)
    test = replace(specimen.test, time=30.0 * np.arange(count) ** 1.5)
    values = {**MODULI, "creep.rate": 0.1, "slow_slip_field.c0_1": 0.2, "drift_field.z00_1": 0.3}
    whole = VirtualTest(test, specimen.setup).predict(values).displacement
    for name in ("creep.rate", "slow_slip_field.c0_1", "drift_field.z00_1"):
        without = VirtualTest(test, specimen.setup).predict({**values, name: 0.0}).displacement
        assert np.abs(whole - without)[-1].max() > 0.05
    for some in (np.arange(1, count), np.arange(count - 1)):
        part = VirtualTest(test.select(frames=some), specimen.setup).predict(values).displacement
        np.testing.assert_allclose(part, whole[some], atol=1e-6)


def test_factors_of_a_specimen_are_of_warp_and_fill(specimen: VirtualTest) -> None:
    """The same as the moduli that they multiply."""
    values = {"specimen_factor.warp": 1.1, "specimen_factor.fill": 0.9}
    found = specimen.predict({**MODULI, **values}).displacement
    same = {"E1": 1.1 * MODULI["E1"], "E2": 0.9 * MODULI["E2"], "G12": MODULI["G12"]}
    np.testing.assert_allclose(found, specimen.predict(same).displacement, atol=1e-10)


@pytest.mark.parametrize(("name", "axis"), [("g_x", 0), ("g_y", 1)])
def test_stiffness_grows_along_its_gradient(name: str, axis: int, specimen: VirtualTest) -> None:
    """The stiffer half stretches less, so points in the middle move towards it."""
    moved = _change(specimen, **{f"stiffness_gradient__{name}": 0.2})
    assert (moved[:, centre_of(specimen), axis] > 0.0).all()


@pytest.mark.parametrize("name", ["amplitude", "direction", "shape"])
def test_the_lifted_rim_lifts_the_fabric(name: str, specimen: VirtualTest) -> None:
    """Derivatives by differences; where the rim slips too, follower pressure is not conservative

    and they agree to a thousandth alone (see the contract).
    """
    values = {"rim_lift.amplitude": 0.1, "rim_lift.direction": 30.0, "rim_lift.shape": 0.3}
    here, key = {**MODULI, **values}, f"rim_lift.{name}"
    (exact,) = specimen.predict(here, [key]).derivative
    near = specimen.shapes(here)
    low, high = (
        specimen.predict({**here, key: values[key] + h}, near=near).displacement
        for h in (-1e-3, 1e-3)
    )
    difference = (high - low) / 2e-3
    np.testing.assert_allclose(exact, difference, rtol=0.0, atol=1e-5 * np.abs(difference).max())


def test_axes_turn_counter_clockwise(specimen: VirtualTest) -> None:
    """Turned by 90°, warp lies along y: the moduli change places."""
    turned = specimen.predict({**MODULI, "axis_misalignment.angle": 90.0})
    swapped = specimen.predict(
        {"E1": 200.0, "E2": 330.0, "G12": 20.0, "poisson_ratio.nu12": 0.24 * 200 / 330}
    )
    np.testing.assert_allclose(turned.displacement, swapped.displacement, atol=1e-6)
    # turned by less, the fabric is the one whose points are turned back, but for the mesh
    turn = Rotation.from_euler("z", 20.0, degrees=True)
    back = of_points(turn.inv().apply(reference_of(specimen).copy()), specimen.recorded)
    expected = turn.apply(back.predict(MODULI).displacement.reshape(-1, 3))
    there, elsewhere = (
        specimen.predict({**MODULI, "axis_misalignment.angle": angle}).displacement.reshape(-1, 3)
        for angle in (20.0, -20.0)
    )
    missed, other = (np.abs(found - expected).max() for found in (there, elsewhere))
    assert missed < 0.25 * other


def test_heights_before_inflation_are_those_of_the_modes() -> None:
    """In polar coordinates, each mode by itself."""
    shape = catalogue()["initial_shape"]
    rng = np.random.default_rng(5)
    r, angle = rng.uniform(0.0, 1.0, 20), rng.uniform(0.0, 2.0 * np.pi, 20)
    unit = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    modes = {"h0": np.ones(20), "hx": r * np.cos(angle), "hy": r * np.sin(angle), "h2": r**2}
    for order in range(2, 7):
        modes[f"c{order}"] = r**order * np.cos(order * angle)
        modes[f"s{order}"] = r**order * np.sin(order * angle)
    assert set(modes) == {p.name for p in shape.parameters}
    for name, mode in modes.items():
        own = {p.name: 0.7 if p.name == name else 0.0 for p in shape.parameters}
        expected = 0.7 * (1.0 - r**2) * mode
        np.testing.assert_allclose(shape.height(own, unit), expected, atol=1e-14)
