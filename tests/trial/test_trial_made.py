"""Are made tests what their truth says, by another mesh and other code than the diagnosis?"""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.path import Path as Outline

import bulgefit.trial
from bulgefit.errors import InputError
from bulgefit.fem.mesh import disc
from bulgefit.trial import recording, window
from bulgefit.trial.camera import Setting
from bulgefit.trial.draw import COUNTS, KINDS, Draw, Wave, draw, enlarged, firmer, sheared, without
from bulgefit.trial.fabric import Shapes, UnstableDrawError
from bulgefit.trial.foreign import FOREIGN
from bulgefit.trial.gauge import true_load
from bulgefit.trial.hexagon import FINENESS, TwoPlies, hexagon
from bulgefit.trial.known import FORMS, KNOWN, NOT_TOGETHER
from bulgefit.trial.make import Recipe, audible, make_test, until_stable
from bulgefit.trial.noise import holes, noise
from bulgefit.trial.rim import positions
from bulgefit.trial.signature import noise_free, of_each
from bulgefit.trial.window import NodalField

SMALL = Recipe(frames=6, spacing=13.0, fineness=8)
PARTS = sorted(Path(bulgefit.trial.__file__).parent.glob("*.py"))
CLEAN = Draw((), {}, (), {"E1": 330.0, "E2": 200.0, "G12": 16.0})


def test_nothing_comes_from_the_model_that_diagnoses():
    allowed = ("trial", "fem", "dic", "parallel", "files", "errors", "shown")
    for part in PARTS:
        tree = ast.parse(part.read_text(encoding="utf-8"))
        names = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        ours = {n.split(".")[1] for n in names if n.startswith("bulgefit")}
        assert ours <= {*allowed}, part


def test_the_dice_know_the_whole_catalogue():
    from bulgefit.gap.effects import CATALOGUE

    assert set(CATALOGUE) <= set(KNOWN)
    rng = np.random.default_rng(0)
    for kind in (*CATALOGUE, *FORMS):
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


def test_window_averages_over_a_disc():
    offsets, weights = window._window(6.0)
    assert weights.sum() == pytest.approx(1.0)
    # the mean of x² over a disc is a quarter of its radius squared
    assert weights @ offsets[:, 0] ** 2 == pytest.approx(9.0)


def test_window_at_the_rim_leaves_out_what_is_beyond():
    """Of an opening with lobes: against a count over a fine grid of places inside it."""
    lobes = {"clamp_lobes.c3": 0.02, "clamp_lobes.s3": -0.01}
    drawn = Draw(("clamp_lobes",), lobes, (), CLEAN.moduli)
    mesh, angle = hexagon(32), np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    nodes = positions(drawn, mesh.nodes, 100.0)
    rim = positions(drawn, np.stack([np.cos(angle), np.sin(angle)], axis=1), 100.0)[:, :2]
    x, y = nodes[:, 0], nodes[:, 1]
    field = np.stack([x, x * y, np.ones_like(x)], axis=1)[None]
    points = np.array([[99.5, 0.0], [-96.0, 1.0], [40.0, 85.0], [50.0, 0.0], [-99.5, 0.0]])
    found = window.averaged(Shapes(nodes, field, nodes, 0.0 * field), points, 10.0, rim)[0]
    side = 10.0 * (np.arange(1000) + 0.5 - 500) / 500
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*places.T) < 10.0]
    opening = Outline(rim)
    for point, seen in zip(points[:4], found, strict=False):
        there = (point + places)[opening.contains_points(point + places)]
        np.testing.assert_allclose(seen[0], there[:, 0].mean(), atol=0.02)
        np.testing.assert_allclose(seen[1], there.prod(axis=1).mean(), atol=1.0)
        np.testing.assert_allclose(seen[2], 1.0)
    assert np.isnan(found[4]).all()  # on the clamp


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


@pytest.mark.parametrize(
    "kind", ["none", "two", "six", "beside", "rim_lift", "creep", *FOREIGN, *FORMS]
)
def test_makes_every_kind(kind):
    made = make_test(kind, 4, SMALL)
    truth = json.loads(json.dumps(made.truth))
    special = {"none": "none", "two": "two", "six": "several"}
    foreign = kind in FOREIGN or kind == "beside"
    assert truth["kind"] == special.get(kind, "foreign" if foreign else "one")
    assert made.test.n_frames == 6
    assert made.test.pressure_increases
    assert set(truth["parameters"]) == set(truth["signatures"]) == set(truth["effects"])
    assert len(truth["places"]) == len(truth["where"]) == foreign
    size, left = truth["signature_mm"], truth["signature_left_mm"]
    assert (size == 0.0) if kind == "none" else (size >= left > 0.0)
    if "creep" in kind or kind == "camera_drift":
        assert made.test.time is not None


def test_a_cause_beside_others_is_worth_what_it_changes():
    """Alone it is worth the whole, on a rougher mesh; beside others less is its own."""
    truth = make_test("clamp_lobes", 1, SMALL).truth
    alone = truth["signatures"]["clamp_lobes"]
    assert alone["signature_mm"] == pytest.approx(truth["signature_mm"], rel=1e-6)
    assert alone["signature_left_mm"] == pytest.approx(truth["signature_left_mm"], rel=1e-6)
    lobes = {"clamp_lobes.c3": 0.01}
    offset = {"pressure_offset.offset": 0.05}
    gain = {"pressure_gain.gain": 0.02}
    shifted = Draw(("pressure_offset",), offset, (), CLEAN.moduli)
    setting = recording.place(shifted, np.random.default_rng(0), SMALL)
    worth = {}
    for name, told in (("both", {**lobes, **offset}), ("three", {**lobes, **offset, **gain})):
        effects = tuple({key.split(".")[0]: 0 for key in told})
        worth[name] = of_each(Draw(effects, told, (), CLEAN.moduli), setting)
    both, three = worth["both"], worth["three"]
    assert (
        three["pressure_gain"]["signature_left_mm"] < 0.1 * three["pressure_gain"]["signature_mm"]
    )
    assert both["clamp_lobes"]["signature_left_mm"] < both["clamp_lobes"]["signature_mm"]
    assert three["clamp_lobes"]["signature_mm"] == pytest.approx(
        both["clamp_lobes"]["signature_mm"], rel=0.05
    )


def test_what_is_kept_can_be_asked_for():
    small = {"frames": 6, "spacing": 16.0, "fineness": 8}
    for static in (False, True):
        for heights in (False, True):
            recipe = Recipe(**small, static=static, heights=heights)
            tests = [make_test("none", seed, recipe).test for seed in range(3)]
            assert all((t.static_displacement is not None) == static for t in tests)
            assert all(bool(t.blocks[0].reference[:, 2].any()) == heights for t in tests)


def test_interpolated_frames_are_mixtures_of_recorded_ones():
    """Half as many are independent, and each lies on the line between two of them."""
    test = make_test("none", 3, Recipe(9, 16.0, 8, interpolated=True)).test
    (block,) = test.blocks
    np.testing.assert_allclose(np.diff(test.pressure, 2), 0.0, atol=1e-12)
    whole = np.isfinite(block.displacement).all(axis=(0, 2))
    frames = block.displacement[:, whole].reshape(9, -1)
    sizes = np.linalg.svd(frames, compute_uv=False)
    assert sizes[4] > 1e-3
    assert sizes[5:].max() < 1e-9 * sizes[0]
    plain = make_test("none", 3, Recipe(9, 16.0, 8)).test
    assert len(np.unique(np.round(np.diff(plain.pressure), 6))) > 1


def test_noise_is_that_of_a_clean_test():
    """What static images show is the noise of the truth, and of moving frames."""
    made = make_test("none", 0, Recipe(6, 6.0, 8, static=True))
    static = made.test.static_displacement
    across, out = made.truth["noise_mm"]
    np.testing.assert_allclose(static.std(axis=(0, 1)), [across, across, out], rtol=0.1)


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
    placed = recording.place(CLEAN, rng, Recipe())
    assert 1150 <= len(placed.reference) <= 1600
    assert len(placed.pressure) == 20
    assert 0.003 <= placed.pressure[0] <= 0.005
    assert 0.24 <= placed.pressure[-1] <= 0.29


@pytest.mark.parametrize("kind", KINDS)
def test_shrunk_sizes_are_nearer_to_nothing(kind):
    """Each by a factor of its own, a foreign one's by no more than 3."""
    large, small = (draw(kind, np.random.default_rng(7), shrink) for shrink in (1.0, 30.0))
    assert small.effects == large.effects
    forms = {
        "rim_lift.direction", "rim_lift.shape", "fixture_motion.shape",
        "soft_patch.x", "soft_patch.y", "soft_patch.width", "rotated_ply.share",
        "stiff_seam.normal", "stiff_seam.distance", "stiff_seam.width",
        "stitched_sector.middle", "stitched_sector.half_width",
        "slipping_sector.middle", "slipping_sector.half_width",
        "frame_bend.direction", "frame_bend.cycles", "frame_bend.phase",
        "nonlinear_material.knee_x", "nonlinear_material.knee_y",
    }  # fmt: skip
    factors = {}
    for key, value in large.parameters.items():
        effect = key.split(".")[0]
        null = 0.24 if key == "poisson_ratio.nu12" else 0.0
        if key in forms:
            assert small.get(key) == value
        elif value != null:
            factor = (small.get(key) - null) / (value - null)
            assert 1 / (3 if effect in FOREIGN else 30) <= factor < 1
            assert factors.setdefault(effect, factor) == pytest.approx(factor)
    for wave, other in zip(large.waves, small.waves, strict=True):
        assert abs(other.amplitude) < abs(wave.amplitude)
    assert len(set(factors.values())) == len(factors)
    assert without(large).effects == ()


def test_causes_come_in_every_number():
    rng = np.random.default_rng(0)
    for kind, number in COUNTS.items():
        for _ in range(40):
            effects = draw(kind, rng).effects
            assert len({*effects}) == number
            assert {*effects} <= {*KNOWN}
            assert not any(pair <= {*effects} for pair in NOT_TOGETHER)
    beside = [draw("beside", rng).effects for _ in range(60)]
    assert {len(effects) for effects in beside} == {2, 3, 4}
    assert {effects[0] for effects in beside} == {*FOREIGN}
    assert all({*effects[1:]} <= {*KNOWN} for effects in beside)


def test_an_effect_grows_back_to_what_was_drawn():
    small = draw("four", np.random.default_rng(1), 10.0)
    large = draw("four", np.random.default_rng(1), 1.0)
    for effect in small.effects:
        names = [key for key in small.parameters if key.startswith(f"{effect}.")]
        full, part = (enlarged(small, effect, by) for by in (1e3, 1.05))
        for key in small.parameters:
            if key in names:
                assert full.get(key) == pytest.approx(large.get(key))
            else:
                assert full.get(key) == part.get(key) == small.get(key)
        assert full.shares[effect] == pytest.approx(1.0)
        assert part.shares[effect] == pytest.approx(1.05 * small.shares[effect])
    waved = Draw(
        ("reference_state",), {}, (Wave(2, 0.1, 0.01, 0.0, 0.0),), {}, {"reference_state": 0.5}
    )
    assert [enlarged(waved, "reference_state", by).waves[0].amplitude for by in (1.5, 9.0)] == [
        pytest.approx(0.15),
        pytest.approx(0.2),
    ]
    nu = Draw(("poisson_ratio",), {"poisson_ratio.nu12": 0.26}, (), {}, {"poisson_ratio": 0.2})
    assert enlarged(nu, "poisson_ratio", 2.0).nu12 == pytest.approx(0.28)


def test_a_cause_that_the_noise_would_hide_is_enlarged_to_it():
    """Depth off by 0.1 % is below the noise; it may be off by up to 2 %, or by 0.15 %."""
    rng = np.random.default_rng(0)
    noise_mm = np.sqrt(2 * 0.009**2 + 0.018**2)
    setting = recording.place(CLEAN, np.random.default_rng(0), SMALL)
    for share, full in ((0.05, True), (2 / 3, False)):
        scale, shares = {"depth_scale.scale_z": 0.001}, {"depth_scale": share}
        faint = Draw(("depth_scale",), scale, (), CLEAN.moduli, shares)
        before, after = (
            of_each(one, setting)["depth_scale"]["signature_left_mm"]
            for one in (faint, audible(faint, rng, SMALL))
        )
        assert before < 0.5 * noise_mm
        if full:
            assert after == pytest.approx(noise_mm, rel=0.1)
        else:
            assert after == pytest.approx(1.5 * before, rel=0.01)
    loud = make_test("clamp_lobes", 0, SMALL).truth
    again = make_test("clamp_lobes", 0, Recipe(6, 13.0, 8, audible=True)).truth
    assert again["parameters"] == loud["parameters"]


def test_a_fabric_that_is_too_soft_is_made_firmer():
    """In shear, by 1.1 to 1.4 each time, until it is stable; not for ever."""
    soft = Draw((), {}, (), {"E1": 100.0, "E2": 60.0, "G12": 1.0})
    setting = recording.place(soft, np.random.default_rng(0), SMALL)
    with pytest.raises(UnstableDrawError):
        noise_free(soft, setting, 8)
    firm, (_, seen) = until_stable(
        soft, np.random.default_rng(0), lambda one: noise_free(one, setting, 8), firmer
    )
    assert 1.1 <= firm.moduli["G12"] < 20.0
    assert (firm.moduli["E1"], firm.moduli["E2"]) == (100.0, 60.0)
    assert np.isfinite(seen).all()

    def never(one):
        raise UnstableDrawError("no")

    with pytest.raises(UnstableDrawError, match="try another seed"):
        until_stable(soft, np.random.default_rng(0), never, firmer)


def test_a_fabric_about_to_form_bands_is_too_soft():
    """It is not made, though it balances on each mesh; one that is a tenth firmer is.

    It is of a family of seed 1109, whose law a third mesh finds not elliptic from 2.7 bar on. On
    the firmer one meshes agree.
    """
    sizes = {
        "initial_shape.h0": -0.953, "prestrain.slack_x": 0.00049, "prestrain.slack_y": 0.00155,
        "nonlinear_material.k_x": 4.559, "nonlinear_material.k_y": 1.0717,
    }  # fmt: skip
    effects = ("initial_shape", "prestrain", "nonlinear_material")
    brink = Draw(effects, sizes, (), {"E1": 404.14, "E2": 139.64, "G12": 17.225})
    grid = np.stack(np.meshgrid(*[np.linspace(-80.0, 80.0, 9)] * 2), axis=-1).reshape(-1, 2)
    setting = Setting(grid[np.hypot(*grid.T) < 90.0], np.array([0.2, 0.28617]), np.arange(2.0))
    with pytest.raises(UnstableDrawError):
        noise_free(brink, setting, 24)

    firmer = sheared(brink, 1.12)
    coarse, fine = (noise_free(firmer, setting, n)[1][..., 0] for n in (16, 24))
    assert 1e3 * np.sqrt(((fine - coarse) ** 2).mean(axis=1)).max() < 1.0  # µm


def test_plies_share_their_rim():
    mesh = hexagon(8)
    plies = TwoPlies.of(mesh)
    np.testing.assert_array_equal(plies.rim, mesh.rim)
    np.testing.assert_array_equal(plies.ply.cells, mesh.cells)


def test_true_pressures_stay_positive():
    rng = np.random.default_rng(0)
    for offset in (-0.05, 0.05):
        fabric = Draw(("pressure_offset",), {"pressure_offset.offset": offset}, (), CLEAN.moduli)
        recorded = recording._pressures(fabric, rng, 20)
        assert recorded.min() > 0
        assert true_load(fabric, recorded).min() > 5e-4


def test_unknown_kind_names_the_known():
    with pytest.raises(InputError, match="clamp_slip"):
        draw("gremlin", np.random.default_rng(0))
