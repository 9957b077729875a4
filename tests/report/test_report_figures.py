"""Are the figures and pictures drawn, whole, and not blank?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from bulgefit.cli.main import main
from bulgefit.dic import BulgeTest
from bulgefit.dic.surface.measured import measure
from bulgefit.errors import BulgefitError, InputError
from bulgefit.fem.mesh import disc
from bulgefit.report import _figure, _off_screen, profiles, residuals
from bulgefit.report.fields import plot_fields
from bulgefit.report.measured import plot_apex, plot_measured, plot_rings
from bulgefit.report.profiles import plot_profiles
from bulgefit.report.residuals import plot_residuals

PLOTS = (plot_profiles, plot_residuals)


def made(spacing=8.0, frames=6, lost=0.0):
    axis = np.arange(-96, 97, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < 97
    x, y = x[inside], y[inside]
    pressure = np.linspace(0.05, 0.3, frames)
    shape = 1 - (x**2 + y**2) / 1e4
    rise = 60 * np.cbrt(pressure)[:, None] * shape
    displacement = np.stack([1e-3 * rise * x, 2e-3 * rise * y, rise], axis=-1)
    prediction = displacement + np.array([0.01, 0.02, 0.5])
    rng = np.random.default_rng(4)
    displacement[rng.random(displacement.shape[:2]) < lost] = np.nan
    reference = np.column_stack([x, y, np.zeros_like(x)])
    return BulgeTest.from_arrays(reference, displacement, pressure, name="made"), (prediction,)


def not_blank(path):
    image = imread(path)[..., :3]
    assert image.shape[0] > 300
    assert image.std() > 0.03
    # something is drawn in every quarter
    for rows in np.array_split(image, 2):
        for part in np.array_split(rows, 2, axis=1):
            assert part.std() > 0.01


@pytest.mark.parametrize("plot", PLOTS)
@pytest.mark.parametrize("options", [{}, {"lost": 0.3}, {"frames": 1}, {"spacing": 2.0}])
def test_figures_are_drawn(plot, options, tmp_path):
    test, prediction = made(**options)
    plot(test, prediction, tmp_path / "f.png", label="fit of e_w")
    not_blank(tmp_path / "f.png")
    assert [path.name for path in tmp_path.iterdir()] == ["f.png"]


@pytest.mark.parametrize("plot", PLOTS)
def test_figures_of_frames_with_points_of_their_own(plot, tmp_path):
    rng = np.random.default_rng(5)
    frames = []
    for n in (300, 400, 350):
        points = np.column_stack([rng.uniform(-60, 60, (n, 2)), np.zeros(n)])
        frames.append((points, rng.normal(size=(n, 3))))
    test = BulgeTest.from_frames(frames, [0.1, 0.2, 0.3])
    assert len(test.blocks) == 3
    plot(test, tuple(0.5 * block.displacement for block in test.blocks), tmp_path / "f.png")
    not_blank(tmp_path / "f.png")


@pytest.mark.parametrize("plot", PLOTS)
@pytest.mark.parametrize("name", ["caf\udce9", r"a$\b$"])
def test_figures_of_tests_of_any_name(plot, name, tmp_path):
    test, prediction = made(frames=2)
    plot(replace(test, name=name), prediction, tmp_path / "f.png")
    not_blank(tmp_path / "f.png")


@pytest.mark.parametrize("plot", PLOTS)
@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_figures_repeat(plot, suffix, tmp_path):
    test, prediction = made(frames=2)
    for name in ("a", "b"):
        plot(test, prediction, tmp_path / f"{name}.{suffix}")
    if suffix != "svg":  # its ids are random
        assert (tmp_path / f"a.{suffix}").read_bytes() == (tmp_path / f"b.{suffix}").read_bytes()


@pytest.mark.parametrize("plot", PLOTS)
def test_figures_that_cannot_be(plot, tmp_path):
    test, prediction = made(frames=2)
    with pytest.raises(InputError, match=r"ends in \.png"):
        plot(test, prediction, tmp_path / "f.txt")
    (tmp_path / "f.png").touch()
    with pytest.raises(InputError, match="exists"):
        plot(test, prediction, tmp_path / "f.png")
    plot(test, prediction, tmp_path / "f.png", force=True)
    with pytest.raises(InputError, match="must match the blocks"):
        plot(test, (prediction[0][:1],), tmp_path / "g.png")
    with pytest.raises(InputError, match="must match the blocks"):
        plot(test, (), tmp_path / "g.png")


def test_legends_give_the_mean_squared_error():
    test, prediction = made()
    figure = plot_profiles(test, prediction)
    panels = figure.axes
    assert [panel.get_title() for panel in panels] == [
        "dz along y = 0", "dx along y = 0", "dz along x = 0", "dy along x = 0",
    ]  # fmt: skip
    for panel, error in zip(panels, (0.25, 1e-4, 0.25, 4e-4), strict=True):
        texts = [text.get_text() for text in panel.get_legend().get_texts()]
        assert len(texts) == profiles.PRESSURES
        assert texts[0].startswith("3 bar")
        assert all(text.endswith(f"MSE {error:.3g} mm²") for text in texts)
        assert "(mm)" in panel.get_xlabel()
        assert "(mm)" in panel.get_ylabel()
    assert "within 4 mm of the line" in figure.get_suptitle()


def test_maps_share_their_colours_and_say_the_rms():
    """What is measured above the model is positive."""
    test, prediction = made()
    figure = plot_residuals(test, prediction)
    maps = [panel for panel in figure.axes if panel.get_title()]
    residual = np.median(test.blocks[0].displacement - prediction[0], axis=(0, 1))
    for panel, expected in zip(maps[:3], residual, strict=True):
        drawn = np.asarray(panel.collections[0].get_array())
        np.testing.assert_allclose(np.median(drawn), expected)
    assert len(maps) == 3 * residuals.PRESSURES
    assert all("rms 0.5 mm" in panel.get_title() for panel in maps[2::3])
    assert {panel.collections[0].get_clim() for panel in maps[0::3]} == {(-0.01, 0.01)} or all(
        np.allclose(panel.collections[0].get_clim(), (-0.01, 0.01)) for panel in maps[0::3]
    )


def test_components_that_were_not_measured(tmp_path, monkeypatch):
    test, prediction = made()
    block = test.blocks[0]
    displacement = block.displacement.copy()
    displacement[..., :2] = np.nan
    alone = BulgeTest.from_arrays(block.reference, displacement, test.pressure)
    for plot in PLOTS:
        plot(alone, prediction, tmp_path / f"{plot.__name__}.png")
        not_blank(tmp_path / f"{plot.__name__}.png")


def test_one_point_at_the_apex(tmp_path):
    test = BulgeTest.from_arrays(np.zeros((1, 3)), np.ones((3, 1, 3)), [0.1, 0.2, 0.3])
    for plot in PLOTS:
        plot(test, (np.zeros((3, 1, 3)),), tmp_path / f"{plot.__name__}.png")


def test_spread_of_pressures():
    pressure = np.array([0.3, 0.01, 0.02, 0.11, 0.2, 0.29])
    assert _figure.spread(np.arange(6), pressure, 3) == [3, 4, 0]
    assert _figure.spread(np.arange(0), pressure, 3) == []
    assert _figure.spread(np.array([2]), pressure, 3) == [2]


@pytest.fixture
def opengl():
    try:
        _off_screen.require_opengl()
    except BulgefitError as error:
        pytest.skip(str(error))


def test_picture(opengl, tmp_path, capsys):
    file = tmp_path / "p.png"
    words = ["simulate", "--E", "250", "--refine", "2", "--pressure", "2", "--quiet"]
    assert main([*words, "--picture", str(file)]) == 0
    not_blank(file)
    assert capsys.readouterr().err == ""
    assert main([*words, "--picture", str(file)]) == 2


def test_no_opengl(monkeypatch, tmp_path):
    monkeypatch.setattr(_off_screen.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(_off_screen, "_egl_devices", lambda: 0)
    mesh = disc(100.0, 1)
    with pytest.raises(BulgefitError, match="apt-get install libegl1"):
        plot_fields(mesh.nodes, mesh.cells, np.zeros((len(mesh.nodes), 3)), tmp_path / "p.png")
    assert not list(tmp_path.iterdir())


MEASURED = (plot_apex, plot_rings, plot_measured)


@pytest.fixture(scope="module")
def bulge():
    return measure(made()[0], window=40.0)


@pytest.mark.parametrize("plot", MEASURED)
def test_figures_of_what_was_measured(plot, bulge, tmp_path):
    figure = plot(bulge)
    assert isinstance(figure, Figure)
    for suffix in ("png", "pdf", "svg"):
        plot(bulge, tmp_path / f"f.{suffix}")
    not_blank(tmp_path / "f.png")
    labels = {text for panel in figure.axes for text in (panel.get_xlabel(), panel.get_ylabel())}
    assert any(text.endswith(("mm)", "MPa)")) for text in labels)
    with pytest.raises(InputError, match="exists"):
        plot(bulge, tmp_path / "f.png")
    assert "made" in figure.get_suptitle()


def test_maps_of_a_frame_that_is_not_there(bulge):
    assert "3 bar" in plot_measured(bulge).get_suptitle()
    assert "0.5 bar" in plot_measured(bulge, frame=0).get_suptitle()
    for frame in (6, "last"):
        with pytest.raises(InputError, match="frames 0 to 5"):
            plot_measured(bulge, frame=frame)
