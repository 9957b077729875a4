"""The figures of a trial as a table of text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bulgefit.trial.shares import share_text

__all__ = ["report", "shares_in_words"]

#: Shares of a trial's scores in words, parts of the one above set in, with whether more is better.
_SHARES = (
    ("found", "effects named, or in a set of at most two", True),
    ("found_several", "  of tests with three causes and more", True),
    ("families", "  of families", True),
    ("causes_found", "causes found, alone or in a set of two", True),
    ("causes_false", "sure causes that are not there", False),
    ("false_alarms", "false alarms on clean tests", False),
    ("foreign_unknown", "foreign effects answered unknown or partial", True),
    ("places", "foreign effects at their place", True),
    ("spots", "  at their spot, where they have one", True),
    ("false_fields", "tests with a field where nothing foreign is", False),
    ("laws", "laws of families met", True),
    ("struck_right", "effects struck from the catalogue, not misnamed", True),
)


def report(scores: Mapping[str, Any]) -> str:
    """The figures as a table of text."""
    lines = [f"{scores['tests']} made tests, {scores['failed']} diagnoses failed"]
    for told, words, _ in shares_in_words(scores):
        lines.append(f"  {words:<51}{share_text(told)}")
    for key, words in (
        ("parameters", "parameters"),
        ("moduli", "moduli, of what is right,"),
        ("moduli_all", "moduli, of all,"),
    ):
        part = scores[key]
        if part["within_3_stderr"]["of"]:
            lines.append(
                f"  {words + ' within 3 standard errors':<51}{share_text(part['within_3_stderr'])}"
                f"; median error {100 * part['median_relative']:.1f} %"
            )
    held = scores["heldout"]
    if held["median_ratio"] is not None:
        lines.append(
            f"  {'held-out gap, medians':<51}{held['before_mm']:.4f} mm before, "
            f"{held['after_mm']:.4f} after, noise {held['floor_mm']:.4f} "
            f"(ratio {held['median_ratio']:.2f})"
        )
        lines.append(f"  {'held-out gap <= 1.15 times the noise':<51}{share_text(held['closed'])}")
    parts = (_confusion_lines, _size_lines, _reliability_lines, _detectable_lines)
    return "\n\n".join("\n".join(part) for part in (lines, *(p(scores) for p in parts)) if part)


def shares_in_words(scores: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], str, bool]]:
    """Each share of which there is any, what it is, and whether more of it is better."""
    shares = {**scores, **{f"causes_{k}": scores["causes"][k] for k in ("found", "false")}}
    return [(shares[key], words, good) for key, words, good in _SHARES if shares[key]["of"]]


def _confusion_lines(scores: Mapping[str, Any]) -> list[str]:
    lines = ["truth".ljust(28) + "answers"]
    for row, answers in scores["confusion"].items():
        lines.append(f"{row:<28}" + ", ".join(f"{said} {n}" for said, n in answers.items()))
    return lines


def _size_lines(scores: Mapping[str, Any]) -> list[str]:
    bands = scores["causes"]["by_size"]
    if not bands:
        return []
    lines = ["causes by what nothing else imitates, over the noise"]
    for band in bands:
        above = "and more" if band["to"] is None else f"to {band['to']:g}"
        lines.append(f"  {band['from']:g} {above:<20}{share_text(band)}")
    return lines


def _reliability_lines(scores: Mapping[str, Any]) -> list[str]:
    lines = []
    for what, told in scores["reliability"].items():
        if told["bins"]:
            lines.append(f"{what}: stated probability, and true share (off by {told['error']:.3f})")
        for found in told["bins"]:
            span = f"{found['from']:g} to {found['to']:g}"
            lines.append(f"  {span:<16}{100 * found['stated']:>6.1f} %  {share_text(found)}")
    return lines


def _detectable_lines(scores: Mapping[str, Any]) -> list[str]:
    if not scores["detectable"]:
        return []
    head = "effect".ljust(28) + "".join(
        f"{title:>22}" for title in ("found", "smallest found, mm", "largest missed, mm")
    )
    lines = [head]
    for effect, row in scores["detectable"].items():
        sizes = (row["smallest_found_mm"], row["largest_missed_mm"])
        shown = "".join(f"{'-' if size is None else f'{size:.4f}':>22}" for size in sizes)
        lines.append(f"{effect:<28}{row['found']:>15} of {row['tests']:>3}{shown}")
    return lines
