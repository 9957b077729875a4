"""Is what has no name told place by place, and drawn where it sits?"""

from __future__ import annotations

import json
import re
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from bulgefit.effects.fields.base import Sampled
from bulgefit.effects.parameter import Owned
from bulgefit.gap.causes import Verdict
from bulgefit.gap.explanation import Evidence, FoundField
from bulgefit.report.page.field_charts import field_chart
from bulgefit.report.page.page import page_html
from bulgefit.report.record import record_of
from bulgefit.report.words.table import table

ANGLE = np.arange(0.0, 360.0, 1.0)
GRID = np.stack(np.meshgrid(*2 * [np.linspace(-100.0, 100.0, 31)]), axis=-1).reshape(-1, 2)
GRID = GRID[np.hypot(*GRID.T) <= 100.0]
SPOT = -0.4 * np.exp(-((GRID - (30.0, 40.0)) ** 2).sum(axis=1) / (2 * 20.0**2))


def fields_of(specimen):
    """A soft spot, a rim that slips on one side, a law that bends, and a gauge that is off."""
    strain = np.tile(np.linspace(0.01, 0.08, 8), 2)
    axis = np.repeat([0.0, 90.0], 8)
    bar = np.array([0.5, 2.5, 1.5])
    told = {
        "stiffness_field": Sampled(SPOT, dict(zip(("x_mm", "y_mm"), GRID.T, strict=True))),
        "slip_field": Sampled(0.5 * np.cos(np.deg2rad(ANGLE - 90.0)), {"angle_degree": ANGLE}),
        "law_curve": Sampled(
            strain * np.where(axis > 0, -2.0, 1.0), {"strain": strain, "from_warp_degree": axis}
        ),
        "pressure_field": Sampled(0.01 * bar, {"pressure_bar": bar}),
        "coupling_field": Sampled(
            np.array([0.02, -0.1]), {"from_warp_degree": np.array([0.0, 90.0])}
        ),
    }
    return [
        FoundField(Owned(name, specimen), sampled, np.full_like(sampled.values, 0.01))
        for name, sampled in told.items()
    ]


@pytest.fixture(scope="module")
def unnamed(pair):
    """A diagnosis of two tests, the second with all of them."""
    found = fields_of(1)
    evidence = {f.group: Evidence(0.999, (), None, {}) for f in found}
    explanation = replace(
        pair.explanation, fields=found, evidence={**pair.explanation.evidence, **evidence}
    )
    return replace(pair, verdict=Verdict.PARTIAL, explanation=explanation)


@pytest.fixture(scope="module")
def record(unnamed):
    return json.loads(json.dumps(record_of(unnamed)))


def cells(path):
    """Centre and size of the rectangles of an outline."""
    found = re.findall(r"M(\S+) (\S+)h(\S+)v(\S+)h(\S+)z", path)
    boxes = np.array(found, dtype=float)
    np.testing.assert_allclose(boxes[:, 4], -boxes[:, 2])
    x, y, width, height = boxes.T[:4]
    return x + width / 2, y + height / 2, width * height


def chart(record, name):
    (found,) = (f for f in record["fields"] if f["field"] == name)
    return field_chart(found, record["report"]["tests"][1]["semi_axes_mm"])


def test_a_spot_is_drawn_where_it_is_and_what_is_not_told_is_grey(record):
    disc = chart(record, "stiffness_field")["disc"]
    told = {name: cells(path) for name, path in disc["paths"].items()}
    assert {*told} == {"n1", "n2", "n3", "n4", "z"}
    x, y, _ = told["n4"]
    # y downwards on the page, on which a millimetre is half a unit
    assert np.hypot(x.mean() - 15.0, y.mean() + 20.0) < 1.5
    # of a Gaussian bump the part over a share c is a disc of area 2πσ² ln(1/c)
    areas = [np.sum(told[name][2]) for name in ("n4", "n3", "n2")]
    exact = [np.pi * 2 * 10.0**2 * np.log(1 / c) for c in (0.75, 0.5, 0.25)]
    np.testing.assert_allclose(np.cumsum(areas), exact, rtol=0.12)
    whole = np.sum([area.sum() for _, _, area in told.values()])
    assert whole == pytest.approx(np.pi * 50.0**2, rel=0.02)
    grey = np.hypot(told["z"][0] - 15.0, told["z"][1] + 20.0)
    assert grey.min() > 10.0 * np.sqrt(2 * np.log(0.4 / 0.02)) - 3.0
    assert (disc["peak"]["x"], disc["peak"]["y"]) == (
        pytest.approx(15, abs=2),
        pytest.approx(-20, abs=2),
    )


def test_curves_have_the_band_that_holds_95_per_cent(record):
    curve = chart(record, "slip_field")["curve"]
    (line,) = curve["lines"]
    points = np.array([p.split(",") for p in line["points"]], dtype=float)
    assert points[90, 1] == points[:, 1].min()  # largest at 90 degrees, upwards
    band = np.array([p.split(",") for p in line["band"]], dtype=float)
    above, below = band[: len(points)], band[len(points) :][::-1]
    scale = (points[270, 1] - points[90, 1]) / 1.0  # of 0.5 to -0.5 mm
    np.testing.assert_allclose(below[:, 1] - above[:, 1], 2 * 1.96 * 0.01 * scale, atol=0.2)
    law = chart(record, "law_curve")["curve"]
    assert [line["label"] for line in law["lines"]] == ["warp", "fill"]
    assert law["named"]
    ends = [float(line["points"][-1].split(",")[1]) for line in law["lines"]]
    assert ends[1] > ends[0]  # fill falls
    gauge = chart(record, "pressure_field")["curve"]["lines"][0]["points"]
    assert [float(p.split(",")[0]) for p in gauge] == [0.0, 150.0, 300.0]  # in order of pressure
    assert chart(record, "coupling_field") is None


def test_at_one_pressure_there_is_no_curve(record):
    (found,) = (deepcopy(f) for f in record["fields"] if f["field"] == "pressure_field")
    found["map"]["pressure_bar"] = [2.5, 2.5, 2.5]
    assert field_chart(found, [100.0, 100.0]) is None


def test_a_page_tells_every_field_and_the_verdict_the_first(record, unnamed):
    html = page_html(record, unnamed.tests)
    assert "What has no name" in html
    assert html.count('class="cloth"') == 1
    assert "stiffness_field (0.999), slip_field (0.999)" in html  # in the fold of the second test
    row = re.search(r"<td>material \(stiffness_field\)</td>.*?</tr>", html, re.DOTALL)
    assert "-0.394 ± 0.010" in row[0]
    assert "(27, 40) mm" in row[0] or "(33, 40) mm" in row[0]
    verdict = re.search(r"Verdict: partial.*?</li>", html, re.DOTALL)[0]
    assert "and in 4 others, of the places" in verdict
    assert "slip_field" not in verdict
    lines = table(record)
    assert lines.count("unnamed: ") == 5
    assert "unnamed: slip_field of same" in lines


def test_what_an_earlier_version_wrote_is_told_without_drawings(record, unnamed):
    old = deepcopy(record)
    for found in old["fields"]:
        del found["map"], found["stderr"]
    html = page_html(old, unnamed.tests)
    assert "material (stiffness_field)" in html
    assert 'class="cloth"' not in html
