"""Are made tests what their truth says, by another mesh and other code than the diagnosis?"""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest

from bulgefit.errors import InputError
from bulgefit.fem.mesh import disc
from bulgefit.trial import camera as made_camera
from bulgefit.trial import draw as made_draws
from bulgefit.trial import fabric as made_fabric
from bulgefit.trial import make as made_tests
from bulgefit.trial.camera import NodalField, Setting, holes, material_points, noise
from bulgefit.trial.draw import FOREIGN, FORMS, KINDS, KNOWN, Draw, Wave, draw, without
from bulgefit.trial.fabric import FINENESS, Shapes, hexagon, softening, true_load
from bulgefit.trial.make import Recipe, make_test, noise_free

SMALL = Recipe(frames=6, spacing=13.0, fineness=8)
MODULI = {"E1": 330.0, "E2": 200.0, "G12": 16.0}
PARTS = (made_draws, made_fabric, made_camera, made_tests)


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


def test_nothing_comes_from_the_model_that_diagnoses():
    for part in PARTS:
        tree = ast.parse(Path(part.__file__).read_text(encoding="utf-8"))
        names = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        assert not [n for n in names if n.startswith(("bulgefit.model", "bulgefit.fitting"))]


def test_the_dice_know_the_whole_catalogue():
    from bulgefit.gap.effects import CATALOGUE

    assert set(KNOWN) == set(CATALOGUE)
    rng = np.random.default_rng(0)
    for kind in (*KNOWN, *FORMS):
        effect = CATALOGUE[FORMS[kind][0] if kind in FORMS else kind]
        ranges = {p.name: (p.lower, p.upper) for p in effect.parameters}
        for _ in range(30):
            for key, value in draw(kind, rng).parameters.items():
                low, high = ranges[key.removeprefix(f"{effect.id}.")]
                assert low <= value <= high


def test_mesh_is_fine_nested_and_of_another_topology():
    mesh, coarse = hexagon(FINENESS), hexagon(FINENESS // 2)
    assert len(mesh.cells) == 7.5 * FINENESS**2 >= 4 * len(disc().cells)
    assert len(mesh.rim) == 6 * FINENESS
    corners = mesh.nodes[mesh.cells]
    ahead = np.roll(corners, -1, axis=1)
    area = 0.5 * (corners[..., 0] * ahead[..., 1] - corners[..., 1] * ahead[..., 0]).sum()
    assert area == pytest.approx(np.pi, rel=1e-3)
    # three cells meet at the centre; a square's grid has four
    assert (mesh.cells == mesh.apex).sum() == 3
    fine = {tuple(p) for p in np.round(mesh.nodes, 8) + 0.0}
    assert {tuple(p) for p in np.round(coarse.nodes, 8) + 0.0} <= fine


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
    soft = softening(drawn(creep__rate=0.05), time)
    assert soft[0] == 1.0
    assert soft[9] == pytest.approx(0.95)


def test_creep_is_a_higher_pressure_where_all_that_resists_creeps(setting):
    soft = softening(drawn(creep__rate=0.1), setting.time)
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


def test_bent_camera_sees_outer_points_farther_out(setting):
    fabric = drawn(camera_bend__bend=0.01)
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
    rim = made_fabric._positions(drawn(clamp_shape__ellipticity=0.01), at, 100.0)
    np.testing.assert_allclose([rim[:, 0].max(), rim[:, 1].max()], [101.0, 99.0], atol=0.5)
    lobed = made_fabric._positions(drawn(lobed_rim__lobe=0.01, lobed_rim__turn=0.0), at, 100.0)
    phi = np.arctan2(at[:, 1], at[:, 0])
    np.testing.assert_allclose(np.hypot(*lobed[:, :2].T), 100 * (1 + 0.01 * np.cos(3 * phi)))
    domed = made_fabric._positions(drawn(initial_shape__h0=2.0), np.zeros((1, 2)), 100.0)
    np.testing.assert_allclose(domed, [[0, 0, 2.0]])


def test_thickness_grades_and_dips():
    mesh = hexagon(16)
    even = made_fabric._thickness(drawn(stiffness_gradient__g_x=0.2), mesh, 100.0)
    assert even.max() == pytest.approx(1.2, abs=0.02)
    fabric = drawn(soft_patch__drop=0.4, soft_patch__width=20.0, soft_patch__x=30.0)
    patch = made_fabric._thickness(fabric, mesh, 100.0)
    assert patch.min() == pytest.approx(0.6, abs=0.02)
    assert patch.max() == pytest.approx(1.0, abs=1e-3)


def test_window_averages_over_a_disc():
    offsets, weights = made_camera._window(6.0)
    assert weights.sum() == pytest.approx(1.0)
    # the mean of x² over a disc is a quarter of its radius squared
    assert weights @ offsets[:, 0] ** 2 == pytest.approx(9.0)


def test_window_at_the_rim_leaves_out_what_is_beyond():
    mesh = hexagon(16)
    nodes = np.column_stack([100.0 * mesh.nodes, np.zeros(len(mesh.nodes))])
    even = np.ones((1, len(nodes), 3))
    shapes = Shapes(nodes, even, nodes, 0.0 * even)
    found = made_camera._displacement(shapes, np.array([[96.0, 0.0]]), 10.0, 100.0)
    np.testing.assert_allclose(found, 1.0)
    inner = made_camera._displacement(shapes, np.array([[50.0, 0.0]]), 10.0, 100.0)
    np.testing.assert_allclose(inner, 1.0)


def test_interpolation_is_far_better_than_the_noise():
    nodes = 100.0 * hexagon(FINENESS).nodes
    points = nodes[::7] * 0.96 + 0.3
    field = NodalField(nodes, points)(np.repeat(_dome(nodes)[:, None], 3, axis=1))
    assert np.abs(field[:, 0] - _dome(points)).max() < 1e-3


def _dome(points):
    return 40.0 * np.cos(points[:, 0] / 70.0) * np.cos(points[:, 1] / 80.0)


# noise and holes


def test_noise_is_four_fifths_independent():
    rng = np.random.default_rng(1)
    x = 5.0 * np.arange(20)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    errors = noise(rng, points, 200, (0.006, 0.012), 10.0)
    np.testing.assert_allclose(errors.std(axis=(0, 1)), [0.006, 0.006, 0.012], rtol=0.03)
    grid = errors[..., 2].reshape(200, 20, 20) / 0.012
    near = (grid[:, :, 1:] * grid[:, :, :-1]).mean()
    far = (grid[:, :, 8:] * grid[:, :, :-8]).mean()
    assert near == pytest.approx(0.36 * np.exp(-0.25), abs=0.02)
    assert abs(far) < 0.02


def test_holes_wander():
    points = np.stack(np.meshgrid(*[np.linspace(-90, 90, 60)] * 2), axis=-1).reshape(-1, 2)
    lost = holes(np.random.default_rng(3), points, 20)
    assert not lost[0].any()
    assert 0 < lost[-1].mean() < 0.1
    assert (lost[-1] != lost[-2]).any()


# whole tests


@pytest.mark.parametrize("kind", ["none", "two", "prestrain", "creep", *FOREIGN, *FORMS])
def test_makes_every_kind(kind):
    made = make_test(kind, 4, SMALL)
    truth = json.loads(json.dumps(made.truth))
    assert truth["kind"] == {"none": "none", "two": "two"}.get(
        kind, "foreign" if kind in FOREIGN else "one"
    )
    assert made.test.n_frames == 6
    assert made.test.pressure_increases
    assert set(truth["parameters"]) == set(truth["effects"])
    size, left = truth["signature_mm"], truth["signature_left_mm"]
    assert (size == 0.0) if kind == "none" else (size >= left > 0.0)
    if kind == "creep":
        assert made.test.time is not None


def test_a_gain_is_what_moduli_imitate():
    truth = make_test("pressure_gain", 2, SMALL).truth
    assert truth["signature_left_mm"] < 0.03 * truth["signature_mm"]


def test_the_seed_is_all_there_is():
    one, again, other = (make_test("none", seed, SMALL) for seed in (1, 1, 2))
    np.testing.assert_array_equal(
        one.test.blocks[0].displacement, again.test.blocks[0].displacement
    )
    assert one.truth == again.truth
    assert one.truth["nonce"] != other.truth["nonce"]


def test_some_lack_static_images_and_heights():
    tests = [make_test("none", seed, Recipe(5, 16.0, 8)).test for seed in range(12)]
    assert len({t.static_displacement is None for t in tests}) == 2
    assert len({t.time is None for t in tests}) == 2
    assert len({bool(t.blocks[0].reference[:, 2].any()) for t in tests}) == 2


def test_default_size_is_that_of_a_trial():
    rng = np.random.default_rng(0)
    placed = made_tests._setting(drawn(), rng, Recipe())
    assert 1150 <= len(placed.reference) <= 1600
    assert len(placed.pressure) == 20
    assert 0.003 <= placed.pressure[0] <= 0.005
    assert 0.24 <= placed.pressure[-1] <= 0.29


@pytest.mark.parametrize("kind", KINDS)
def test_shrunk_sizes_are_nearer_to_nothing(kind):
    large, small = (draw(kind, np.random.default_rng(7), shrink) for shrink in (1.0, 30.0))
    assert small.effects == large.effects
    places = ("x", "y", "width", "turn", "middle", "half_width", "knee_x", "knee_y")
    for key, value in large.parameters.items():
        null = 0.24 if key == "poisson_ratio.nu12" else 0.0
        if kind in (*FOREIGN, *FORMS) and key.split(".")[1] in places:
            assert small.get(key) == value
        elif value != null:
            assert 1 / 30 <= (small.get(key) - null) / (value - null) < 1
    for wave, other in zip(large.waves, small.waves, strict=True):
        assert abs(other.amplitude) < abs(wave.amplitude)
    assert without(large).effects == ()


def test_true_pressures_stay_positive():
    rng = np.random.default_rng(0)
    for offset in (-0.05, 0.05):
        fabric = drawn(pressure_offset__offset=offset)
        recorded = made_tests._pressures(fabric, rng, 20)
        assert recorded.min() > 0
        assert true_load(fabric, recorded).min() > 5e-4


def test_unknown_kind_names_the_known():
    with pytest.raises(InputError, match="clamp_slip"):
        draw("gremlin", np.random.default_rng(0))
