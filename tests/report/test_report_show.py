"""Are tests drawn as they are: true in scale, in the right colours, headless, and for ParaView?"""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image
from scipy.spatial import ConvexHull

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest, write_test
from bulgefit.errors import BulgefitError, InputError
from bulgefit.report import _off_screen
from bulgefit.report.cloud import FIELDS, RESIDUALS, Cloud
from bulgefit.report.paraview import write_test_paraview
from bulgefit.report.show import _ranges, animate, show


def made(frames=3, spacing=8.0):
    axis = np.arange(-96, 97, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < 97
    x, y = x[inside], y[inside]
    pressure = np.linspace(0.1, 0.3, frames)
    rise = 60 * np.cbrt(pressure)[:, None] * (1 - (x**2 + y**2) / 1e4)
    moved = np.stack([1e-3 * rise * x, 2e-3 * rise * y, rise], axis=-1)
    reference = np.column_stack([x, y, 0 * x])
    test = BulgeTest.from_arrays(reference, moved, pressure, name="made")
    return test, (moved - np.array([0.01, 0.02, 0.5]),)


@pytest.fixture
def opengl():
    try:
        _off_screen.require_opengl()
    except BulgefitError as error:
        pytest.skip(str(error))


def test_holes_stay_open():
    test, _ = made(frames=1)
    block = test.blocks[0]
    moved = block.displacement.copy()
    hole = np.hypot(block.reference[:, 0] - 30, block.reference[:, 1]) < 20
    moved[0, hole] = np.nan
    cloud = Cloud(BulgeTest.from_arrays(block.reference, moved, [0.1]))
    at, triangles = cloud.part(0)[0], cloud.triangles(0)
    assert len(at) == (~hole).sum()
    middle = at[triangles].mean(axis=1)
    assert np.hypot(middle[:, 0] - 30, middle[:, 1]).min() > 15
    whole = Cloud(test).triangles(0)
    plane = block.reference[:, :2][whole]
    along, across = plane[:, 1] - plane[:, 0], plane[:, 2] - plane[:, 0]
    area = 0.5 * np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]).sum()
    assert area == pytest.approx(ConvexHull(block.reference[:, :2]).volume, rel=0.03)


def test_fields_are_those_of_measure():
    from bulgefit.dic.surface.measured import measure

    test, prediction = made()
    cloud = Cloud(test, prediction, window=30.0)
    found = measure(test, window=30.0, points=test.blocks[0].reference[:, :2]).surface
    np.testing.assert_allclose(cloud.value("strain_yy", 2), found.strain[2, :, 1], equal_nan=True)
    np.testing.assert_allclose(cloud.value("tension", 2), found.tension[2], equal_nan=True)
    for i, name in enumerate(("dx", "dy", "dz")):
        np.testing.assert_allclose(cloud.value(f"residual_{name}", 1), [0.01, 0.02, 0.5][i])
        np.testing.assert_array_equal(cloud.value(name, 1, modelled=True), prediction[0][1][:, i])
    left = cloud.value("residual_strain_xy", 1)
    assert np.isfinite(left).mean() > 0.8
    np.testing.assert_allclose(left[np.isfinite(left)], 0.0, atol=1e-12)


@pytest.mark.parametrize("pressure", [0.0, -0.002])
def test_a_frame_at_rest_is_shown_like_any_other(pressure, tmp_path):
    block = made()[0].blocks[0]
    moved = np.concatenate([np.zeros_like(block.displacement[:1]), block.displacement])
    test = BulgeTest.from_arrays(block.reference, moved, [pressure, *made()[0].pressure])
    cloud = Cloud(test, window=30.0)
    assert not np.isfinite(cloud.value("tension", 0)).any()
    np.testing.assert_allclose(cloud.value("strain_xx", 0)[len(moved[0]) // 2], 0.0, atol=1e-12)
    assert np.isfinite(cloud.value("tension", 1)).any()
    write_test_paraview(test, tmp_path / "t.pvd", window=30.0)


def test_colours_of_signed_fields_are_even_about_zero():
    test, prediction = made()
    cloud = Cloud(test, prediction)
    ranges = _ranges(cloud, [0, 2], "dx")
    assert list(ranges) == ["dx", "residual_dx"]
    for low, high in ranges.values():
        assert low == -high
    assert ranges["residual_dx"][1] == pytest.approx(0.01)
    low, high = _ranges(cloud, [0, 1, 2], "dz")["dz"]
    assert high == test.blocks[0].displacement[..., 2].max()
    assert low == test.blocks[0].displacement[..., 2].min()


@pytest.mark.parametrize("field", ["strain_xy", "residual_dz"])
def test_pictures(opengl, field, tmp_path):
    test, prediction = made()
    image = show(test, tmp_path / "a.png", field=field, prediction=prediction, window=30.0)
    np.testing.assert_array_equal(
        np.round(255 * imread(tmp_path / "a.png")[..., :3]).astype(np.uint8), image
    )
    panels = 1 if field == "residual_dz" else 3
    assert image.shape[1] == 720 * panels
    for panel in np.split(image, panels, axis=1):
        # nothing is cut off, also no title of an axis
        assert (panel[:, :8] == 255).all()
        assert (panel[:, -8:] == 255).all()
    for panel in np.split(image, panels, axis=1)[:2]:
        # a surface, of colour, in the middle of each
        middle = panel[250:450, 200:500].astype(float)
        assert (np.ptp(middle, axis=2) > 25).mean() > 0.2
    with pytest.raises(InputError, match="exists"):
        show(test, tmp_path / "a.png", field=field, prediction=prediction)


def test_pictures_are_true_in_scale(opengl):
    """A bulge twice as high reaches higher up, in the same view."""

    def top(factor):
        test, _ = made(frames=1)
        block = test.blocks[0]
        high = BulgeTest.from_arrays(block.reference, factor * block.displacement, [0.1])
        picture = show(high).astype(float)
        coloured = (np.ptp(picture, axis=2) > 60).sum(axis=1) > 5
        return int(np.flatnonzero(coloured).min())

    # 27.8 mm, seen from 33 degrees above, at some 2.2 pixels a mm
    low, high = top(1.5), top(2.5)
    assert 25 < low - high < 80


def test_inflation(opengl, tmp_path):
    test, _ = made(frames=3)
    animate(test, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as film:
        assert film.n_frames == 3
        pictures = []
        for index in range(3):
            film.seek(index)
            pictures.append(np.asarray(film.convert("RGB"), dtype=float))
    assert np.abs(pictures[0] - pictures[2]).mean() > 1.0


def test_inflation_as_a_film(opengl, tmp_path):
    """The pictures of the .gif, but for what a film's compression takes."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="an .mp4 needs imageio-ffmpeg")
    test, _ = made(frames=3)
    animate(test, tmp_path / "a.mp4")
    last = show(test, frame=2)
    as_pictures = ["-i", tmp_path / "a.mp4", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    seen = subprocess.run([ffmpeg.get_ffmpeg_exe(), *as_pictures], capture_output=True, check=True)
    assert b"Video: h264" in seen.stderr
    pictures = np.frombuffer(seen.stdout, np.uint8).reshape(-1, *last.shape).astype(float)
    # 0.12 s each, the last one 1.2 s
    assert len(pictures) == 2 + 10
    # colours are kept at half the resolution, so edges are not quite what they were
    changed = np.abs(pictures[0] - pictures[-1]).mean()
    assert np.abs(pictures[-1] - last).mean() < 0.5 * changed
    with pytest.raises(InputError, match="exists"):
        animate(test, tmp_path / "a.mp4")


def test_a_film_without_its_extra(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    file = str(tmp_path / "t.npz")
    write_test(made()[0], file)
    assert main(["show", file, str(tmp_path / "a.mp4"), "--quiet"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'pip install "bulgefit[movie]"' in line
    assert not (tmp_path / "a.mp4").exists()


def test_paraview(tmp_path):
    import pyvista

    test, prediction = made()
    write_test_paraview(test, tmp_path / "t.pvd", prediction=prediction, window=30.0)
    listed = re.findall(r'timestep="(\S+)".*file="(\S+)"', (tmp_path / "t.pvd").read_text())
    assert [float(bar) for bar, _ in listed] == pytest.approx([1.0, 2.0, 3.0])
    grid = pyvista.read(tmp_path / listed[-1][1])
    np.testing.assert_array_equal(grid.points, test.blocks[0].reference)
    data = grid.point_data
    np.testing.assert_array_equal(data["displacement_mm"], test.blocks[0].displacement[2])
    np.testing.assert_allclose(data["residual_mm"], np.tile([0.01, 0.02, 0.5], (grid.n_points, 1)))
    assert {"strain_xx", "curvature_xy_per_mm", "tension_N_per_mm", "stress_MPa"} <= {*data}
    centre = int(np.hypot(*grid.points[:, :2].T).argmin())
    cloud = Cloud(test, window=30.0)
    assert data["stress_MPa"][centre] == pytest.approx(cloud.value("stress", 2)[centre])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"field": "speed"}, "field 'speed' is unknown; choose from dx, dy, dz, strain_xx"),
        ({"field": "residual_dz"}, "takes a model"),
        ({"frame": 7}, "frames 0 to 2"),
        ({"prediction": (np.zeros((1, 2, 3)),)}, "must match the blocks"),
        ({"field": "tension", "window": 5.0}, "too few points in a window"),
    ],
)
def test_what_cannot_be_shown(options, message, tmp_path):
    with pytest.raises(InputError, match=message):
        show(made()[0], tmp_path / "a.png", **options)
    assert not list(tmp_path.iterdir())


def test_points_that_make_no_surface(tmp_path):
    line = np.column_stack([np.linspace(-50, 50, 9), np.zeros(9), np.zeros(9)])
    test = BulgeTest.from_arrays(line, np.ones((1, 9, 3)), [0.1], name="line")
    with pytest.raises(InputError, match="line: frame 0 has 9 wholly measured points, which make"):
        show(test, tmp_path / "a.png")


@pytest.mark.parametrize("options", [{}, {"field": "stress", "window": 30.0}])
def test_profiles_make_no_surface_by_any_window(options, tmp_path):
    axis = np.linspace(-95, 95, 101)
    cross = np.zeros((202, 3))
    cross[:101, 0] = cross[101:, 1] = axis
    moved = np.zeros((2, 202, 3))
    moved[..., 2] = np.multiply.outer([10.0, 20.0], 1 - (cross**2).sum(axis=1) / 1e4)
    test = BulgeTest.from_arrays(cross, moved, [0.1, 0.2], name="cross")
    for draw, name in ((show, "a.png"), (animate, "a.gif")):
        with pytest.raises(
            InputError, match="make no surface: single ones, or profiles; bulgefit f"
        ):
            draw(test, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_frame_without_points_is_named(tmp_path):
    test, _ = made()
    moved = test.blocks[0].displacement.copy()
    moved[1] = np.nan
    lost = BulgeTest.from_arrays(test.blocks[0].reference, moved, test.pressure)
    for options in ({}, {"field": "strain_xx"}):
        with pytest.raises(InputError, match="frame 1 has no point at which dx, dy and dz were"):
            show(lost, tmp_path / "a.png", frame=1, **options)


def test_verb(opengl, tmp_path, capsys):
    file = str(tmp_path / "t.npz")
    write_test(made()[0], file)
    out = tmp_path / "a.png"
    assert main(["show", file, str(out), "--quiet"]) == 0
    assert out.exists()
    model = ["--E1", "330", "--E2", "240", "--G12", "30"]
    assert main(["show", file, str(tmp_path / "b.png"), "--field", "residual_dx", *model]) == 0
    assert imread(tmp_path / "b.png").std() > 0.02
    capsys.readouterr()
    for words, message in (
        ([str(out)], "exists; use --force"),
        ([str(tmp_path / "a.avi")], "ends in .png, .gif, .mp4 or .pvd"),
        ([str(tmp_path / "a.gif"), "--frame", "1"], "a .gif holds all frames"),
        ([str(tmp_path / "c.png"), "--hold", "clamp_slip.compliance=0.01"], "give a material too"),
        ([str(tmp_path / "c.png"), "--field", "residual_dx"], "takes a model"),
    ):
        assert main(["show", file, *words, "--quiet"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert message in line


def test_pictures_tell_the_unit(opengl, monkeypatch):
    said = []
    write = _off_screen.add_text
    monkeypatch.setattr(_off_screen, "add_text", lambda *w: (said.append(w[1]), write(*w)))
    show(made()[0], field="strain_xx")
    assert said[1:] == ["measured strain_xx (mm/mm)"]


def test_all_fields_have_a_unit():
    assert {*FIELDS.values()} == {"mm", "1", "1/mm", "N/mm", "MPa"}
    assert [*RESIDUALS.values()] == [*FIELDS.values()]
