"""The page of a blind trial: does the diagnosis find what it is not told?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bulgefit.report.page.blocks import Answer, Block, Page
from bulgefit.trial.shares import share_text
from bulgefit.trial.table import shares_in_words

__all__ = ["page_of_trial"]

Result = Mapping[str, Any]


def page_of_trial(result: Result) -> Page:
    """The page of a trial's JSON."""
    scores, meta = result["scores"], result["meta"]
    blocks = [
        Block("heading", ("What was found",)),
        *_bars(scores),
        Block("heading", ("Truth and answers",)),
        Block("table", rows=_confusion(scores)),
        *_detectable(scores),
        *_reliability(scores),
        Block("heading", ("Test by test",)),
        Block("table", rows=_tests(result)),
        Block("fields"),
    ]
    title = f"Blind trial of the diagnosis: {scores['tests']} tests, seed {meta['seed']}"
    return Page(title, "trial", _answer(result), tuple(blocks))


def _answer(result: Result) -> Answer:
    scores, tests = result["scores"], result["tests"]
    right = sum(bool(test["right"]) for test in tests)
    wrong_sure = scores["causes"]["false"]
    notes = []
    if scores["causes"]["found"]["of"]:
        notes.append(
            f"Causes found, alone or in a set of two: {share_text(scores['causes']['found'])}."
        )
    if wrong_sure["of"]:
        notes.append(f"Sure causes that are not there: {share_text(wrong_sure)}.")
    if scores["false_alarms"]["of"]:
        notes.append(f"False alarms on clean tests: {share_text(scores['false_alarms'])}.")
    if scores["failed"]:
        notes.append(f"**{scores['failed']} diagnoses failed.**")
    headline = f"{right} of {len(tests)} tests were answered rightly, their truth being withheld."
    tone = "good" if right == len(tests) else "care" if 2 * right >= len(tests) else "bad"
    return Answer(headline, tone, (), tuple(notes))


def _bars(scores: Mapping[str, Any]) -> list[Block]:
    bars = [
        {
            "label": words.strip(),
            "left": 0.0,
            "width": 100 * found["share"],
            "kind": "gain" if good else "loss",
            "text": f"{found['hits']} of {found['of']}",
        }
        for found, words, good in shares_in_words(scores)
    ]
    caption = "Green: the more the better; orange: the less the better."
    return [Block("bars", (caption,), picture={"bars": bars})] if bars else []


def _confusion(scores: Mapping[str, Any]) -> tuple[tuple[str, ...], ...]:
    rows = [("truth", "answers")]
    rows += [
        (row, ", ".join(f"{said} {n}" for said, n in answers.items()))
        for row, answers in scores["confusion"].items()
    ]
    return tuple(rows)


def _detectable(scores: Mapping[str, Any]) -> list[Block]:
    if not scores["detectable"]:
        return []
    rows: list[tuple[str, ...]] = [
        ("effect", "found", "smallest found (mm)", "largest missed (mm)")
    ]
    for effect, row in scores["detectable"].items():
        sizes = (row["smallest_found_mm"], row["largest_missed_mm"])
        cells = ("–" if size is None else f"{size:.4f}" for size in sizes)
        rows.append((effect, f"{row['found']} of {row['tests']}", *cells))
    return [Block("heading", ("How small an effect is found",)), Block("table", rows=tuple(rows))]


def _reliability(scores: Mapping[str, Any]) -> list[Block]:
    rows = [("what", "stated probability", "true share")]
    for what, told in scores["reliability"].items():
        for found in told["bins"]:
            stated = f"{found['from']:g} to {found['to']:g} (mean {100 * found['stated']:.1f} %)"
            rows.append((what, stated, share_text(found)))
    if len(rows) == 1:
        return []
    return [
        Block("heading", ("Are probabilities what they say?",)),
        Block("table", rows=tuple(rows)),
    ]


def _tests(result: Result) -> tuple[tuple[str, ...], ...]:
    rows = [("test", "truth", "verdict", "causes", "right")]
    for test in result["tests"]:
        causes = ", ".join("/".join(names) for names in test["causes"])
        truth = ", ".join(test["truth"]) or "nothing"
        right = "yes" if test["right"] else "no"
        rows.append((str(test["file"]), truth, str(test["verdict"]), causes, right))
    return tuple(rows)
