"""Does the score say what a verdict is worth?"""

from __future__ import annotations

import pytest

from bulgefit.trial.places import judge_place
from bulgefit.trial.reliability import reliability, stated_causes
from bulgefit.trial.right import is_right
from bulgefit.trial.score import judge, score
from bulgefit.trial.shares import share
from bulgefit.trial.table import report


def cause(effect, *alternatives, **more):
    return {"effect": effect, "alternatives": list(alternatives), **more}


def record(effects, verdict, *causes, struck=(), kind=None, **more):
    """A record; a cause is a tuple of effect ids, the rest of it alternatives."""
    kinds = ("none", "one", "two", "several", "several")
    return {
        "file": "t.npz",
        "truth": {
            "kind": kind or kinds[len(effects)],
            "effects": list(effects),
            "parameters": {e: {} for e in effects},
            "moduli": {"E1": 300.0},
            "signature_mm": 0.1,
            "signature_left_mm": 0.05,
        },
        "answer": {
            "verdict": verdict,
            "causes": [c if isinstance(c, dict) else cause(*c) for c in causes],
            **more,
        },
        "struck": list(struck),
    }


SLIP, PRE, TILT = ("clamp_slip",), ("prestrain",), ("rigid_motion",)


def foreign(others, verdict, *causes, place="material", where=None, **more):
    """A record with a soft patch, and others beside it."""
    made = record(("soft_patch", *others), verdict, *causes, kind="foreign", **more)
    made["truth"]["places"] = {"soft_patch": place}
    made["truth"]["where"] = {"soft_patch": where}
    return made


def sure(effect, probability, **more):
    return cause(effect, probability=probability, **more)


@pytest.mark.parametrize(
    ("case", "right"),
    [
        (record((), "none"), True),
        (record((), "unknown"), False),
        (record((), "named", SLIP), False),
        (record(SLIP, "named", SLIP), True),
        (record(SLIP, "none"), False),
        (record(SLIP, "unknown", SLIP), False),
        (record(SLIP, "named", PRE), False),
        (record(SLIP, "named", SLIP, PRE), False),
        (record(SLIP, "ambiguous", ("prestrain", "clamp_slip")), True),
        (record(SLIP, "ambiguous", ("prestrain", "clamp_slip", "dic_scale")), False),
        (record(SLIP + PRE, "named", SLIP, PRE), True),
        (record(SLIP + PRE, "named", SLIP), False),
        (record(SLIP + PRE, "ambiguous", ("clamp_slip", "prestrain")), False),
        (record(SLIP + PRE, "ambiguous", ("clamp_slip", "prestrain"), SLIP), True),
        (record(SLIP + PRE, "ambiguous", SLIP + PRE, ("clamp_slip", "dic_scale")), True),
        (record(PRE + SLIP, "ambiguous", SLIP + PRE, ("prestrain", "dic_scale")), True),
        (record(PRE + SLIP, "ambiguous", ("dic_scale", "prestrain"), PRE), False),
        (record(("pressure_gain",), "none"), True),
        (record(("pressure_gain",), "named", SLIP), False),
        (record(("poisson_ratio",), "none"), True),
        (record(("poisson_ratio",), "named", ("poisson_ratio",)), True),
        (record(("soft_patch",), "unknown", SLIP, kind="foreign"), True),
        (record(("soft_patch",), "named", SLIP, kind="foreign"), False),
        (record(SLIP, "unknown", PRE, struck=SLIP), True),
        (record(SLIP, "named", PRE, struck=SLIP), False),
        (record(("poisson_ratio",), "unknown", PRE, struck=("poisson_ratio",)), True),
        (record(("dic_scale",), "named", ("clamp_shape",), struck=("dic_scale",)), True),
        (record(("rigid_motion",), "named", ("reference_state",)), False),
        (record(SLIP, "failed", error="broke"), False),
        # three causes and more
        (record(SLIP + PRE + TILT, "named", SLIP, PRE, TILT), True),
        (record(SLIP + PRE + TILT, "named", SLIP, PRE), False),
        (record(SLIP + PRE + TILT, "ambiguous", TILT, SLIP + PRE, ("dic_scale", *SLIP)), True),
        # a probability below 0.95 is no name, and does no harm
        (record(SLIP, "named", sure("clamp_slip", 0.99), sure("prestrain", 0.9)), True),
        (record(SLIP, "named", sure("clamp_slip", 0.94)), False),
        (record(SLIP, "named", sure("clamp_slip", 0.95), sure("prestrain", 0.96)), False),
        (record(SLIP, "partial", SLIP), False),
        (record(PRE, "named", sure("prestrain", 1.0), sure("prestrain", 1.0)), False),
        # a foreign effect, alone and beside others
        (foreign((), "unknown"), True),
        (foreign((), "partial"), True),
        (foreign((), "none"), False),
        (foreign((), "partial", PRE), False),
        (foreign(PRE, "partial", PRE), True),
        (foreign(PRE, "named", PRE), False),
        (foreign(PRE, "unknown", PRE), False),
        (foreign(PRE, "partial", PRE, SLIP), False),
        (foreign(PRE, "partial", PRE, sure("stiffness_gradient", 1.0, place="material")), True),
        (foreign(PRE, "partial", PRE, sure("clamp_slip", 1.0, place="clamp")), False),
    ],
)
def test_what_is_right(case, right):
    assert is_right(case) is right


def test_intervals_are_wilsons():
    # Newcombe (1998), table I: 81 of 263, 15 of 148, 0 of 20
    for hits, of, interval in (
        (81, 263, (0.2553, 0.3662)),
        (15, 148, (0.0624, 0.1605)),
        (0, 20, (0.0, 0.1611)),
    ):
        told = share([True] * hits + [False] * (of - hits))
        assert (told["hits"], told["of"]) == (hits, of)
        assert told["wilson"] == pytest.approx(interval, abs=1e-4)
    assert share([])["wilson"] == [0.0, 1.0]
    assert share([])["share"] is None


def test_causes_are_counted_one_by_one():
    records = [
        record(SLIP + PRE + TILT, "named", SLIP, PRE, ("dic_scale",)),
        record(SLIP, "ambiguous", ("clamp_slip", "prestrain")),
        record(("pressure_gain",), "none"),
        foreign(PRE, "partial", PRE, sure("stiffness_gradient", 1.0, place="material")),
        record((), "named", SLIP),
    ]
    causes = score(records)["causes"]
    assert (causes["found"]["hits"], causes["found"]["of"]) == (4, 5)
    assert (causes["false"]["hits"], causes["false"]["of"]) == (2, 7)
    assert causes["standing_in"] == 1
    assert causes["by_effect"]["rigid_motion"]["hits"] == 0
    assert causes["by_effect"]["clamp_slip"]["hits"] == 2
    assert "pressure_gain" not in causes["by_effect"]


def family(*told):
    """Two specimens of a nonlinear cloth: one slips and is slack, the other slips."""
    law = ("nonlinear_material",)
    made = record(("nonlinear_material", *SLIP, *PRE), "named", *told, kind="family")
    made["truth"]["specimens"] = [
        {"name": "a", "effects": [*law, *SLIP, *PRE]},
        {"name": "b", "effects": [*law, *SLIP]},
    ]
    return made


LAW = sure("nonlinear_material", 1.0, specimen=None)
OWN = tuple(sure("clamp_slip", 1.0, specimen=number) for number in (0, 1))
SLACK = sure("prestrain", 1.0, specimen=0)
PAIRS = tuple(
    cause(one, "prestrain", probability=0.8, specimen=0) for one in ("pressure_offset", "dic_scale")
)


@pytest.mark.parametrize(
    ("told", "right", "found", "false"),
    [
        ((LAW, *OWN, SLACK), True, 4, 0),
        # of another specimen, of one that is none, of the cloth
        ((LAW, *OWN, SLACK, sure("prestrain", 1.0, specimen=1)), False, 4, 1),
        ((LAW, *OWN, sure("prestrain", 1.0, specimen=1)), False, 3, 1),
        ((LAW, *OWN, sure("prestrain", 1.0, specimen=2)), False, 3, 1),
        ((LAW, *OWN, sure("prestrain", 1.0, specimen=None)), False, 3, 1),
        # one specimen's is missing
        ((LAW, OWN[0], SLACK), False, 3, 0),
        # in a set of two
        ((LAW, *OWN, PAIRS[0]), True, 4, 0),
        ((LAW, *OWN, SLACK, PAIRS[1]), False, 4, 1),
    ],
)
def test_specimens_have_causes_of_their_own(told, right, found, false):
    made = family(*told)
    assert is_right(made) is right
    causes = score([made])["causes"]
    assert (causes["found"]["hits"], causes["found"]["of"]) == (found, 4)
    assert (causes["false"]["hits"], causes["false"]["of"]) == (false, len(told))
    assert causes["by_effect"]["clamp_slip"]["of"] == 2


def test_what_is_stated_of_another_specimen_is_not_there():
    stated = stated_causes([family(LAW, OWN[0], sure("prestrain", 0.9, specimen=1), PAIRS[0])])
    assert stated == [(1.0, True), (1.0, True), (0.9, False), (0.8, True)]


def test_causes_are_told_by_their_size():
    """Noise of 6, 6 and 14.5 µm is 16.8 µm together."""
    found = record(SLIP + PRE, "named", SLIP)
    found["truth"]["noise_mm"] = [0.006, 0.006 * (35 / 6) ** 0.5]
    found["truth"]["signatures"] = {
        "clamp_slip": {"signature_left_mm": 0.1},
        "prestrain": {"signature_left_mm": 0.01},
    }
    bands = score([found])["causes"]["by_size"]
    assert [(b["from"], b["to"], b["hits"], b["of"]) for b in bands] == [
        (0.3, 1.0, 0, 1),
        (3.0, 10.0, 1, 1),
    ]


def field(place, probability=0.99, share_of_gap=0.5, **where):
    return {
        "place": place,
        "probability": probability,
        "share_of_gap": share_of_gap,
        "where": where,
    }


POINT = {"x_mm": 10.0, "y_mm": -20.0}
LINE = {"normal_degree": 90.0, "distance_mm": -20.0}
SECTOR = {"angle_degree": 350.0, "half_width_degree": 30.0}


@pytest.mark.parametrize(
    ("where", "fields", "judged"),
    [
        (None, [field("material")], {"place": True}),
        (None, [field("clamp")], {"place": False}),
        (None, [], {"place": False}),
        (None, [field("material", 0.9)], {"place": False}),
        # the one that explains most leads
        (None, [field("clamp", 0.99, 0.1), field("material", 0.99, 0.4)], {"place": True}),
        (None, [field("clamp", 0.99, 0.5), field("material", 0.99, 0.4)], {"place": False}),
        (None, [{**field("camera"), "alternatives": ["material"]}], {"place": True}),
        (None, [{**field("camera"), "alternatives": ["material", "load"]}], {"place": False}),
        (POINT, [field("material", x_mm=14.0, y_mm=-14.0)], {"place": True, "spot": True}),
        (POINT, [field("material", x_mm=16.0, y_mm=-14.0)], {"place": True, "spot": False}),
        (POINT, [field("clamp", x_mm=10.0, y_mm=-20.0)], {"place": False, "spot": False}),
        (POINT, [field("material")], {"place": True, "spot": False}),
        (LINE, [field("material", x_mm=70.0, y_mm=-27.0)], {"place": True, "spot": True}),
        (LINE, [field("material", x_mm=0.0, y_mm=-29.0)], {"place": True, "spot": False}),
        (SECTOR, [field("material", angle_degree=15.0)], {"place": True, "spot": True}),
        (SECTOR, [field("material", angle_degree=-45.0)], {"place": True, "spot": False}),
        (SECTOR, [field("material", x_mm=50.0, y_mm=10.0)], {"place": True, "spot": True}),
        (SECTOR, [field("material", x_mm=-50.0, y_mm=8.0)], {"place": True, "spot": False}),
    ],
)
def test_where_a_foreign_effect_is_looked_for(where, fields, judged):
    made = foreign(PRE, "partial", PRE, where=where, fields=fields)
    assert judge_place(made) == judged
    assert judge(made)["place_right"] == judged
    scores = score([made])
    assert scores["places"]["hits"] == judged["place"]
    assert scores["spots"]["of"] == ("spot" in judged)


def test_answers_without_fields_are_not_judged_by_them():
    made = foreign((), "unknown")
    assert judge_place(made) is None
    assert score([made])["places"]["of"] == 0
    assert judge_place(record(SLIP, "named", SLIP, fields=[])) is None


def test_fields_of_what_is_innocent_are_false():
    records = [
        record(SLIP, "partial", SLIP, fields=[field("material")]),
        record(SLIP, "named", SLIP, fields=[field("material", 0.5)]),
        record((), "none"),
    ]
    scores = score(records)
    assert (scores["false_fields"]["hits"], scores["false_fields"]["of"]) == (1, 3)


def test_stated_probabilities_meet_true_shares():
    stated = [(0.97, True)] * 9 + [(0.97, False)] + [(0.3, True), (0.4, False), (1.0, True)]
    told = reliability(stated)
    spans = [(b["from"], b["to"], b["of"], b["hits"]) for b in told["bins"]]
    assert spans == [(0.25, 0.5, 2, 1), (0.95, 0.99, 10, 9), (0.99, 1.0, 1, 1)]
    assert [b["stated"] for b in told["bins"]] == pytest.approx([0.35, 0.97, 1.0])
    assert told["error"] == pytest.approx((2 * 0.15 + 10 * 0.07) / 13)
    assert reliability([]) == {"bins": [], "error": None}


def test_reliability_of_causes_and_fields():
    records = [
        record(SLIP, "named", sure("clamp_slip", 0.99), sure("prestrain", 0.2)),
        foreign((), "partial", fields=[field("material", 0.8), field("clamp", 0.1)]),
        record(SLIP, "named", SLIP),
    ]
    scores = score(records)["reliability"]
    assert [(b["hits"], b["of"]) for b in scores["causes"]["bins"]] == [(0, 1), (1, 1)]
    assert [(b["hits"], b["of"]) for b in scores["fields"]["bins"]] == [(0, 1), (1, 1)]
    assert "stated probability" in report(score(records))


def test_what_stands_in_for_a_foreign_effect_is_neither_true_nor_false():
    there = sure("prestrain", 0.99, place="material")
    in_place = sure("stiffness_gradient", 0.97, place="material")
    elsewhere = sure("clamp_slip", 0.8, place="clamp")
    made = foreign(PRE, "partial", there, in_place, elsewhere)
    assert stated_causes([made]) == [(0.99, True), (0.8, False)]


def clothed(warp, fill, stderr):
    made = record(PRE, "named", PRE, kind="family")
    strain = [0.01, 0.02, 0.03, 0.05]
    made["truth"]["law"] = {
        "strain": strain,
        "warp_N_per_mm": [100 * e for e in strain],
        "fill_N_per_mm": [50 * e for e in strain],
    }
    wide = [0.0, *strain, 0.06]
    made["answer"]["law"] = {
        "strain": wide,
        "warp_N_per_mm": [warp * e for e in wide],
        "fill_N_per_mm": [fill * e for e in wide],
        "stderr": stderr,
    }
    return made


TIGHT, LOOSE = [0.001 * n for n in range(6)], [0.1 * n for n in range(6)]


@pytest.mark.parametrize(
    ("warp", "fill", "stderr", "met"),
    [
        (101.0, 49.5, LOOSE, True),
        (103.0, 49.5, LOOSE, False),
        (101.0, 48.5, LOOSE, False),
        (101.0, 49.5, {"warp_N_per_mm": LOOSE, "fill_N_per_mm": LOOSE}, True),
        (101.0, 50.0, {"warp_N_per_mm": TIGHT, "fill_N_per_mm": LOOSE}, False),
    ],
)
def test_a_law_is_met_within_its_errors_and_two_percent(warp, fill, stderr, met):
    scores = score([clothed(warp, fill, stderr)])
    assert scores["laws"]["hits"] == met
    assert scores["families"]["hits"] == 1


def test_a_law_that_ends_too_soon_is_not_met():
    made = clothed(100.0, 50.0, LOOSE)
    for key in ("strain", "warp_N_per_mm", "fill_N_per_mm", "stderr"):
        made["answer"]["law"][key] = made["answer"]["law"][key][:4]
    assert score([made])["laws"]["hits"] == 0


def full(value, stderr, modulus, after):
    case = record(("clamp_slip",), "named", SLIP)
    case["truth"]["parameters"]["clamp_slip"] = {"compliance": 0.02}
    case["answer"]["causes"][0]["parameters"] = {
        "clamp_slip.compliance": {"value": value, "stderr": stderr, "unit": "mm per N/mm"}
    }
    case["answer"]["parameters"] = {"corrected": {"E1": {"value": modulus, "stderr": 1.0}}}
    case["answer"]["gap"] = {
        "heldout": {"baseline": {"e": 0.3}, "explained": {"e": after}},
        "noise_floor": {"e": 0.02},
    }
    return case


def test_errors_and_gaps():
    scores = score([full(0.021, 0.0005, 302.0, 0.022), full(0.03, 0.001, 310.0, 0.03)])
    errors = scores["parameters"]
    assert errors["within_3_stderr"]["hits"] == 1
    assert errors["median_stderrs"] == pytest.approx(6.0)
    assert errors["median_relative"] == pytest.approx(0.275)
    assert errors["by_effect"]["clamp_slip"]["within_3_stderr"]["of"] == 2
    assert scores["moduli"]["within_3_stderr"]["hits"] == 1
    held = scores["heldout"]
    assert held["before_mm"] == pytest.approx(0.3)
    assert held["median_ratio"] == pytest.approx(1.3)
    assert held["closed"]["hits"] == 1


def test_errors_of_vectors_compare_like_with_like():
    case = record(("rigid_motion",), "named", ("rigid_motion",))
    case["truth"]["parameters"]["rigid_motion"] = {
        "rotation_x": 0.001,
        "rotation_y": 0.5,
        "shift_x": 2.0,
    }
    case["answer"]["causes"][0]["parameters"] = {
        "rotation_x": {"value": 0.051, "stderr": 0.1},
        "rotation_y": {"value": 0.5, "stderr": 0.1},
        "shift_x": {"value": None, "stderr": None},
    }
    assert score([case])["parameters"]["median_relative"] == pytest.approx(0.05)


def test_figures_and_table():
    records = [
        record((), "none"),
        record((), "named", SLIP),
        record(SLIP, "named", SLIP),
        record(SLIP, "none"),
        record(("camera_drift",), "unknown", kind="foreign"),
        record(SLIP, "unknown", struck=SLIP),
        record(("creep",), "unknown", ("creep",)),
        record(PRE, "failed", error="broke"),
    ]
    scores = score(records)
    assert scores["false_alarms"]["hits"] == 1
    assert scores["false_alarms"]["of"] == 2
    assert (scores["found"]["hits"], scores["found"]["of"]) == (1, 4)
    assert scores["foreign_unknown"]["share"] == 1.0
    assert scores["struck_right"]["share"] == 1.0
    assert scores["failed"] == 1
    assert scores["confusion"]["none"] == {"clamp_slip": 1, "none": 1}
    assert scores["confusion"]["clamp_slip, struck"] == {"unknown": 1}
    slip = scores["detectable"]["clamp_slip"]
    assert (slip["found"], slip["tests"]) == (1, 2)
    assert slip["smallest_found_mm"] == slip["largest_missed_mm"] == 0.1
    assert scores["detectable"]["creep"]["found"] == 0  # a part of what is unknown is no find
    text = report(scores)
    assert "1/2 = 50.0 %" in text
    assert "largest missed" in text
    assert report(score([record((), "none")])).startswith("1 made tests")


def test_a_set_is_sure_though_none_of_it_is():
    """Alternatives are told where they make a sure set; without any, 0.62 is open."""
    pair = cause("frame_misalignment", "rigid_motion", probability=0.62)
    alone = cause("frame_misalignment", probability=0.62)
    known = cause("clamp_slip", probability=0.999)
    truth = ("frame_misalignment", "clamp_slip")
    assert is_right(record(truth, "ambiguous", pair, known))
    assert not is_right(record(truth, "ambiguous", alone, known))
    # a set of which none is there is false
    assert not is_right(record(("clamp_slip",), "ambiguous", pair, known))
    assert is_right(record(("clamp_slip",), "ambiguous", alone, known))
