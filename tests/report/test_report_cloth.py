"""Is what a diagnosis says of the cloth told: its law, how specimens differ, the shape at rest?"""

from __future__ import annotations

import json
from copy import deepcopy
from itertools import pairwise

import numpy as np
import pytest

from bulgefit.report._diagnosis_markdown import as_markdown
from bulgefit.report.page.blocks import Block
from bulgefit.report.page.law_chart import law_chart
from bulgefit.report.page.of_diagnosis import page_of_diagnosis
from bulgefit.report.page.page import page_html
from bulgefit.report.record import record_of
from bulgefit.report.words.blocks import blocks_of
from bulgefit.report.words.names import budget_labels
from bulgefit.report.words.next import advice_items
from bulgefit.report.words.table import table

STRAIN = np.array([0.005, 0.01, 0.015, 0.02, 0.025, 0.03, 0.05])
WARP, FILL = 200.0 * (STRAIN - 4.0 * STRAIN**2), 120.0 * STRAIN


@pytest.fixture(scope="session")
def family(pair):
    """As it comes from a file."""
    return json.loads(json.dumps(record_of(pair)))


@pytest.fixture
def bent(family):
    """Had the cloth a bent law, of which 2.3 % along warp and 0.7 % along fill were reached."""
    record = deepcopy(family)
    record["law"] = law = {
        "strain": STRAIN.tolist(),
        "warp_N_per_mm": WARP.tolist(),
        "fill_N_per_mm": FILL.tolist(),
        "stderr": {
            "warp_N_per_mm": (0.01 * WARP).tolist(),
            "fill_N_per_mm": (0.02 * FILL).tolist(),
        },
        "reached": {"warp": 0.0234, "fill": 0.0071},
    }
    at = [int(np.argmin(np.abs(STRAIN - s))) for s in (0.01, 0.02, 0.03, 0.05)]
    record["parameters"]["corrected"]["secant"] = {
        "strain": STRAIN[at].tolist(),
        **{
            modulus: {
                "value": (np.array(law[f"{axis}_N_per_mm"])[at] / STRAIN[at]).tolist(),
                "stderr": (np.array(law["stderr"][f"{axis}_N_per_mm"])[at] / STRAIN[at]).tolist(),
                "unit": "MPa",
            }
            for modulus, axis in (("E1", "warp"), ("E2", "fill"))
        },
    }
    return record


def words_of(record):
    """All words of its page, and of the terminal, in lines as long as they are."""
    return as_markdown(page_of_diagnosis(record), []), " ".join(table(record).split())


def numbers(points):
    return np.array([[float(v) for v in p.split(",")] for p in points])


def test_curves_of_the_law_stand_where_forces_are(bent):
    """Read off the drawing by its own ticks."""
    chart = law_chart(bent["law"])
    scale = {}
    for axis in ("x", "y"):
        first, *_, last = chart[f"ticks_{axis}"]
        slope = (float(last["text"]) - float(first["text"])) / (last["at"] - first["at"])
        scale[axis] = (float(first["text"]), first["at"], slope)

    def read(points):
        columns = zip(numbers(points).T, "xy", strict=True)
        return [scale[a][0] + scale[a][2] * (v - scale[a][1]) for v, a in columns]

    warp, fill = chart["lines"]
    pixel = abs(0.06 * scale["y"][2])
    for line, force, reached in ((warp, WARP, 2.34), (fill, FILL, 0.71)):
        strain, seen = read(line["points"])
        assert strain[-1] == pytest.approx(reached, abs=1e-3)
        np.testing.assert_allclose(
            seen, np.interp(strain, [0, *100 * STRAIN], [0, *force]), atol=3 * pixel, rtol=0
        )
        beyond, _ = read(line["beyond"])
        assert (beyond[0], beyond[-1]) == pytest.approx((reached, 5.0), abs=1e-3)
    # the band is 1.96 standard errors on either side
    strain, edge = read(warp["band"])
    upper, lower = edge[: len(edge) // 2], edge[len(edge) // 2 :][::-1]
    inside = strain[: len(upper)] < 2.34
    np.testing.assert_allclose(
        (upper - lower)[inside], 2 * 1.96 * 0.01 * np.array([0, *WARP])[inside], atol=3 * pixel
    )


def test_of_a_bent_law_secants_are_to_be_used(bent):
    page = page_of_diagnosis(bent)
    # the largest strain told that was reached, and the least where none was
    assert [v.name for v in page.answer.values] == ["E1 at 2 % strain", "E2 at 1 % strain", "G12"]
    assert page.answer.values[0].text == "184.0 ± 3.6 MPa"
    assert "E1 at 2 % strain = 184.0 ± 3.6 MPa" in page.answer.headline
    assert any("E1 and E2 by themselves are slopes at rest" in note for note in page.answer.notes)
    markdown, terminal = words_of(bent)
    for text in (markdown, terminal):
        assert "Strains of 2.3 % along warp and 0.71 % along fill were reached" in text
    assert "| E1 | 192.0 ± 1.9 | 184.0 ± 1.8 | (176.0 ± 1.8) | (160.0 ± 1.6) |" in markdown
    assert "E1 192.0 ± 1.9 184.0 ± 1.8 (176.0 ± 1.8) (160.0 ± 1.6)" in terminal
    html = page_html(bent, [None, None])
    assert 'class="law"' in html
    assert "fill: 0.71 % reached" in html


def test_of_a_straight_law_the_moduli_are(found):
    record = record_of(found)
    page = page_of_diagnosis(record)
    assert [v.name for v in page.answer.values] == ["E1", "E2", "G12"]
    for text in words_of(record):
        assert "stress is proportional to the strain" in text
        assert "secant" not in text
        # of one specimen
        assert "specimen to specimen" not in text
        assert "How specimens" not in text


def test_how_specimens_differ(family):
    family = deepcopy(family)
    family["scatter"] = {"E1": 0.0712, "E2": 0.0534, "stderr": {"E1": 0.024, "E2": 0.019}}
    first = family["specimens"][0]
    first["factors"]["E1"] = {"value": 1.0321, "stderr": 0.0042}
    first["effects"] = ["creep"]
    family["specimens"][1]["effects"] = []
    markdown, terminal = words_of(family)
    assert "scatters in E1 by 7.1 ± 2.4 % and E2 by 5.3 ± 1.9 % (standard" in terminal
    assert "same_1: E1 is 1.0321 ± 0.0042 times the cloth's" in terminal
    assert "of its own: creep." in terminal
    assert "| E1 | 7.1 ± 2.4 % |" in markdown
    assert "| same_1 | 1.0321 ± 0.0042 |" in markdown
    assert "| none |" in markdown


def test_heights_before_inflation_are_told_where_the_model_has_any(family):
    family = deepcopy(family)
    family["implied_reference"] = [
        {"test": "same", "apex_mm": 1.234, "stderr": 0.056, "rms_mm": 0.61},
        {"test": "plumb", "apex_mm": 0.0, "stderr": None, "rms_mm": 0.0},
    ]
    markdown, terminal = words_of(family)
    assert "same: before inflation its centre stood 1.234 ± 0.056 mm over the plane" in terminal
    assert "| same | 1.234 ± 0.056 | 0.61 |" in markdown
    assert "plumb" not in terminal
    family["implied_reference"] = family["implied_reference"][1:]
    markdown, terminal = words_of(family)
    assert "before inflation its centre" not in terminal
    assert "The shape before inflation" not in markdown


def test_an_effect_of_several_tests_is_told_once(family):
    record = deepcopy(family)
    for told, name in zip(record["report"]["tests"], ("A", "B"), strict=True):
        told["name"] = name
    moved = {**record["causes"][0], "specimen": 0}
    record |= {
        "verdict": "named",
        "causes": [
            {**moved, "specimen": 1}, {**moved, "effect": "prestrain", "meaning": "slack"},
            {**moved, "specimen": 0}, {**moved, "alternatives": ["registration"]},
        ],
        "indistinguishable": [{"effects": ["rigid_motion", "registration"], "cosine": 0.97}],
        "others": {"rim_lift@1": 0.2, "rim_field@0": 1e-6, "creep": 1e-7, "rim_field@1": 1e-9},
    }  # fmt: skip
    record["report"]["candidates"] = ["specimen_factor", "clamp_slip"]
    record["tried"][-1]["taken"] = "specimen_factor + reference_field"  # in one step
    page, terminal = words_of(record)
    for text in (" ".join(page.split()), terminal):
        assert (
            f"rigid_motion of B and A ({moved['meaning']}), prestrain of A (slack) and one of "
            "rigid_motion or registration of A explain the gap down to the noise."
        ) in text
        assert text.count("rigid_motion looks much like registration (0.97)") == 1
    assert "| rim_lift of B | 0.200 |" in page
    assert "| rim_field of A and B, creep, clamp_slip | below 0.001 each |" in page
    assert "4 weighed and dropped, of which rim_lift of B is the most probable (0.200)" in page


def test_causes_are_told_specimen_by_specimen(family):
    family = deepcopy(family)
    for told, name in zip(family["report"]["tests"], ("A", "B"), strict=True):
        told["name"] = name
    moved = family["causes"][0]
    family["causes"] = [
        {**moved, "specimen": 1, "probability": 0.97, "alternatives": ["registration"]},
        {**moved, "effect": "creep", "specimen": None, "probability": 0.9999},
        {**moved, "effect": "prestrain", "specimen": 1, "probability": 0.5},
    ]
    folds = [block for block in blocks_of(family)["causes"] if block.kind == "fold"]
    assert [fold.lines for fold in folds] == [
        ("all specimens", "creep (over 0.999)"),
        ("B", "rigid_motion or registration (0.970), prestrain (0.500)"),
    ]
    table_of_b, words_of_b = folds[1].inside
    assert [row[0] for row in table_of_b.rows[1:] if row[0]] == [
        "rigid_motion or registration of B", "prestrain of B",
    ]  # fmt: skip
    assert len(words_of_b.lines) == 2


def test_where_the_gap_lies_is_told_test_by_test(family):
    """Each in its fold, which says how much of it there is."""
    family = deepcopy(family)
    for told, name in zip(family["report"]["tests"], ("A", "B"), strict=True):
        told["name"] = name
    cells = family["report"]["cells"]
    counts = {
        kind: [sum(abs(c["significance"]) > 3.0 for c in each) for each in of]
        for kind, of in cells.items()
    }
    assert counts["baseline"] > [0, 0]
    blocks = page_of_diagnosis(family).blocks
    at = blocks.index(Block("heading", ("Where the gap lies",)))
    folds = blocks[at + 1 : at + 3]
    assert [fold.lines for fold in folds] == [
        (name, f"of {len(cells['final'][i])} means beyond 3 standard errors: moduli alone "
               f"{counts['baseline'][i]}, with causes {counts['final'][i]}")
        for i, name in enumerate("AB")
    ]  # fmt: skip
    assert all({"discs", "curves"} <= {b.kind for b in fold.inside} for fold in folds)
    assert f"**B**: {folds[1].lines[1]}." in as_markdown(page_of_diagnosis(family), [])


def advised(record, separations, alternatives=(), **more):
    """The record, were its advice about creep and lens_distortion."""
    names = ("this test alone", "images at rest", "rim points", "hold")
    record = deepcopy(record)
    for told, name in zip(record["report"]["tests"], ("A", "B"), strict=True):
        told["name"] = name
    record["causes"] = [{**record["causes"][0], "alternatives": list(alternatives)}]
    record["advice"] = [
        {"measurement": name, "separation": s, "between": ["creep", "lens_distortion"], **more}
        for name, s in zip(names, separations, strict=False)
    ]
    return record


def test_advice_says_which_test_and_what_its_numbers_are(family):
    size = "lens_distortion, at a tenth of its plausible range, would show by"
    beyond = "standard errors beyond what creep and the moduli can imitate"
    (told,) = advice_items(advised(family, [44.4, 60.0], specimen=1, why=""))
    assert told == (
        "The least sure of what was found is creep, the most probable of what was left out "
        f"lens_distortion. B alone tells them apart: {size} 44 {beyond}. No further measurement is "
        "needed for that."
    )
    rivals = ["lens_distortion"]
    (told,) = advice_items(
        advised(family, [2.0, 9.0, 7.0, 2.0], rivals, specimen=1, why="it is still")
    )
    assert told == (
        "To tell creep from lens_distortion, measure beside B, best first: images at rest (9); rim "
        f"points (7). The first because it is still. In brackets: {size} so many {beyond}; with B "
        "alone by 2."
    )
    # as an earlier version wrote it
    (told,) = advice_items(advised(family, [2.0, 9.0], rivals))
    assert "measure beside A, best first: images at rest (9). In brackets" in told
    (told,) = advice_items(advised(family, [2.0, 2.0], rivals, specimen=1, why=""))
    assert told == (
        "No further measurement that was tried would tell creep from lens_distortion better than "
        "B does."
    )
    assert "No two effects compete" in advice_items({**family, "advice": []})[0]


def test_figures_of_a_test_have_its_own_effects_alone(pair):
    effects = [[group.effect for group in step.groups] for step in pair.explanation.steps]
    owners = [{group.specimen for group in step.groups} for step in pair.explanation.steps]
    assert {0} in owners
    assert {1} in owners
    for index in (0, 1):
        ours = [e for names, whose in zip(effects, owners, strict=True)
                if whose & {None, index} for e in names]  # fmt: skip
        figure = pair.plot("signatures", test=index)
        assert [part.get_suptitle() for part in figure.subfigs] == ours[:4]
        titles = [panel.get_title() for panel in pair.plot("modes", test=index).axes]
        assert titles[0] == "radial,\nmoduli alone"
        causes = " + ".join(effect for effect in ours if effect != "specimen_factor")
        assert titles[3] == f"radial,\nwith {causes}"
        assert "@" not in "".join(titles)


def test_titles_of_modes_stay_in_their_panels(pair):
    """Also those of the last column, in the figure as it is written."""
    figure = pair.plot("modes", test=1)
    figure.canvas.draw()
    boxes = [panel.title.get_window_extent() for panel in figure.axes]
    assert max(box.x1 for box in boxes) < figure.bbox.x1
    for left, right in pairwise(boxes):
        assert left.y0 != right.y0 or left.x1 < right.x0


def test_a_part_without_which_nothing_balanced_is_no_offset_of_every_point():
    rows = [("reference_field", []), ("creep", ["rate"]), ("clamp_shape", [])]
    rows += [("clamp_slip", ["radius_error", "compliance"]), ("depth_scale", ["scale_z"])]
    budget = [{"effect": e, "specimen": None, "parameters": p} for e, p in rows]
    assert budget_labels({"report": {"budget": [{}, *budget]}}) == [
        "moduli alone",
        "reference_field (an offset of every point)",
        "creep (rate)",
        "clamp_shape (counted with the next one)",
        "clamp_slip (with those above, 2 parameters)",
        "depth_scale (scale_z)",
    ]
