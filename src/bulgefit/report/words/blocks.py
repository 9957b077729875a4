"""What does a diagnosis say on a page, by what it is about?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.effects.parameter import Owned
from bulgefit.report.numbers import listed
from bulgefit.report.page.blocks import Block
from bulgefit.report.record import Record
from bulgefit.report.words.causes import evidence_words, parameter_rows
from bulgefit.report.words.gaps import GAP_COLUMNS, gap_rows, held_out_words, moduli_rows, shrinkage
from bulgefit.report.words.left import remainder_items
from bulgefit.report.words.names import (
    SMALL,
    chance_text,
    named_set,
    names_of,
    of_whom,
    owned,
    owned_together,
    with_rivals,
)
from bulgefit.report.words.next import action_items, advice_items
from bulgefit.report.words.notes import note_items
from bulgefit.report.words.verdict import is_unnamed

__all__ = ["blocks_of"]


def blocks_of(record: Record) -> dict[str, list[Block]]:
    """The words of a page, by what they are about."""
    return {
        "causes": _cause_blocks(record),
        "moduli": [
            Block("table", rows=(("modulus (MPa)", "moduli alone", "with causes"),
                                 *moduli_rows(record)))
        ],
        "gap": _gap_blocks(record),
        "left": [Block("list", tuple(remainder_items(record)))],
        "next": [Block("list", (*action_items(record), *advice_items(record)))],
        "tried": _tried_blocks(record),
        "notes": [Block("list", tuple(note_items(record)))],
    }  # fmt: skip


def _cause_blocks(record: Record) -> list[Block]:
    causes = record["causes"]
    if not causes:
        return (
            [Block("text", ("No effect that has a name is sure.",))] if is_unnamed(record) else []
        )
    names = names_of(record)
    if len(names) == 1:
        return _told_causes(record, causes)
    folds = []
    for owner in (None, *range(len(names))):
        ours = [cause for cause in causes if cause["specimen"] == owner]
        if ours:
            told = [f"{named_set(c)} ({chance_text(c['probability'])})" for c in ours]
            name = "all specimens" if owner is None else names[owner]
            inside = tuple(_told_causes(record, ours))
            folds.append(Block("fold", (name, ", ".join(told)), inside=inside))
    return [Block("text", ("In brackets the probability of each.",)), *folds]


def _told_causes(record: Record, causes: Sequence[Mapping[str, Any]]) -> list[Block]:
    """Values and words of causes."""
    rows = [("cause", "parameter", "value ± standard error")]
    for cause in causes:
        label = with_rivals(record, cause)
        for name, text in parameter_rows(record, cause):
            rows.append((label, name, text))
            label = ""
    told = tuple(
        f"**{c['effect']}{of_whom(record, c)}**: {c['meaning']}. {evidence_words(c)}"
        for c in causes
    )
    return [Block("table", rows=tuple(rows)), Block("list", told)]


def _gap_blocks(record: Record) -> list[Block]:
    head = ("mean absolute deviation (mm)", *GAP_COLUMNS[:-1], "in noise units")
    rows = [
        (label, *(f"{gap[c]:.4f}" for c in GAP_COLUMNS[:-1]), f"{gap['chi']:.2f}")
        for label, gap in gap_rows(record)
    ]
    kept = held_out_words(record)
    return [
        Block("text", (shrinkage(record),)),
        Block("table", rows=(head, *rows)),
        *([Block("text", (kept,))] if kept else []),
    ]


def _tried_blocks(record: Record) -> list[Block]:
    """Candidates that are not in the model, and those that could not be tried, in a fold."""
    others = sorted(record["others"].items(), key=lambda pair: -pair[1])
    rows = [(owned(record, group), chance_text(p)) for group, p in others if p >= SMALL]
    told = {Owned.read(group).effect for group in (*record["others"], *_taken(record))}
    gone = owned_together(record, [group for group, p in others if p < SMALL])
    gone += [effect for effect in record["report"]["candidates"] if effect not in told]
    if gone:
        rows.append((", ".join(gone), "below 0.001 each"))
    rows += [(effect, f"not tried: {why}") for effect, why in record["skipped"].items()]
    if not rows:
        return [Block("text", ("Every effect that was tried is in the model.",))]
    inside = Block("table", rows=(("effect", "probability"), *rows))
    return [Block("fold", ("all of them", _tried_words(record)), inside=(inside,))]


def _tried_words(record: Record) -> str:
    """How many there are, and which is the most probable."""
    others, told = record["others"], []
    if others:
        first = max(others, key=lambda group: others[group])
        told.append(
            f"{len(others)} weighed and dropped, of which {owned(record, first)} is the most "
            f"probable ({chance_text(others[first])})"
        )
    if record["skipped"]:
        told.append(f"not tried: {listed(list(record['skipped']))}")
    return "; ".join(told) or "weighed and dropped"


def _taken(record: Record) -> list[str]:
    """Groups of the final model; a step may have taken several."""
    return [group for step in record["tried"] for group in str(step["taken"]).split(" + ")]
