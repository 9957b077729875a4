"""What does a diagnosis come to, in a sentence?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bulgefit.gap.causes import Verdict
from bulgefit.gap.evidence.probability import SURE
from bulgefit.report.numbers import listed
from bulgefit.report.record import Record
from bulgefit.report.words.causes import is_undecided
from bulgefit.report.words.left import strong_cells
from bulgefit.report.words.names import called_together, chance_text, of_whom
from bulgefit.report.words.unnamed import unnamed_words

__all__ = ["is_unnamed", "verdict_words"]


def verdict_words(record: Record) -> str:
    """The verdict in a sentence."""
    causes, verdict = record["causes"], record["verdict"]
    named = called_together(record, causes)
    if verdict == Verdict.NONE:
        held = ", beside what was held," if record.get("held") else ""
        return f"The model with its moduli alone{held} is good to the noise; nothing need be added."
    if verdict == Verdict.NAMED:
        return f"{named} {'explains' if len(causes) == 1 else 'explain'} the gap down to the noise."
    if verdict == Verdict.AMBIGUOUS:
        return f"With {named} the gap is explained down to the noise; {_open(record)}."
    left = _left(record)
    if verdict == Verdict.PARTIAL:
        sure = [c for c in causes if c["probability"] >= SURE]
        are = "is" if len(sure) == 1 else "are"
        return f"{called_together(record, sure)} {are} sure; beside that, {left}."
    helps = f"; {named} {_helps(causes)} in part" if causes else ""
    return f"No effect that has a name explains the gap: {left}{helps}."


def is_unnamed(record: Record) -> bool:
    """Whether something is left that has no name."""
    return record["verdict"] in (Verdict.PARTIAL, Verdict.UNKNOWN)


def _open(record: Record) -> str:
    """What the data leave open: which of several acts, and what may not be there at all."""
    causes, told = record["causes"], []
    if any(c["alternatives"] for c in causes):
        told.append("which of several, this data cannot tell")
    doubted = [
        f"{c['effect']}{of_whom(record, c)} (probability {chance_text(c['probability'])})"
        for c in causes
        if is_undecided(c)
    ]
    if doubted:
        told.append(f"{listed(doubted)} may be there or not, which this data does not decide")
    return "; ".join(told)


def _left(record: Record) -> str:
    """What is left, for a verdict."""
    if unnamed := unnamed_words(record):
        return unnamed
    if strong_cells(record):
        return "structure is left"
    return "a pattern is left that is no larger than the noise, but not made by it"


def _helps(causes: Sequence[Any]) -> str:
    return "helps" if len(causes) == 1 else "help"
