"""Is an elliptic clamp drawn as the ellipse that it is?"""

from __future__ import annotations

import copy
import json
import re

import numpy as np
import pytest
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from bulgefit.dic import BulgeTest
from bulgefit.gap.data import Data
from bulgefit.gap.residual.structure import Cell
from bulgefit.gap.specimen import Specimen
from bulgefit.report._diagnosis_maps import _draw_disc
from bulgefit.report._diagnosis_parts import draw_points, outer_ticks
from bulgefit.report.page.fields import packed
from bulgefit.report.page.page import page_html
from bulgefit.report.record import record_of
from bulgefit.report.residuals import plot_residuals
from bulgefit.report.show import show

A, B = 100.0, 60.0


def oval(spacing=8.0):
    """A shallow dome over semi-axes of 100 mm along x and 60 mm along y."""
    x, y = (
        g.ravel() for g in np.meshgrid(np.arange(-96, 97, spacing), np.arange(-56, 57, spacing))
    )
    height = 1.0 - (x / A) ** 2 - (y / B) ** 2
    points = np.column_stack([x, y, 0.0 * x])[height > 0.02]
    moved = np.zeros((2, len(points), 3))
    moved[:, :, 2] = np.outer([6.0, 12.0], height[height > 0.02])
    return BulgeTest.from_arrays(points, moved, [0.1, 0.2], radius=80.0, ellipticity=0.25)


def outlines(panel):
    return [(p.width, p.height) for p in panel.patches if isinstance(p, Ellipse)]


@pytest.mark.parametrize("spacing", [8.0, 2.0])
def test_maps_of_a_residual(spacing):
    """Of points, and of means over bins where there are many."""
    test = oval(spacing)
    figure = plot_residuals(test, (np.zeros_like(test.blocks[0].displacement),))
    maps = [panel for panel in figure.axes if panel.get_title()]
    assert len(maps) == 6
    for panel in maps:
        assert outlines(panel) == [(2 * A, 2 * B)]
        assert panel.get_xlim() == pytest.approx((-1.05 * A, 1.05 * A))
        assert panel.get_ylim() == pytest.approx((-1.05 * B, 1.05 * B))
    if spacing == 2.0:
        (mesh,) = maps[-1].collections
        np.testing.assert_allclose(np.abs(mesh.get_coordinates()).max(axis=(0, 1)), (A, B))


def test_maps_of_a_diagnosis():
    test = oval()
    used = np.ones_like(test.blocks[0].displacement, dtype=bool)
    data = Data(Specimen(test, refine=2), np.full(3, 0.01), used)
    panels = Figure().subplots(1, 1, squeeze=False)
    drawn = draw_points(panels[0, 0], data, test.blocks[0].displacement[1, :, 2], 0, 12, "cividis")
    outer_ticks(panels, test.semi_axes)
    assert outlines(panels[0, 0]) == [(2 * A, 2 * B)]
    assert drawn.get_extent() == pytest.approx((-A, A, -B, B))
    assert panels[0, 0].get_xticks()[-1] == pytest.approx(A)
    assert panels[0, 0].get_yticks()[-1] == pytest.approx(B)
    # each pixel shows its own place: the dome's height there, to what 0.9 spacings change of it
    image = drawn.get_array()
    rows, columns = np.indices(image.shape)
    at = [(2 * k + 1) / len(image) - 1 for k in (columns, rows)]
    wanted = 12.0 * (1.0 - at[0] ** 2 - at[1] ** 2)
    assert np.abs(image - wanted).max() < 12.0 * 2 * (0.9 * 8.0 / B)


def test_regions_are_stretched_with_the_clamp():
    panel = Figure(figsize=(4, 4)).subplots()
    cell = Cell("t", "dz", "rim 90°", (0.0, 1.0), 0.1, 0.5, 7.0)
    _draw_disc(panel, {cell.region: cell}, ScalarMappable(), oval().stretch)
    to_data = panel.transData.inverted()
    ends = np.concatenate([to_data.transform_bbox(p.get_window_extent()) for p in panel.patches])
    assert tuple(np.abs(ends).max(axis=0)) == pytest.approx((1.25, 0.75), abs=0.01)
    (text,) = (t for t in panel.texts if t.get_text() == "7.0")
    where = to_data.transform(text.get_transform().transform(text.get_position()))
    assert tuple(where) == pytest.approx((0.0, 0.75 * 0.875), abs=1e-9)


def test_discs_of_a_page(found):
    record = json.loads(json.dumps(record_of(found)))
    assert record["report"]["tests"][0]["semi_axes_mm"] == [100.0, 100.0]
    circle = page_html(record, [None])
    stretched = copy.deepcopy(record)
    stretched["report"]["tests"][0]["semi_axes_mm"] = [A, B]
    ellipse = page_html(stretched, [None])
    scale = re.compile(r'<g transform="scale\((\S+) (\S+)\)">')
    assert {tuple(map(float, s)) for s in scale.findall(circle)} == {(1.0, 1.0)}
    assert {tuple(map(float, s)) for s in scale.findall(ellipse)} == {(1.0, 0.6)}
    number = re.compile(r'<text class="on\d" x="(\S+)" y="(\S+)">\d+</text>')
    round_, flat = (np.array(number.findall(page), dtype=float) for page in (circle, ellipse))
    assert len(round_)
    np.testing.assert_allclose(flat, round_ * (1.0, 0.6), atol=1e-9)
    # an earlier version did not write the clamp
    del record["report"]["tests"][0]["semi_axes_mm"]
    assert page_html(record, [None]) == circle


def test_a_page_and_a_picture_take_the_rim_from_the_test(monkeypatch):
    test = oval()
    assert packed(test, {})["rim"] == [A, B]
    pyvista = pytest.importorskip("pyvista")
    rims = []
    lines = pyvista.MultipleLines
    monkeypatch.setattr(pyvista, "MultipleLines", lambda p: rims.append(p) or lines(p))
    show(test, field="dz")
    assert rims
    for rim in rims:
        np.testing.assert_allclose((rim[:, 0] / A) ** 2 + (rim[:, 1] / B) ** 2, 1.0, atol=1e-12)
        assert tuple(rim.max(axis=0)) == pytest.approx((A, B, 0.0), rel=1e-3)
