"""Has every effect of a made test the sign and the size that it is said to have?"""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.trial.accuracy import moduli_errors
from bulgefit.trial.camera import Setting, material_points
from bulgefit.trial.cloth import evenness, laminate, moduli_about, stiffness
from bulgefit.trial.draw import Draw, Wave
from bulgefit.trial.fabric import balance
from bulgefit.trial.gauge import recorded_load, true_load
from bulgefit.trial.hexagon import hexagon
from bulgefit.trial.noise import noise
from bulgefit.trial.rim import course_of, positions
from bulgefit.trial.signature import noise_free

MODULI = {"E1": 330.0, "E2": 200.0, "G12": 16.0}


@pytest.fixture(scope="module")
def setting():
    x = np.linspace(-80, 80, 9)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    points = points[np.hypot(*points.T) < 92]
    return Setting(points, np.array([0.02, 0.1, 0.2]), np.array([0.0, 10.0, 20.0]))


def drawn(**parameters: float) -> Draw:
    """A draw with parameters given as effect__name."""
    named = {k.replace("__", "."): v for k, v in parameters.items()}
    return Draw(tuple({k.split(".")[0]: 0 for k in named}), named, (), MODULI)


def seen(setting, **parameters):
    return noise_free(drawn(**parameters), setting, 8)[1]


@pytest.fixture(scope="module")
def plain(setting):
    return seen(setting)


def test_mesh_error_is_far_below_the_noise(setting, plain):
    # 0.019 mm at 8, falling with the third power: 0.0025 at 16, 0.0009 at 24, a tenth of the noise
    finer = noise_free(drawn(), setting, 16)[1]
    assert np.abs(plain - finer).max() < 0.025


@pytest.mark.parametrize("case", ["case02.npz", "case03.npz", "case04.npz"])
def test_agrees_with_tests_that_others_made(shared, case):
    """Made tests with their truth, by a code and a mesh that are not ours."""
    folder = shared / "practice"
    if not folder.is_dir():
        pytest.skip("no made tests of others (../shared/practice) on this machine")
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))[case]
    with np.load(folder / case) as data:
        reference, measured, pressure = (data[k] for k in ("reference", "displacement", "pressure"))
    # slack fabric is wrinkled at light pressures, and its shape is then the mesh's
    kept = slice(4, None, 5)
    place = Setting(reference[:, :2], pressure[kept], np.arange(len(pressure[kept]), dtype=float))
    fabric = _of_others(truth)
    difference = measured[kept] - noise_free(fabric, place, 16)[1]
    size = np.array(truth["noise_mm"])[[0, 0, 1]]
    spread = np.sqrt(np.nanmean(difference**2, axis=(0, 1)))
    np.testing.assert_allclose(spread, size, rtol=0.06)
    assert (np.abs(np.nanmean(difference, axis=(0, 1))) < 0.2 * size).all()


def test_noise_is_that_of_tests_that_others_made(shared):
    """Size and correlation of images at rest: a length of 12 mm, the longest that is drawn."""
    folder = shared / "practice"
    if not folder.is_dir():
        pytest.skip("no made tests of others (../shared/practice) on this machine")
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    theirs, ours, sizes = [], [], []
    for number, case in enumerate(sorted(truth)):
        with np.load(folder / case) as data:
            points, static = data["reference"][:, :2], data["static_displacement"]
        size = np.array(truth[case]["noise_mm"])
        rng = np.random.default_rng(number)
        own = noise(rng, points, len(static), (float(size[0]), float(size[1])), 12.0)
        sizes.append(static.std(axis=(0, 1)) / size[[0, 0, 1]])
        for kept, images in ((theirs, static), (ours, own)):
            kept.append(_correlations(points, images / size[[0, 0, 1]]))
    np.testing.assert_allclose(np.mean(sizes), 1.0, atol=0.03)
    # some 6,000 points in patches of fifteen, in four images: standard errors of 0.02
    np.testing.assert_allclose(np.mean(theirs, axis=0), np.mean(ours, axis=0), atol=0.06)


def _correlations(points, images):
    """Mean product of the noise of points 3 to 6, 6 to 9, 9 to 13 and 20 to 40 mm apart."""
    apart = cdist(points, points)
    together = np.einsum("fnc,fmc->nm", images, images) / (len(images) * 3)
    bands = ((3, 6), (6, 9), (9, 13), (20, 40))
    return [together[(apart > low) & (apart < high)].mean() for low, high in bands]


def _of_others(truth):
    named = {}
    for key, value in truth["parameters"].items():
        if isinstance(value, list):
            kind = key.split("_")[0]
            named |= {f"{kind}_{a}": v for a, v in zip("xyz", value, strict=True)}
        else:
            named["compliance" if key.startswith("compliance") else key] = value
    effect = truth["effect"]
    moduli = {k: truth[k] for k in MODULI}
    return Draw((effect,), {f"{effect}.{k}": v for k, v in named.items()}, (), moduli)


# signs and definitions


def test_load_is_recorded_times_and_plus():
    fabric = drawn(pressure_offset__offset=0.04, pressure_gain__gain=0.02)
    true = np.array([0.05, 0.2])
    np.testing.assert_allclose(true_load(fabric, true * 1.02 + 0.004), true)


def test_creep_falls_by_rate_per_decade():
    time = 3.0 + 10.0 * np.arange(10)
    soft = course_of(drawn(creep__rate=0.05), np.linspace(0.01, 0.2, 10), time).soft
    assert soft[0] == 1.0
    assert soft[9] == pytest.approx(0.95)


def test_creep_is_a_higher_pressure_where_all_that_resists_creeps(setting):
    soft = course_of(drawn(creep__rate=0.1), setting.pressure, setting.time).soft
    higher = Setting(setting.reference, setting.pressure / soft, setting.time)
    creeping = seen(setting, creep__rate=0.1)
    np.testing.assert_allclose(creeping, seen(higher), atol=2e-3)


def test_rigid_motion_turns_positions_and_shifts(setting, plain):
    moved = seen(setting, rigid_motion__rotation_z=0.5, rigid_motion__shift_x=0.3)
    x = np.column_stack([setting.reference, np.zeros(len(setting.reference))])
    angle = np.deg2rad(0.5)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    expected = (x + plain) @ turn.T + [0.3, 0, 0] - x
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def test_fixture_motion_grows_with_pressure(setting, plain):
    moved = seen(setting, fixture_motion__shift_z=0.1)
    expected = 0.1 * 10.0 * setting.pressure[:, None] * np.ones(plain.shape[1])
    np.testing.assert_allclose((moved - plain)[..., 2], expected, atol=1e-9)


def test_fixture_motion_grows_less_and_less(setting, plain):
    moved = seen(setting, fixture_motion__shift_z=0.1, fixture_motion__shape=0.4)
    rise = 0.1 * (1.0 - np.exp(-0.4 * 10.0 * setting.pressure)) / 0.4
    expected = rise[:, None] * np.ones(plain.shape[1])
    np.testing.assert_allclose((moved - plain)[..., 2], expected, atol=1e-9)


def test_reference_state_is_taken_off(setting, plain):
    fabric = Draw(("reference_state",), {}, (Wave(2, 0.5, 0.01, 0.0, 0.3),), MODULI)
    height, moved = noise_free(fabric, setting, 8)
    wave = 0.5 * np.cos(0.01 * setting.reference[:, 0] + 0.3)
    np.testing.assert_allclose(plain[..., 2] - moved[..., 2], wave + 0 * moved[..., 2], atol=1e-9)
    np.testing.assert_allclose(height, wave, atol=1e-9)


def test_pressure_flattens_the_reference_state(setting, plain):
    named = {"reference_state.flattening": 0.2}
    fabric = Draw(("reference_state",), named, (Wave(2, 0.5, 0.01, 0.0, 0.3),), MODULI)
    height, moved = noise_free(fabric, setting, 8)
    wave = 0.5 * np.cos(0.01 * setting.reference[:, 0] + 0.3)
    share = np.array([1 / 2, 5 / 6, 10 / 11])  # at 0.2, 1 and 2 bar
    np.testing.assert_allclose((plain - moved)[..., 2], np.outer(share, wave), atol=1e-9)
    np.testing.assert_allclose(height, wave, atol=1e-9)


def test_a_knee_softens_along_its_yarns(setting, plain):
    """Beyond it along warp the fabric gives way by the same as with a smaller modulus there."""
    kneed = {"nonlinear_material__s_x": -0.5, "nonlinear_material__knee_x": 1e-5}
    softer = Draw((), {}, (), {**MODULI, "E1": 165.0, "E2": 200.0})
    # far beyond its knee the slope is (1 + s) E; Poisson's coupling stays that of E
    difference = seen(setting, **kneed) - noise_free(softer, setting, 8)[1]
    change = np.abs(noise_free(softer, setting, 8)[1] - plain).max()
    assert np.abs(difference).max() < 0.1 * change


def test_points_that_are_shifted_and_scaled(setting):
    fabric = drawn(registration__x0=2.0, dic_scale__scale=0.01)
    points = material_points(fabric, setting)
    np.testing.assert_allclose(1.01 * (points + np.array([2.0, 0.0])), setting.reference)


def test_lens_shows_outer_points_farther_out(setting):
    fabric = drawn(lens_distortion__k1=0.01)
    points = material_points(fabric, setting)
    square = (points**2).sum(axis=1, keepdims=True) / 100.0**2
    np.testing.assert_allclose(points * (1 + 0.01 * square), setting.reference)


def test_drift_goes_with_time(setting, plain):
    late = Setting(setting.reference, setting.pressure, np.array([0.0, 80.0, 100.0]))
    moved = seen(late, camera_drift__shift_y=1.0)
    np.testing.assert_allclose((moved - plain)[..., 1].mean(axis=1), [0, 0.8, 1.0], atol=1e-9)


def test_slip_lets_the_rim_in_and_a_sector_only_there(setting, plain):
    whole = seen(setting, clamp_slip__compliance=0.02)[-1] - plain[-1]
    part = seen(
        setting,
        slipping_sector__compliance=0.02,
        slipping_sector__middle=0.0,
        slipping_sector__half_width=40.0,
    )
    part = part[-1] - plain[-1]
    angle = np.rad2deg(np.arctan2(*setting.reference.T[::-1]))
    outer = np.hypot(*setting.reference.T) > 75
    there, behind = outer & (np.abs(angle) < 15), outer & (np.abs(angle) > 165)
    assert whole[there, 0].mean() < -0.05
    assert whole[behind, 0].mean() > 0.05
    assert part[there, 0].mean() < -0.03
    # pulled along, not let in
    assert part[behind, 0].mean() < 0.0


def test_shape_of_rim_and_fabric():
    unit = hexagon(8)
    at = unit.nodes[unit.rim]
    rim = positions(drawn(clamp_shape__ellipticity=0.01), at, 100.0)
    np.testing.assert_allclose([rim[:, 0].max(), rim[:, 1].max()], [101.0, 99.0], atol=0.5)
    lobed = positions(drawn(clamp_lobes__c3=0.01, clamp_lobes__s3=-0.004), at, 100.0)
    phi = np.arctan2(at[:, 1], at[:, 0])
    radius = 100 * (1 + 0.01 * np.cos(3 * phi) - 0.004 * np.sin(3 * phi))
    np.testing.assert_allclose(np.hypot(*lobed[:, :2].T), radius)
    domed = positions(drawn(initial_shape__h0=2.0), np.zeros((1, 2)), 100.0)
    np.testing.assert_allclose(domed, [[0, 0, 2.0]])


def test_thickness_grades_and_dips():
    mesh = hexagon(16)
    even = evenness(drawn(stiffness_gradient__g_x=0.2), mesh, 100.0)
    assert even.max() == pytest.approx(1.2, abs=0.02)
    fabric = drawn(soft_patch__drop=0.4, soft_patch__width=20.0, soft_patch__x=30.0)
    patch = evenness(fabric, mesh, 100.0)
    assert patch.min() == pytest.approx(0.6, abs=0.02)
    assert patch.max() == pytest.approx(1.0, abs=1e-3)


def test_lens_distorts_before_inflation_and_after(setting, plain):
    """D(X + u) - D(X), D(p) = p (1 + k1 |p|²/a²), of points X that are seen at D(X)."""

    def shown(points):
        return points * (1 - 0.012 * (points**2).sum(axis=-1, keepdims=True) / 100.0**2)

    x = setting.reference
    distorted = Setting(shown(x), setting.pressure, setting.time)
    moved = seen(distorted, lens_distortion__k1=-0.012)
    np.testing.assert_allclose(moved[..., :2], shown(x + plain[..., :2]) - shown(x), atol=1e-8)
    np.testing.assert_allclose(moved[..., 2], plain[..., 2], atol=1e-8)


def test_depth_scale_stretches_heights_alone(setting):
    shape = {"initial_shape__h0": 2.0}
    height, moved = noise_free(drawn(**shape), setting, 8)
    scaled_height, scaled = noise_free(drawn(depth_scale__scale_z=0.01, **shape), setting, 8)
    np.testing.assert_allclose(scaled_height, 1.01 * height, rtol=1e-12)
    np.testing.assert_allclose(scaled, moved * [1.0, 1.0, 1.01], rtol=1e-12)


@pytest.mark.parametrize("dome", [0.0, 6.0])
def test_the_seen_face_stands_off_the_fabric(setting, dome):
    """By half its thickness along the normal, which is found here from points a little apart.

    Before inflation it is seen beside the fabric that it stands on, where that is a dome.
    """
    shape = {"initial_shape__h0": dome}
    high, moved = noise_free(drawn(surface_offset__share=0.5, **shape), setting, 16)

    def upright(points):
        slope = np.column_stack([2.0 * dome * points / 100.0**2, np.ones(len(points))])
        return 0.405 * slope / np.linalg.norm(slope, axis=1, keepdims=True)

    def fabric(points):
        height, there = noise_free(
            drawn(**shape), Setting(points, setting.pressure, setting.time), 16
        )
        return np.column_stack([points, height]), there

    below = setting.reference - upright(setting.reference)[:, :2]
    ends = [[sum(fabric(below + side * d)) for side in (0.1, -0.1)] for d in np.eye(2)]
    normal = np.cross(*(ahead - behind for ahead, behind in ends))
    normal *= 0.405 / np.linalg.norm(normal, axis=-1, keepdims=True)
    rest, there = fabric(below)
    np.testing.assert_allclose(high, (rest + upright(below))[:, 2] - 0.405, atol=5e-4)
    np.testing.assert_allclose(moved, there + normal - upright(below), atol=1e-3)
    # a flat fabric's face is where the fabric is; of a dome that is not so
    beside = np.abs(there - fabric(setting.reference)[1]).max()
    assert beside == 0.0 if dome == 0.0 else beside > 0.02


def test_misaligned_axes_turn_the_displacement_alone(setting, plain):
    moved = seen(
        setting,
        frame_misalignment__rotation_x=1.0,
        frame_misalignment__rotation_y=-0.5,
        frame_misalignment__rotation_z=0.2,
    )
    turn = Rotation.from_rotvec([1.0, -0.5, 0.2], degrees=True)
    expected = turn.apply(plain.reshape(-1, 3)).reshape(plain.shape)
    np.testing.assert_allclose(moved, expected, atol=1e-12)
    # about x by 1 degree: what rises goes to -y
    about_x = seen(setting, frame_misalignment__rotation_x=1.0)
    rise = -np.sin(np.deg2rad(1.0)) * plain[-1, :, 2].mean()
    assert (about_x - plain)[-1, :, 1].mean() == pytest.approx(rise, rel=1e-2)


def test_motions_turn_points_where_they_stand(setting):
    """u_seen = R(X + z0 + u) + shift - (X + z0), at heights of 4 mm."""
    shape = {"initial_shape__h0": 4.0}
    height, still = noise_free(drawn(**shape), setting, 8)
    kept, moved = noise_free(drawn(rigid_motion__rotation_y=1.0, **shape), setting, 8)
    start = np.column_stack([setting.reference, height])
    turn = Rotation.from_rotvec([0.0, 1.0, 0.0], degrees=True)
    whole = (start + still).reshape(-1, 3)
    np.testing.assert_allclose(moved, turn.apply(whole).reshape(still.shape) - start, atol=1e-9)
    np.testing.assert_allclose(kept, height)
    flat = np.column_stack([setting.reference, 0.0 * height])
    as_flat = turn.apply((flat + still).reshape(-1, 3)).reshape(still.shape) - flat
    assert (moved - as_flat)[..., 0].max() == pytest.approx(4.0 * np.sin(np.deg2rad(1.0)), rel=2e-2)


LIFT = {"rim_lift__amplitude": 0.5, "rim_lift__direction": 30.0, "rim_lift__shape": 0.5}


def test_rim_lifts_on_one_side_and_levels_off(setting):
    fabric = drawn(**LIFT)
    course = course_of(fabric, setting.pressure, setting.time)
    bar = np.array([0.2, 1.0, 2.0])
    np.testing.assert_allclose(course.lift, 0.5 * 2.0 * (1 - np.exp(-bar / 2.0)))
    assert (np.diff(np.diff(course.lift) / np.diff(bar)) < 0).all()
    shapes = balance(fabric, course, radius=100.0, thickness=0.81, fineness=8)
    mesh = hexagon(8)
    phi = np.arctan2(mesh.nodes[mesh.rim, 1], mesh.nodes[mesh.rim, 0])
    profile = np.maximum(0.0, np.cos(phi - np.deg2rad(30.0)))
    np.testing.assert_allclose(
        shapes.fine[:, mesh.rim, 2], np.outer(course.lift, profile), atol=1e-12
    )
    np.testing.assert_allclose(shapes.fine[:, mesh.rim, :2], 0.0, atol=1e-12)
    membrane = Membrane(type(mesh)(100.0 * mesh.nodes, mesh.cells), 0.81, fabric=Fabric())
    for p, shape in zip(setting.pressure, shapes.fine, strict=True):
        state = membrane.state(shape, float(p), stiffness(fabric), tangent=False)
        assert np.abs(state.residual).max() < 1e-8 * np.abs(state.reaction).max()


def test_lifted_rim_is_seen_above_it(setting, plain):
    change = (seen(setting, **LIFT) - plain)[..., 2]
    phi = np.rad2deg(np.arctan2(setting.reference[:, 1], setting.reference[:, 0]))
    outer = np.hypot(*setting.reference.T) > 75
    there, behind = outer & (np.abs(phi - 30) < 30), outer & (np.abs(phi - 30) > 150)
    lift = 0.5 * 2.0 * (1 - np.exp(-1.0))
    assert 0.5 * lift < change[-1, there].mean() < lift
    assert abs(change[-1, behind].mean()) < 0.15 * lift


def test_creeping_clamp_slips_by_decades(setting, plain):
    """In each frame as a clamp that slips by the decades of its time times the compliance."""
    creeping = seen(setting, clamp_creep__compliance=0.02)
    np.testing.assert_allclose(creeping[0], plain[0], atol=1e-3)
    decades = np.log10(1.0 + (setting.time - setting.time[0]) / 10.0)
    slipping = seen(setting, clamp_slip__compliance=0.02 * decades[-1])
    np.testing.assert_allclose(creeping[-1], slipping[-1], atol=1e-4)
    assert np.abs(slipping[-1] - plain[-1]).max() > 0.05


def test_a_sector_slips_beside_the_clamp(setting):
    """Compliances add up: a sector all round the rim, at its middle, is a clamp of their sum."""
    around = {
        "slipping_sector__compliance": 0.02,
        "slipping_sector__middle": 0.0,
        "slipping_sector__half_width": 1e9,
    }
    both = seen(setting, clamp_slip__compliance=0.01, **around)
    np.testing.assert_allclose(both, seen(setting, clamp_slip__compliance=0.03), atol=1e-3)


def test_gauge_lags_most_in_the_middle():
    fabric = drawn(gauge_hysteresis__bow=0.06)
    true = np.array([0.0, 0.15, 0.3])
    np.testing.assert_allclose(recorded_load(fabric, true), [0.0, 0.15 - 0.006, 0.3], atol=1e-15)
    both = drawn(
        gauge_hysteresis__bow=0.06, pressure_gain__gain=-0.03, pressure_offset__offset=0.04
    )
    pressures = np.linspace(1e-4, 0.3, 50)
    np.testing.assert_allclose(true_load(both, recorded_load(both, pressures)), pressures)


def test_frames_bend_in_their_plane(setting, plain):
    moved = seen(
        setting,
        frame_bend__bend=0.2,
        frame_bend__direction=90.0,
        frame_bend__cycles=1.0,
        frame_bend__phase=90.0,
    )
    # along y by the square of x; cosine of one cycle: 1, -1, 1
    expected = np.outer([1, -1, 1], 0.2 * (setting.reference[:, 0] / 100) ** 2)
    np.testing.assert_allclose((moved - plain)[..., 1], expected, atol=1e-9)
    np.testing.assert_allclose((moved - plain)[..., [0, 2]], 0.0, atol=1e-9)


def test_seam_is_a_stiff_strip():
    mesh = hexagon(8)
    fabric = drawn(
        stiff_seam__rise=0.5, stiff_seam__width=5.0, stiff_seam__normal=90.0,
        stiff_seam__distance=-20.0,
    )  # fmt: skip
    at = _gauss_points(mesh)
    expected = 1 + 0.5 * np.exp(-0.5 * ((at[..., 1] + 20.0) / 5.0) ** 2)
    np.testing.assert_allclose(evenness(fabric, mesh, 100.0), expected)


def test_stitched_sector_is_stiff_towards_the_rim():
    mesh = hexagon(8)
    fabric = drawn(
        stitched_sector__rise=0.8, stitched_sector__middle=350.0, stitched_sector__half_width=30.0
    )
    at = _gauss_points(mesh)
    phi = np.rad2deg(np.arctan2(at[..., 1], at[..., 0])) + 10.0
    away = np.where(phi > 180, 360 - phi, np.abs(phi))
    share = np.where(away < 30, np.cos(np.deg2rad(3 * away)) ** 2, 0.0)
    expected = 1 + 0.8 * share * (np.hypot(at[..., 0], at[..., 1]) / 100) ** 2
    np.testing.assert_allclose(evenness(fabric, mesh, 100.0), expected)
    assert (expected > 1.0).mean() == pytest.approx(60 / 360, abs=0.03)


def _gauss_points(mesh):
    """Gauss points (cells, 4, 2) mm of a unit mesh, by bilinear weights written out."""
    g = 1 / np.sqrt(3)
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    weights = [[(1 + a * g * x) * (1 + b * g * y) / 4 for x, y in corners] for a, b in corners]
    return 100.0 * np.einsum("ga,cad->cgd", weights, mesh.nodes[mesh.cells])


def test_a_ply_of_the_whole_thickness_is_a_turned_warp(setting):
    turned = seen(setting, axis_misalignment__angle=25.0)
    whole = seen(setting, rotated_ply__angle=25.0, rotated_ply__share=1.0)
    np.testing.assert_allclose(whole, turned, atol=1e-6)


def test_a_ply_that_is_not_turned_is_none(setting, plain):
    even = seen(setting, rotated_ply__angle=0.0, rotated_ply__share=0.3)
    np.testing.assert_allclose(even, plain, atol=1e-6)


def test_a_crossed_ply_mixes_warp_and_fill(setting):
    """Half of a fabric across the other half has the mean stiffness along both."""
    crossed = seen(setting, rotated_ply__angle=90.0, rotated_ply__share=0.5)
    d11, d22, d12, _ = stiffness(drawn())
    mean = 0.5 * (d11 + d22)
    nu = d12 / mean
    modulus = mean * (1 - nu**2)
    balanced = Draw(
        ("poisson_ratio",), {"poisson_ratio.nu12": nu}, (),
        {"E1": modulus, "E2": modulus, "G12": MODULI["G12"]},
    )  # fmt: skip
    np.testing.assert_allclose(crossed, noise_free(balanced, setting, 8)[1], atol=1e-6)


def test_moduli_of_plies_askew_are_those_of_all_about_the_axes_that_are_told():
    """All of the thickness turned: the ply's own about its warp. Half of it: those between."""

    def plies(share: float) -> np.ndarray:
        told = {"rotated_ply.angle": 30.0, "rotated_ply.share": share}
        return laminate(Draw(("rotated_ply",), told, (), MODULI))

    assert moduli_about(plies(0.0), 0.0) == pytest.approx(MODULI, rel=1e-12)
    assert moduli_about(plies(1.0), 30.0) == pytest.approx(MODULI, rel=1e-12)
    # alike about 0 and 30 degrees, so the axis between is one of symmetry
    half, turn = plies(0.5), 10.0
    either = [moduli_about(half, 15.0 + side * turn) for side in (-1.0, 1.0)]
    assert either[0] == pytest.approx(either[1], rel=1e-12)
    assert moduli_about(half, 15.0)["G12"] > MODULI["G12"]
    found = moduli_about(half, 15.0)
    record = {
        "truth": {
            "moduli": MODULI, "effects": ["rotated_ply"], "stiffness_MPa": half.tolist(),
            "parameters": {"rotated_ply": {}},
        },
        "answer": {
            "causes": [{"effect": "axis_misalignment", "parameters": {"angle": {"value": 15.0}}}],
            "parameters": {
                "corrected": {n: {"value": 1.01 * v, "stderr": 0.01 * v} for n, v in found.items()}
            },
        },
    }  # fmt: skip
    for in_stderr, relative in moduli_errors(record):
        assert in_stderr == pytest.approx(1.0, rel=1e-9)
        assert relative == pytest.approx(0.01, rel=1e-9)
