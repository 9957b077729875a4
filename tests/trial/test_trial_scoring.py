"""Does the score say what a verdict is worth?"""

from __future__ import annotations

import pytest

from bulgefit.trial.score import is_right, report, score, wilson


def record(effects, verdict, *causes, struck=(), kind=None, **more):
    """A record; a cause is a tuple of effect ids, the rest of it alternatives."""
    kinds = ("none", "one", "two")
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
            "causes": [{"effect": c[0], "alternatives": list(c[1:])} for c in causes],
            **more,
        },
        "struck": list(struck),
    }


SLIP, PRE = ("clamp_slip",), ("prestrain",)


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
    ],
)
def test_what_is_right(case, right):
    assert is_right(case) is right


def test_wilson_interval():
    # Newcombe (1998), table I: 81 of 263, 15 of 148, 0 of 20
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=1e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)


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
        record(("lobed_rim",), "unknown", kind="foreign"),
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
