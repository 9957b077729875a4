"""The part of a page about what has no name: a table of fields, and each over its place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.report.page.blocks import Block
from bulgefit.report.page.field_charts import field_chart
from bulgefit.report.record import Record
from bulgefit.report.words.names import chance_text, names_of
from bulgefit.report.words.unnamed import FIELD_COLUMNS, field_row

__all__ = ["unnamed_blocks"]

_CAPTION = (
    "Discs: what is less than two standard errors from zero is grey, the cross is the largest "
    "value, x to the right, y upwards; hatched: no points. Curves: the band holds 95 %."
)
#: Of a test whose clamp an earlier version did not write.
_CIRCLE = (100.0, 100.0)


def unnamed_blocks(record: Record) -> list[Block]:
    """Heading, tables and drawings; of several tests in a fold for each, none without fields."""
    found, names = record["fields"], names_of(record)
    if not found:
        return []
    heading = Block("heading", ("What has no name",))
    if len(names) == 1:
        return [heading, *_told(record, 0, found)]
    folds = []
    for owner in (None, *range(len(names))):
        ours = [f for f in found if f["specimen"] == owner]
        if ours:
            told = ", ".join(f"{f['field']} ({chance_text(f['probability'])})" for f in ours)
            name = "all specimens" if owner is None else names[owner]
            folds.append(Block("fold", (name, told), inside=_told(record, owner or 0, ours)))
    return [heading, *folds]


def _told(record: Record, test: int, found: Sequence[Mapping[str, Any]]) -> tuple[Block, ...]:
    """A table of fields, and those that can be drawn."""
    blocks = [Block("table", rows=(FIELD_COLUMNS, *map(field_row, found)))]
    semi_axes = record["report"]["tests"][test].get("semi_axes_mm", _CIRCLE)
    charts = [chart for f in found if (chart := field_chart(f, semi_axes)) is not None]
    if charts:
        blocks.append(Block("unnamed", (_CAPTION,), picture={"charts": charts}))
    return tuple(blocks)
