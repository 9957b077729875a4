"""Does a page say first what to use, hold what was measured, and escape what stands in files?"""

from __future__ import annotations

import json
import re
from base64 import b64decode
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from bulgefit.dic import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting.quality import Doubt
from bulgefit.report.page.fields import MOST_TESTS, packed, thinned
from bulgefit.report.page.of_crossval import page_of_crossval
from bulgefit.report.page.of_diagnosis import page_of_diagnosis
from bulgefit.report.page.of_fit import page_of_fit
from bulgefit.report.page.page import page_html, verb_of
from bulgefit.report.page.predicted import of_diagnosis, of_fit
from bulgefit.report.record import record_of


@pytest.fixture(scope="session")
def record(found):
    """As it comes from a file."""
    return json.loads(json.dumps(record_of(found)))


def data_of(html):
    """What the page's script reads."""
    return json.loads(re.search(r'id="data">(.*?)</script>', html, re.DOTALL)[1])


def unpacked(numbers, shape):
    steps = np.frombuffer(b64decode(numbers["data"]), "<i2").reshape(shape)
    return np.where(steps == -32768, np.nan, steps * numbers["step"])


def test_maps_hold_what_was_measured_and_what_is_left_of_it(found, record, plate):
    """To half a step of the integers, from the record alone."""
    test = data_of(page_html(record, [plate]))["tests"][0]
    (block,) = test["blocks"]
    shape = (len(test["frames"]), block["count"], 3)
    (own,) = plate.blocks
    rows = [frame["row"] for frame in test["frames"]]
    assert rows == list(range(plate.n_frames))
    kept = block["measured"]
    np.testing.assert_allclose(
        unpacked(kept, shape), own.displacement, atol=0.51 * kept["step"], rtol=0, equal_nan=True
    )
    assert test["models"] == ["moduli alone", "with causes"]
    for fit, kept in zip(
        (found.explanation.baseline, found.explanation.final), block["residuals"], strict=True
    ):
        left = own.displacement - fit.predictions[0].displacement
        # the mesh's error is taken off at this fit, not at that of everything: a twentieth of noise
        np.testing.assert_allclose(
            unpacked(kept, shape), left, atol=0.51 * kept["step"] + 5e-4, rtol=0, equal_nan=True
        )
    triangles = np.frombuffer(b64decode(block["triangles"]), "<u2").reshape(-1, 3)
    corners = own.reference[triangles][..., :2]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert edges.max() < 2.6 * block["spacing"]
    # two triangles for each square between points
    assert len(triangles) > 1.6 * block["count"]


def test_an_offset_of_every_point_is_that_which_leaves_least(plate):
    values = {"E1": 330.0, "E2": 230.0, "G12": 40.0}
    trust = {"judged_bar": (10.0 * plate.pressure).tolist(), "trust": [1.0] * 6}
    plain, offset = (of_diagnosis(plate, values, 0, "hencky", t)[0] for t in (None, trust))
    (block,) = plate.blocks
    left = block.displacement - offset
    np.testing.assert_allclose(np.nanmean(left, axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(offset - plain, (offset - plain)[:1] * np.ones((6, 1, 1)))


def test_maps_of_a_fit_are_those_of_its_parameters(plain, fitted):
    modelled = of_fit(plain, fitted, 0)[0]
    left = plain.blocks[0].displacement - modelled
    means = np.nanmean(np.abs(left), axis=(0, 1))
    told = fitted["tests"][0]
    # its last path had the mesh's error taken off as it is nearby
    off = np.abs(means - [told["dx"], told["dy"], told["dz"]])
    assert (off < 0.1 * np.array(fitted["quality"]["mesh_error_mm"])).all()


@pytest.mark.parametrize("count", [1, MOST_TESTS])
def test_however_much_was_measured_a_page_stays_small(count):
    axis = np.arange(-98, 99, 2.0)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    points = np.column_stack([x, y, 0 * x])[np.hypot(x, y) < 98]
    moved = np.random.default_rng(1).normal(size=(40, len(points), 3))
    test = BulgeTest.from_arrays(points, moved, np.linspace(0.01, 0.3, 40))
    some = thinned(test, count)
    (block,) = some.blocks
    assert len(block.frames) == 12
    assert some.pressure.max() == test.pressure.max()
    models = {k: lambda t: [np.zeros_like(t.blocks[0].displacement)] for k in ("a", "b")}
    size = count * len(json.dumps(packed(some, models)))
    assert size < 2_000_000
    # spread over the whole disc
    assert np.hypot(*block.reference[:, :2].T).max() > 90
    sectors = np.arctan2(block.reference[:, 1], block.reference[:, 0])
    assert np.histogram(sectors, bins=8)[0].min() > 0.09 * len(block.reference)


def test_frames_with_points_of_their_own_and_lost_ones():
    rng = np.random.default_rng(2)
    frames = []
    for _ in range(3):
        points = np.column_stack([rng.uniform(-60, 60, (70, 2)), np.zeros(70)])
        moved = rng.normal(size=(70, 3))
        moved[:5, 2] = np.nan
        frames.append((points, moved))
    test = BulgeTest.from_frames(frames, [0.1, 0.3, 0.2])
    told = packed(thinned(test, 1), {"m": lambda t: [0 * b.displacement for b in t.blocks]})
    assert [round(frame["bar"], 9) for frame in told["frames"]] == [1.0, 2.0, 3.0]
    for frame, index in zip(told["frames"], (0, 2, 1), strict=True):
        block = told["blocks"][frame["block"]]
        seen = unpacked(block["measured"], (1, 70, 3))[frame["row"]]
        np.testing.assert_allclose(seen, frames[index][1], atol=1e-4, equal_nan=True)


def test_the_answer_of_a_diagnosis(record):
    answer = page_of_diagnosis(record).answer
    assert answer.tone == "good"
    assert re.fullmatch(
        r"Use E1 = .* MPa, E2 = .* MPa and G12 = .* MPa \(95 %\)\.", answer.headline
    )
    # twice the standard error, to two digits
    found = record["parameters"]["corrected"]["E1"]
    value, within = re.search(r"E1 = ([\d.]+) ± ([\d.]+) MPa", answer.headline).groups()
    assert float(value) == pytest.approx(found["value"], abs=float(within) / 10)
    assert float(within) == pytest.approx(1.96 * found["stderr"], rel=0.05)

    changed = deepcopy(record)
    changed["parameters"]["corrected"]["G12"]["held"] = True
    changed["parameters"]["corrected"]["E2"]["stderr"] = 100.0
    answer = page_of_diagnosis(changed).answer
    assert answer.tone == "care"
    assert answer.headline.endswith("(95 %); do not use E2 and G12.")
    assert [v.use for v in answer.values] == ["use", "no", "no"]
    changed["verdict"] = "unknown"
    told = " ".join(page_of_diagnosis(changed).answer.notes)
    assert "those of this model, not of the fabric" in told


def test_structure_that_no_cell_shows_is_told_as_what_it_is(record):
    """A pattern that persists is no region beyond three errors, and no larger than noise."""
    changed = deepcopy(record)
    changed["verdict"] = "unknown"
    changed["remainder"]["significant"] = True
    changed["report"]["structure"] = {
        "statistic": 1.0, "threshold": 9.0, "persistent": 0.31, "allowed": 0.12,
    }  # fmt: skip
    for cell in changed["report"]["cells"]["final"][0]:
        cell["significance"] = 1.0
    page = page_html(changed, [None])
    assert "a pattern is left that is no larger than the noise" in page
    assert "it makes 31 % of the variance" in page
    assert "structure is left" not in page
    assert "In all 0 of" not in page


def test_forms_of_an_effect_are_told_apart_in_the_budget(record):
    page = page_html(record, [None])
    assert "rigid_motion (rotation_x to shift_z, 6 parameters)" in page
    changed = deepcopy(record)
    changed["report"]["budget"][1]["parameters"] = ["shift_x"]
    assert "rigid_motion (shift_x)" in page_html(changed, [None])


def test_the_answer_of_a_fit(fitted):
    answer = page_of_fit(fitted).answer
    assert answer.headline.startswith("Use E1 = ")
    assert {v.use for v in answer.values} <= {"use", "care"}
    bounded = deepcopy(fitted)
    bounded["parameters"]["G12"] |= {"at_bound": True, "interval95": None, "stderr": None}
    answer = page_of_fit(bounded).answer
    assert answer.headline.endswith("(95 %); do not use G12.")
    assert "sits at its bound 10 to 100" in answer.values[2].why
    hardly = deepcopy(fitted)
    words = "G12 is hardly found: its standard error is 60 % of it"
    hardly["quality"]["identifiability"]["G12"] = words
    assert page_of_fit(hardly).answer.values[2].use == "no"
    lacking = deepcopy(fitted)
    lacking["quality"]["warnings"].append(Doubt.MODEL_LACKS.of(share="90").__dict__)
    answer = page_of_fit(lacking).answer
    assert (answer.tone, "bulgefit diagnose looks for it" in answer.notes[-1]) == ("care", True)
    assert answer.headline.startswith("Use only with care E1 = ")
    assert {value.use for value in answer.values} == {"care"}


def test_a_test_with_a_fault_gives_nothing_to_use(fitted):
    faulty = deepcopy(fitted)
    faulty["quality"]["warnings"] = [{"code": "swapped_axes", "text": "warp and fill swapped"}]
    answer = page_of_fit(faulty).answer
    assert answer.headline.startswith("Do not use these values")
    assert answer.tone == "bad"
    assert answer.notes[0] == "warp and fill swapped"


def folds(*values):
    return {
        "objective": "e_w", "judged_by": "e_w", "unit": "mm",
        "mean": 0.02, "standard_deviation": 0.001,
        "sources": [], "versions": {},
        "folds": [
            {
                "left_out": f"t{i}", "parameters": {"E1": value, "nu12": 0.24}, "at_bound": [],
                "training": {"objective": "e_w", "value": 0.01},
                "left_out_objectives": {"e": 0.1, "e_w": 0.02, "e_z": None},
            }
            for i, value in enumerate(values)
        ],
    }  # fmt: skip


def test_the_page_of_a_cross_validation():
    answer = page_of_crossval(folds(300.0, 303.0, 306.0)).answer
    assert "within e_w = 0.02 ± 0.001 mm" in answer.headline
    assert (answer.tone, answer.values[0].text) == ("good", "303 ± 3 MPa")
    assert "2 times as far" in answer.notes[0]
    apart = page_of_crossval(folds(100.0, 300.0, 600.0)).answer
    assert "Do not use E1" in apart.notes[-1]
    page = page_html(folds(300.0, 303.0), [None, None])
    assert "without t1" in page
    assert "0.1" in page


def test_the_page_of_a_trial(trial_answer):
    page = page_html(json.loads(json.dumps(trial_answer)), [])
    assert "1 of 2 tests were answered rightly" in page
    assert "clamp_slip" in page
    assert "ab12" in page


def test_what_stands_in_files_is_escaped(record, fitted, plate):
    name = '<script>alert("x")</script>&'
    evil = json.loads(json.dumps(record).replace("plate 1/a", "NAME"))
    evil = json.loads(json.dumps(evil).replace("NAME", json.dumps(name)[1:-1]))
    for page in (
        page_html(evil, [replace(plate, name=name)], notes=[name], where=name),
        page_html({**fitted, "sources": [{**fitted["sources"][0], "name": name}]}, [None]),
    ):
        assert "alert(" in page
        assert "<script>alert" not in page
        assert len(re.findall(r"<script\b", page)) == page.count("</script>") <= 3


def test_a_page_asks_for_nothing(record, plate):
    page = page_html(record, [plate])
    assert "default-src 'none'" in page
    assert not re.findall(r"https?:|src=|@import|fetch\(|XMLHttpRequest|url\((?!#)", page)
    assert re.findall(r'href="([^#"]*)', page)[0] == "data:,"
    assert len(page.encode()) < 3_000_000


def test_how_it_was_made(record, plate):
    run = {"command": "bulgefit diagnose 'a b.npz'", "date": "2025-01-31 10:00:00+01:00",
           "versions": {"bulgefit": "9.9"}}  # fmt: skip
    told = {**record, "run": run}
    told["report"]["tests"][0]["sha256"] = "c0ffee"
    page = page_html(told, [None], where="gap.json")
    for text in ("diagnose &#39;a b.npz&#39;", "2025-01-31 10:00:00", "bulgefit 9.9", "c0ffee",
                 "gap.json"):  # fmt: skip
        assert text in page


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"causes": None}, "damaged, not as bulgefit diagnose writes it"),
        ({"report": None}, "write it by bulgefit diagnose --json"),
    ],
)
def test_a_record_that_is_damaged(record, change, message):
    with pytest.raises(InputError, match=message):
        page_html({**record, **change}, [None], where="gap.json")


def test_json_of_another_kind():
    with pytest.raises(InputError, match=r"x\.json: no result of bulgefit fit, diagnose, crossval"):
        verb_of({"a": 1}, "x.json")
