"""Do strain, curvature and tension of a measured surface come out, and as sure as they say?"""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, write_test
from bulgefit.dic.noise import noise_of
from bulgefit.dic.surface.choose import best_window
from bulgefit.dic.surface.local import surface_of
from bulgefit.dic.surface.measured import measure, noise_in_windows
from bulgefit.dic.surface.rings import rings_of
from bulgefit.dic.surface.windows import fewest_points, windows
from bulgefit.errors import InputError

#: Pressures (MPa) of a spherical cap, its radii of curvature and its meridian's strain.
PRESSURE = np.array([0.05, 0.3])
RISE = 60 * np.cbrt(PRESSURE)
RADIUS = (100.0**2 + RISE**2) / (2 * RISE)
OPENING = np.arcsin(100.0 / RADIUS)
TENSION = PRESSURE * RADIUS / 2
STRAIN = np.log(RADIUS * OPENING / 100.0)


def grid(spacing):
    axis = np.arange(-97, 98, spacing) + 0.3
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < 97
    return np.column_stack([x[inside], y[inside], np.zeros(inside.sum())])


def cap(spacing=6.0, noise=0.0, seed=0, thickness=0.8):
    """A disc that becomes a spherical cap, each radius stretched alike along itself."""
    points = grid(spacing)
    r = np.hypot(*points[:, :2].T)
    moved = []
    for radius, opening in zip(RADIUS, OPENING, strict=True):
        angle = r / 100.0 * opening
        out = (radius * np.sin(angle) / np.where(r > 0, r, 1) - 1)[:, None] * points[:, :2]
        moved.append(np.column_stack([out, radius * (np.cos(angle) - np.cos(opening))]))
    moved = np.array(moved) + np.random.default_rng(seed).normal(size=(2, *points.shape)) * noise
    return BulgeTest.from_arrays(points, moved, PRESSURE, thickness=thickness, name="cap")


def hoop(radius):
    """Hoop strain (frames, r) of the cap."""
    angle = radius / 100.0 * OPENING[:, None]
    return np.log(RADIUS[:, None] * np.sin(angle) / radius)


def test_a_polynomial_is_differentiated_exactly():
    points = grid(4.0)[:, :2]
    x, y = points.T
    local = windows(points, np.array([[3.0, -7.0]]), 25.0)
    field = 2.0 + 0.1 * x - 0.3 * y + 0.01 * x**2 - 0.02 * x * y + 1e-4 * x**2 * y**2
    found = local(field[:, None])[0, :, 0]
    at_x, at_y = 3.0, -7.0
    wanted = [
        2.0 + 0.3 + 2.1 + 0.09 + 0.42 + 1e-4 * 9 * 49,
        0.1 + 0.02 * at_x - 0.02 * at_y + 2e-4 * at_x * at_y**2,
        -0.3 - 0.02 * at_x + 2e-4 * at_x**2 * at_y,
        0.02 + 2e-4 * at_y**2,
        -0.02 + 4e-4 * at_x * at_y,
        2e-4 * at_x**2,
    ]
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


def test_windows_with_too_few_points_tell_nothing():
    points = grid(4.0)[:, :2]
    near = windows(points, np.array([[0.0, 0.0], [96.0, 0.0]]), 13.0)
    counts = [(np.hypot(*(points - c).T) <= 13).sum() for c in ([0, 0], [96, 0])]
    assert counts[0] >= fewest_points() > counts[1]
    assert np.isfinite(near.weights[0]).all()
    assert np.isnan(near.weights[1]).all()
    line = np.column_stack([np.linspace(-10, 10, 60), np.zeros(60)])
    assert np.isnan(windows(line, np.zeros((1, 2)), 13.0).weights).all()


def test_a_frame_without_points_tells_nothing():
    (block,) = cap().blocks
    moved = np.concatenate([block.displacement, np.full_like(block.displacement[:1], np.nan)])
    test = BulgeTest.from_arrays(block.reference, moved, [*PRESSURE, 0.4])
    found = measure(test, window=25.0)
    for values in (found.apex, found.surface, found.rings):
        assert np.isfinite(values.strain[:2]).any()
        assert np.isnan(values.strain[2]).all()
        assert np.isnan(values.strain_noise[2]).all()


@pytest.mark.parametrize("window", [0.043, 0.2, 6.0])
def test_windows_that_no_points_fill_are_refused_before_their_places(window, monkeypatch):
    monkeypatch.setattr("bulgefit.dic.surface.measured._places", None)
    with pytest.raises(InputError, match=f"no window of {window:g} mm has the 30 points"):
        measure(cap(), window=window)


def test_points_of_which_dx_was_never_measured_are_refused():
    (block,) = cap().blocks
    moved = block.displacement.copy()
    moved[..., 0] = np.nan
    test = BulgeTest.from_arrays(block.reference, moved, PRESSURE)
    with pytest.raises(InputError, match="no point has dx, dy and dz in one frame"):
        measure(test, window=25.0)


def test_cap_converges_with_the_window():
    """Strain and curvature at the apex by the fourth power of the window's radius."""
    test = cap(2.5)
    errors = []
    for window in (16.0, 32.0):
        apex = measure(test, window=window).apex
        errors.append([
            np.abs(apex.curvature[1, 0, :2] * RADIUS[1] - 1).max(),
            np.abs(apex.strain[1, 0, :2] - STRAIN[1]).max(),
        ])  # fmt: skip
    order = np.log2(np.array(errors[1]) / np.array(errors[0]))
    assert (order > 3.7).all()
    assert (np.array(errors[0]) < [2e-5, 2e-6]).all()


def test_cap():
    test = cap(2.5)
    found = measure(test, window=20.0)
    np.testing.assert_allclose(found.apex.tension[:, 0], TENSION, rtol=2e-4)
    stretched = np.exp(2 * STRAIN)
    np.testing.assert_allclose(found.apex.stress[:, 0], TENSION * stretched / 0.8, rtol=2e-4)
    np.testing.assert_allclose(
        found.surface.tension, np.tile(TENSION, (len(found.surface.points), 1)).T, rtol=2e-3
    )
    rings = found.rings
    assert rings.radius[-1] > 80
    np.testing.assert_allclose(
        rings.tension[..., 0], np.tile(TENSION, (len(rings.radius), 1)).T, rtol=1e-4
    )
    np.testing.assert_allclose(
        rings.tension[..., 1], np.tile(TENSION, (len(rings.radius), 1)).T, rtol=2e-3
    )
    np.testing.assert_allclose(
        rings.strain[..., 0], np.tile(STRAIN, (len(rings.radius), 1)).T, atol=1e-5
    )
    np.testing.assert_allclose(rings.strain[..., 1], hoop(rings.radius), atol=1e-5)
    assert np.abs(found.rim_shift).max() < 1e-3


def test_strain_of_a_plane_deformation():
    """A homogeneous stretch and shear of a plane: ln U of its right stretch."""
    points = grid(5.0)
    f = np.array([[1.06, 0.03, 0], [-0.01, 1.02, 0], [0, 0, 1]])
    c = f[:2, :2].T @ f[:2, :2]
    values, axes = np.linalg.eigh(c)
    wanted = axes @ np.diag(0.5 * np.log(values)) @ axes.T
    test = BulgeTest.from_arrays(points, (points @ (f - np.eye(3)).T)[None], [0.1])
    found = measure(test, window=30.0).surface
    for i, entry in enumerate((wanted[0, 0], wanted[1, 1], wanted[0, 1])):
        np.testing.assert_allclose(found.strain[0, :, i], entry, atol=1e-12)
    np.testing.assert_allclose(found.curvature, 0.0, atol=1e-12)


def test_a_motion_of_the_cameras_is_no_strain():
    """Strain, curvature and mean tension do not see it; an uneven reference counts."""
    test = cap(4.0)
    block = test.blocks[0]
    x, y, _ = block.reference.T
    uneven = block.reference + np.column_stack([0 * x, 0 * x, 2 * np.cos(x / 60) * np.cos(y / 50)])
    angle = np.deg2rad(3.0)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    rigid = uneven @ turn.T + [0.4, -0.2, 1.0] - uneven
    still = measure(BulgeTest.from_arrays(uneven, rigid[None], [0.1]), window=20.0).surface
    np.testing.assert_allclose(still.strain, 0.0, atol=2e-6)
    moved = (block.reference + block.displacement) @ turn.T - block.reference
    seen = measure(BulgeTest.from_arrays(block.reference, moved, PRESSURE), window=20.0).surface
    plain = measure(test, window=20.0).surface
    np.testing.assert_allclose(seen.strain, plain.strain, atol=1e-10)
    np.testing.assert_allclose(seen.curvature, plain.curvature, atol=1e-10)


def test_errors_are_those_of_the_noise():
    """The scatter over 60 draws of the noise is what each error says."""
    sigma = np.array([0.01, 0.015, 0.03])
    places, radii = np.array([[0.0, 0.0], [40.0, 30.0]]), np.array([30.0, 60.0])
    drawn, said = [], []
    for seed in range(60):
        test = cap(noise=sigma, seed=seed)
        local, rings = surface_of(test, places, 25.0, sigma), rings_of(test, radii, 25.0, sigma)
        values, errors = [], []
        for found in (local, rings):
            for kind in ("strain", "curvature", "tension", "stress"):
                values.append(getattr(found, kind).ravel())
                errors.append(getattr(found, f"{kind}_noise").ravel())
        drawn.append(np.concatenate(values))
        said.append(np.concatenate(errors))
    ratio = np.std(drawn, axis=0, ddof=1) / np.mean(said, axis=0)
    # 60 draws tell a standard deviation within 9 %, and values go together
    assert abs(np.sqrt((ratio**2).mean()) - 1) < 0.05
    assert ratio.min() > 1 - 4 * 0.092
    assert ratio.max() < 1 + 4 * 0.092


def test_correlated_noise_makes_errors_larger():
    """What they say is an upper bound: the noise of neighbours is taken to go together."""
    points = grid(6.0)
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    root = np.linalg.cholesky(np.exp(-distance / 8.0) + 1e-9 * np.eye(len(points)))
    test, apex = cap(), np.zeros((1, 2))
    drawn, said = [], []
    for seed in range(40):
        noise = root @ np.random.default_rng(seed).normal(size=(12, len(points), 3)) * 0.02
        noisy = BulgeTest.from_arrays(
            points,
            test.blocks[0].displacement + noise[:2],
            PRESSURE,
            static_displacement=noise[2:],
        )
        known = noise_of(noisy)
        assert known.inflation > 3
        found = surface_of(noisy, apex, 30.0, noise_in_windows(known))
        drawn.append([found.tension[1, 0], found.strain[1, 0, 0]])
        said.append([found.tension_noise[1, 0], found.strain_noise[1, 0, 0]])
    ratio = np.mean(said, axis=0) / np.std(drawn, axis=0, ddof=1)
    assert (ratio > 0.9).all()
    assert (ratio < 3.0).all()


def test_the_window_follows_the_noise():
    """Narrower where there is less of it, and nearly the best of all for what is known here."""
    sizes = (0.001, 0.01, 0.1)
    chosen = [best_window(cap(4.0, noise=s), np.full(3, s)) for s in sizes]
    assert chosen[0] < chosen[1] <= chosen[2] <= 50.0

    def miss(window):
        squares = []
        for seed in range(8):
            test = cap(4.0, noise=0.01, seed=seed)
            apex = surface_of(test, np.zeros((1, 2)), window, np.full(3, 0.01))
            squares.append((apex.tension[1, 0] / TENSION[1] - 1) ** 2)
        return np.sqrt(np.mean(squares))

    assert miss(chosen[1]) < 0.5 * miss(18.0)
    assert miss(chosen[1]) < 0.004


def test_lost_points_and_points_of_their_own():
    """A frame without some of its points, or with others, tells nearly the same."""
    test = cap(4.0)
    block = test.blocks[0]
    lost = block.displacement.copy()
    rng = np.random.default_rng(3)
    lost[1, rng.random(len(block.reference)) < 0.2] = np.nan
    lost[0, :, 2] = np.where(block.reference[:, 0] > 60, np.nan, lost[0, :, 2])
    patchy = BulgeTest.from_arrays(block.reference, lost, PRESSURE, thickness=0.8)
    found, whole = measure(patchy, window=24.0), measure(test, window=24.0)
    np.testing.assert_allclose(found.apex.tension, whole.apex.tension, rtol=1e-3)
    right = found.surface.points[:, 0] > 75
    assert right.any()
    assert np.isnan(found.surface.tension[0, right]).any()
    assert np.isfinite(found.surface.tension[1]).all()
    assert np.isnan(found.rings.tension[0, -1]).all()
    assert np.isfinite(found.rings.tension[1]).all()
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))["rings"]
    for name, column in found.tables()["rings"].items():
        np.testing.assert_array_equal(np.array(told[name], dtype=float), column)
    frames = []
    for row in range(2):
        seen = np.isfinite(lost[row]).all(axis=1)
        shift = np.array([0.1 * row, 0, 0])
        frames.append((block.reference[seen][row:] + 0 * shift, lost[row][seen][row:]))
    apart = BulgeTest.from_frames(frames, PRESSURE, thickness=0.8)
    np.testing.assert_allclose(
        measure(apart, window=24.0).apex.tension, whole.apex.tension, rtol=1e-3
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 0.0}, "a window of 0 mm cannot be"),
        ({"window": np.nan}, "a window of nan mm cannot be"),
        ({"window": 101.0}, "a window of 101 mm cannot be"),
        ({"window": 7.0}, "has the 30 points that it takes; give a wider one"),
        ({"window": 30.0, "points": [1, 2]}, "give an array of"),
        ({"window": 30.0, "points": "apex"}, "give an array of"),
        ({"window": 30.0, "points": [[0, 101]]}, "lie outside the clamp"),
        ({"window": "wide"}, "give the window as a number"),
    ],
)
def test_what_cannot_be_measured(options, message):
    with pytest.raises(InputError, match=message):
        measure(cap(), **options)


def test_places_are_held_to_an_oval_clamp():
    round_ = cap(4.0)
    oval = replace(round_, ellipticity=0.2)
    assert measure(oval, window=40.0, points=[[105.0, 0.0]]).surface.points.tolist() == [[105, 0]]
    with pytest.raises(InputError, match="beyond semi-axes of 120 and 80 mm from its centre"):
        measure(oval, window=40.0, points=[[0.0, 95.0]])


@pytest.mark.parametrize("pressure", [0.0, 2e-5])
def test_the_reference_image_tells_no_noise(pressure):
    """Of frames with points of their own, though it has the most of them."""
    block = cap(4.0, noise=0.02).blocks[0]
    aside = np.array([0.01, 0.0, 0.0])
    frames = [(block.reference, 0 * block.displacement[0])]
    for i, moved in enumerate(block.displacement, start=1):
        frames.append((block.reference[i:] + i * aside, moved[i:]))
    test = BulgeTest.from_frames(frames, [pressure, *PRESSURE], thickness=0.8)
    assert len(test.blocks) == 3
    np.testing.assert_allclose(noise_of(test).sigma, 0.02, rtol=0.15)


def test_windows_without_points_are_refused_before_the_work(monkeypatch):
    """A quarter of a narrow window apart there are very many of them."""
    monkeypatch.setattr("bulgefit.dic.surface.measured.surface_of", None)
    with pytest.raises(InputError, match="no window of 1 mm has the 30 points"):
        measure(cap(), window=1.0)


@pytest.mark.filterwarnings("error")
def test_without_pressure_neither_dome_nor_tension_is_told(tmp_path, capsys):
    """Of an image at rest, and of one whose gauge reads a little less than nothing."""
    loaded = cap(noise=0.005)
    flat = np.random.default_rng(3).normal(0, 0.005, (1, *loaded.blocks[0].displacement.shape[1:]))
    moved = np.concatenate([flat, 0 * flat, loaded.blocks[0].displacement])
    pressure = np.concatenate([[-0.002, 0.0], PRESSURE])
    test = BulgeTest.from_arrays(loaded.blocks[0].reference, moved, pressure)
    write_test(test, tmp_path / "rest.npz")
    assert main(["measure", str(tmp_path / "rest.npz"), "--window", "40"]) == 0
    below, rest, light = capsys.readouterr().out.splitlines()[3:6]
    for row in (below, rest):
        assert row.split()[-3:] == ["-", "-", "-"]
        assert row.count("±") == 2
    assert light.count("±") == 5
    assert "± -" not in light


def test_few_points():
    axis = np.linspace(-60, 60, 5)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis))
    test = BulgeTest.from_arrays(
        np.column_stack([x, y, 0 * x]), np.ones((2, 25, 3)), PRESSURE, name="few"
    )
    with pytest.raises(InputError, match="few: has too few points to tell its noise"):
        measure(test)
    with pytest.raises(InputError, match="30 points that it takes"):
        measure(test, window=40.0)


def test_verb_says_how_many_frames_it_shows(capsys):
    example = Path(__file__).parents[2] / "data" / "example_bulge.npz"
    assert main(["measure", str(example), "--window", "40", "--quiet"]) == 0
    _, table, *_ = re.split("at the apex|around rings", capsys.readouterr().out)
    head, *rows = table.splitlines()
    assert head == " (12 of 15 frames; all in --csv):"
    assert len(rows) == 1 + 12  # what the columns are, and the frames


def test_verb(tmp_path, capsys):
    file = tmp_path / "cap.npz"
    write_test(cap(4.0, noise=0.005), file)
    words = ["measure", str(file), "--json", str(tmp_path / "m.json"), "--quiet"]
    folders = ["--csv", str(tmp_path / "csv"), "--plots", str(tmp_path / "plots")]
    assert main([*words, *folders]) == 0
    said = capsys.readouterr().out
    assert "at the apex:" in said
    assert "around rings at 3 bar" in said
    found = json.loads((tmp_path / "m.json").read_text())
    (tension,) = found["apex"]["tension_N_per_mm"][1:]
    (error,) = found["apex"]["tension_noise_N_per_mm"][1:]
    assert abs(tension - TENSION[1]) < 4 * error
    assert f"{tension:.3f} ± {error:.3f}" in said
    assert found["apex"]["pressure_bar"] == pytest.approx([0.5, 3.0])
    assert {p.name for p in (tmp_path / "plots").iterdir()} == {
        "apex.png", "rings.png", "fields.png",
    }  # fmt: skip
    with (tmp_path / "csv" / "rings.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    assert [float(r["tension_meridian_N_per_mm"]) for r in rows] == pytest.approx(
        found["rings"]["tension_meridian_N_per_mm"], rel=1e-7
    )
    assert main([*words, *folders]) == 2
    assert "exists; use --force" in capsys.readouterr().err
    assert main(["measure", str(file), "--window", "3"]) == 2
    assert "give a wider one" in capsys.readouterr().err
