"""Is a diagnosis drawn and told, whole, for every verdict?"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

from bulgefit.effects.fields.base import Sampled
from bulgefit.effects.parameter import Owned
from bulgefit.errors import InputError
from bulgefit.gap.causes import Verdict
from bulgefit.gap.effects import SHEAR
from bulgefit.gap.explanation import Evidence, FoundField
from bulgefit.report._diagnosis_charts import plot_cosines
from bulgefit.report._diagnosis_maps import plot_where
from bulgefit.report._diagnosis_markdown import as_markdown
from bulgefit.report.diagnosis import check_report, write_report
from bulgefit.report.numbers import value_text
from bulgefit.report.page.of_diagnosis import page_of_diagnosis
from bulgefit.report.record import budget_of, record_of
from bulgefit.report.words.table import table
from bulgefit.report.words.verdict import verdict_words


def not_blank(path):
    image = imread(path)[..., :3]
    assert min(image.shape[:2]) > 300
    assert image.std() > 0.03


def text_of(diagnosis):
    """All words of its page."""
    return as_markdown(page_of_diagnosis(record_of(diagnosis)), [])


def report_text(diagnosis):
    return table(record_of(diagnosis))


@pytest.fixture(scope="module")
def drawn(found, tmp_path_factory):
    """Folder and files of a report."""
    folder = tmp_path_factory.mktemp("diagnosis") / "new" / "report"
    return folder, write_report(found, folder)


def test_report_of_a_named_cause(found, drawn):
    assert found.verdict == "named"
    folder, files = drawn
    assert {p.name for p in files} == {
        "summary.html",
        "summary.md",
        "budget.png",
        "cosines.png",
        *(
            f"plate_1_a_{kind}.png"
            for kind in (
                "field_dx", "field_dy", "field_dz", "where_before", "where_after", "modes",
                "signatures",
            )
        ),
    }  # fmt: skip
    assert sorted(folder.iterdir()) == sorted(files)
    for path in files:
        if path.suffix == ".png":
            not_blank(path)
    summary = (folder / "summary.md").read_text(encoding="utf-8")
    for word in ("Verdict: named", "rigid_motion", "rotation_x", "degree", "E1", "noise", "next"):
        assert word in summary
    linked = re.findall(r"\]\((.*?)\)", summary)
    assert set(linked) == {p.name for p in files if p.suffix == ".png"}
    html = (folder / "summary.html").read_text(encoding="utf-8")
    assert html.count("<tr>") > 10
    assert "**" not in html.partition("<script")[0]


def test_what_is_wrong_with_the_test_is_said_first(found, plate):
    """Pressures in another unit: no cause and no modulus means anything."""
    assert found.to_dict()["alarms"] == []
    wrong = replace(found, tests=[replace(plate, pressure=20 * plate.pressure)])
    (alarm,) = wrong.to_dict()["alarms"]
    said = "plate 1/a: highest pressure is 50 bar, where fabrics are tested at 0.02 to 10"
    assert alarm.startswith(said)
    assert report_text(wrong).startswith("WARNING: plate 1/a: highest pressure is 50 bar")
    answer = page_of_diagnosis(record_of(wrong)).answer
    assert answer.notes[0] == alarm
    assert answer.tone == "care"
    assert not page_of_diagnosis(record_of(found)).answer.notes[0].startswith("plate")


def test_files_are_refused_then_replaced(found, drawn, tmp_path):
    (tmp_path / "budget.png").write_text("mine")
    with pytest.raises(InputError, match=r"budget.png: exists; use --force"):
        write_report(found, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["budget.png"]
    (tmp_path / "other.png").write_text("not ours")
    for path in write_report(found, tmp_path, force=True):
        assert path.read_bytes() == (drawn[0] / path.name).read_bytes()
    # what a later diagnosis has no use for is no longer there
    files = write_report(replace_groups(found), tmp_path, force=True)
    assert sorted(tmp_path.iterdir()) == sorted([*files, tmp_path / "other.png"])
    assert not (tmp_path / "plate_1_a_where_after.png").exists()


def replace_groups(found, **changes):
    """The same search, had the evidence paid for nothing."""
    e = found.explanation
    kept = replace(
        e,
        final=e.baseline,
        groups={},
        evidence={},
        steps=[],
        remainder=changes.pop("rest", e.start),
    )
    gaps = {
        **found.gaps,
        "explained": found.gaps["baseline"],
        "heldout_explained": found.gaps["heldout_baseline"],
    }
    return replace(
        found, verdict=Verdict.UNKNOWN, causes=[], explanation=kept, gaps=gaps, **changes
    )


@pytest.mark.parametrize("target", ["file", "file/sub"])
def test_a_folder_that_cannot_be(target, tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="is a file; name a folder"):
        check_report(["a"], tmp_path / target)


def test_several_tests_of_one_name(pair, tmp_path):
    names = {p.name for p in check_report([t.name for t in pair.tests], tmp_path)}
    assert {"same_1_modes.png", "same_2_modes.png"} <= names
    keys = tuple(k for k in pair.explanation.known.keys if k.effect != "prestrain")
    known = replace(pair.explanation.known, keys=keys)
    alone = replace(pair, explanation=replace(pair.explanation, known=known))
    assert not plot_cosines(alone, tmp_path / "c.png", force=False)  # one has none to be like
    maps = []
    for index in range(2):
        path = tmp_path / f"{index}.png"
        plot_where(pair, index, path, after=True, force=False)
        maps.append(path.read_bytes())
    assert maps[0] != maps[1]
    assert "rotation_x of same_1" in report_text(pair)
    assert "rigid_motion of same_2 and same_1 (the camera's frame" in text_of(pair)
    assert "rigid_motion of same_1: the camera's frame" in report_text(pair)


def test_budget_goes_from_the_moduli_to_what_is_left(found):
    rows = budget_of(found)
    assert [row["effect"] for row in rows] == [
        None,
        *(group.effect for group in found.explanation.groups),
    ]
    assert rows[1]["parameters"] == [
        f"{kind}_{axis}" for kind in ("rotation", "shift") for axis in "xyz"
    ]
    for kind, start, end in (
        ("fitted_mm", "baseline", "explained"),
        ("heldout_mm", "heldout_baseline", "heldout_explained"),
    ):
        assert rows[0][kind] == found.gaps[start]["e_w"]
        assert rows[-1][kind] == found.gaps[end]["e_w"]


def test_cells_and_modes_are_written_alike_wherever_they_stand(found):
    record = record_of(found)
    cells, modes = (record["report"][kind]["baseline"][0] for kind in ("cells", "modes"))
    assert record["where"]
    for cell in record["where"]:
        (same,) = (c for c in cells if cell.items() <= c.items())
        assert same["band_bar"] == cell["pressure_band_bar"]
    assert record["modes"] == [m for m in modes if m["growth"] != "within noise"] != []
    for mode in modes:
        assert mode["largest_mm"] == max(abs(a) for a in mode["amplitude_mm"])
        assert len(mode["pressure_bar"]) == len(found.tests[0].pressure)


def test_a_signature_is_what_the_residual_loses(found):
    (step,) = found.explanation.steps
    assert step.before is found.explanation.baseline
    assert step.after is found.explanation.final


def test_words_of_every_verdict(found):
    assert "explains the gap down to the noise" in text_of(found)
    unknown = replace_groups(found)
    text = text_of(unknown)
    assert "No effect that has a name explains the gap: structure is left." in text
    assert "standard errors" in text
    assert "It looks like" in text
    silent = replace_groups(found, rest=found.explanation.remainder)
    silent.verdict = Verdict.NONE
    assert "its moduli alone is good to the noise" in text_of(silent)
    silent.held = {"surface_offset.share": 0.5}
    text = text_of(silent)
    assert "its moduli alone, beside what was held, is good to the noise" in text
    assert "surface_offset.share was held at 0.5" in text
    (cause,) = found.causes
    split = replace(cause, alternatives=("fixture_motion",), at_bound=True, partial=True)
    ambiguous = replace(found, verdict=Verdict.AMBIGUOUS, causes=[split])
    for text in (text_of(ambiguous)), report_text(ambiguous):
        assert "one of rigid_motion or fixture_motion" in text
        assert "edge of what is plausible" in " ".join(text.split())


def test_a_cause_without_alternatives_may_not_be_there(found):
    """Only the model without it competes: nothing is one of several."""
    (cause,) = found.causes
    doubted = replace(cause, probability=0.62)
    one = replace(found, verdict=Verdict.AMBIGUOUS, causes=[doubted])
    answer = " ".join(page_of_diagnosis(record_of(one)).answer.notes)
    assert "Whether a cause is there decides the moduli, too" in answer
    assert "split them first" not in answer
    for text in (text_of(one), report_text(one)):
        words = " ".join(text.split())
        assert "With rigid_motion (the camera's frame" in words
        assert (
            ") the gap is explained down to the noise; rigid_motion (probability 0.620) may "
            "be there or not, which this data does not decide."
        ) in words
        assert "Its probability is 0.620." in words
        assert "This data does not decide whether it is there." in words
        assert "of several" not in words
    split = replace(cause, effect="clamp_slip", alternatives=("dic_scale",), probability=0.7)
    sure = replace(cause, effect="prestrain")
    several = replace(found, verdict=Verdict.AMBIGUOUS, causes=[split, doubted, sure])
    words = " ".join(report_text(several).split())
    assert "which of several, this data cannot tell; rigid_motion (probability 0.620) may" in words
    assert words.count("does not decide whether it is there") == 1
    answer = " ".join(page_of_diagnosis(record_of(several)).answer.notes)
    assert "split them first" in answer
    assert "Whether a cause is there decides the moduli, too" in answer


def test_a_verdict_counts_the_causes_that_are_sure(found):
    (cause,) = found.causes
    doubted = replace(cause, effect="clamp_slip", probability=0.62)
    also = replace(cause, effect="prestrain")
    for causes, told in (([cause, doubted], ") is sure"), ([cause, also, doubted], ") are sure")):
        partial = replace(found, verdict=Verdict.PARTIAL, causes=causes)
        assert f"{told}; beside that" in verdict_words(record_of(partial))


@pytest.mark.parametrize(
    ("group", "where", "told"),
    [
        (
            Owned("stiffness_field"),
            {"x_mm": -24.0, "y_mm": 4.0},
            "the place 'material' (relative change of stiffness: up to -0.45 at (-24, 4) mm, 0.26",
        ),
        (
            Owned("rim_field", 0),
            {"angle_degree": 120.0},
            "the place 'shape' of plate 1/a (relative change of the rim's radius: up to -0.45 at "
            "120° from x",
        ),
        (Owned("pressure_field"), {"pressure_bar": 2.5}, "up to -0.45 bar at 2.5 bar, 0.26 bar"),
    ],
)
def test_what_has_no_name_is_told_by_its_place(found, group, where, told):
    sampled = Sampled(
        np.array([0.0, -0.45, 0.0]), {k: np.array([0, v, 0]) for k, v in where.items()}
    )
    found_field = FoundField(group, sampled, np.full(3, 0.1))
    evidence = {group: Evidence(0.999, (), None, {})}
    explanation = replace(
        found.explanation,
        fields=[found_field],
        evidence={**found.explanation.evidence, **evidence},
    )
    text = text_of(replace(found, verdict=Verdict.PARTIAL, explanation=explanation))
    assert "is sure; beside that, something that has no name sits in the place" in text
    assert told in text
    unnamed = replace_groups(found)
    unnamed.explanation = replace(unnamed.explanation, fields=[found_field], evidence=evidence)
    assert told in text_of(unnamed)


def test_a_cause_without_which_nothing_balances(found):
    (cause,) = found.causes
    vital = replace(cause, share_of_gap=None, heldout_reduction=None, bias_if_omitted={})
    told = text_of(replace(found, causes=[vital]))
    assert "What it takes off is not known" in told
    assert "On data that was not fitted it takes off" not in told
    assert "Without it" not in told


def test_a_shear_modulus_that_was_held_is_a_limit(found):
    """Softer, frames would lose stability: neither its error nor its bias are what is said."""
    (cause,) = found.causes
    biased = replace(cause, bias_if_omitted={"E1": 0.1, "E2": 0.0, "G12": -0.4}, bias_held=True)
    base = replace(found.explanation.baseline, held=True)
    explanation = replace(found.explanation, baseline=base)
    text = " ".join(report_text(replace(found, causes=[biased], explanation=explanation)).split())
    assert "E1 comes out 10 % too high and G12 comes out at least 40 % too low" in text
    assert f"G12 {base.values[SHEAR]:.3g} at most" in text
    free = replace(biased, bias_held=False)
    text = " ".join(report_text(replace(found, causes=[free])).split())
    assert "G12 comes out 40 % too low" in text


@pytest.mark.parametrize(
    ("value", "stderr", "text"),
    [
        (1.23456, 0.0123, "1.235 ± 0.012"),
        (331.27, 1.4, "331.3 ± 1.4"),
        (331.27, 25.0, "331 ± 25"),
        (5.0, 0.0, "5"),
        (5.0, np.nan, "5"),
        (2.5e-7, 3e-8, "2.5e-07 ± 3e-08"),
    ],
)
def test_values_carry_the_digits_of_their_error(value, stderr, text):
    assert value_text(value, stderr) == text
