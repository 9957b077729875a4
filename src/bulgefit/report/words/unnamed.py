"""What has no name but a place: where does it sit, how large is it, and how sure?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bulgefit.report.numbers import listed, value_text
from bulgefit.report.record import Record
from bulgefit.report.words.names import chance_text, of_whom
from bulgefit.shown import after_value

__all__ = ["FIELD_COLUMNS", "field_items", "field_row", "unnamed_words"]

#: Fields that a sentence takes; of more it tells the first.
_IN_A_SENTENCE = 3
FIELD_COLUMNS = ("place", "what varies", "largest", "where", "on the whole", "probability")


def unnamed_words(record: Record) -> str:
    """What sits where, for a verdict; empty without any field."""
    found = record["fields"]
    if len(found) <= _IN_A_SENTENCE:
        places = listed([_place(record, f) for f in found])
        return f"something that has no name sits in {places}" if places else ""
    first = max(found, key=lambda f: f["share_of_gap"] or 0.0)
    others = listed([*dict.fromkeys(repr(f["place"]) for f in found if f is not first)])
    return (
        f"something that has no name sits in {_place(record, first)}, and in "
        f"{len(found) - 1} others, of the places {others}: see what has no name"
    )


def field_items(record: Record) -> list[str]:
    """Every field in a line, where there are more than the verdict names."""
    found = record["fields"]
    if len(found) <= _IN_A_SENTENCE:
        return []
    return [
        f"{f['field']}{of_whom(record, f)} ({f['place']}; probability {_chance(f)}): "
        f"{f['quantity']}, {_size(f)} at {_where(f['where'])}, {_whole(f)} on the whole."
        for f in found
    ]


def field_row(found: Mapping[str, Any]) -> tuple[str, ...]:
    """A field under `FIELD_COLUMNS`."""
    return (
        f"{found['place']} ({found['field']})",
        str(found["quantity"]),
        _size(found),
        _where(found["where"]),
        _whole(found),
        _chance(found),
    )


def _where(where: Mapping[str, float]) -> str:
    """Where a field is largest."""
    if "x_mm" in where:
        x, y = (round(where[axis]) for axis in ("x_mm", "y_mm"))
        return f"({x}, {y}) mm"
    if "angle_degree" in where:
        return f"{where['angle_degree']:.0f}° from x"
    if "strain" in where:
        axis = "fill" if where["from_warp_degree"] > 45.0 else "warp"
        return f"{100.0 * where['strain']:.2g} % strain along the {axis}"
    if "from_warp_degree" in where:
        return "fill" if where["from_warp_degree"] > 45.0 else "warp"
    if "time_share" in where:
        return f"{100.0 * where['time_share']:.0f} % of the test's time"
    return f"{where['pressure_bar']:.3g} bar"


def _place(record: Record, found: Mapping[str, Any]) -> str:
    """Where a field sits, of which test, and how large it is."""
    return (
        f"the place {found['place']!r}{of_whom(record, found)} ({found['quantity']}: "
        f"up to {found['largest']:+.3g}{after_value(found['unit'])} at {_where(found['where'])}, "
        f"{_whole(found)} on the whole)"
    )


def _size(found: Mapping[str, Any]) -> str:
    """The largest value and its error, which an earlier version did not write."""
    if "stderr" not in found:
        return f"{found['largest']:+.3g}{after_value(found['unit'])}"
    sign = "+" if found["largest"] > 0.0 else ""
    return f"{sign}{value_text(found['largest'], found['stderr'])}{after_value(found['unit'])}"


def _whole(found: Mapping[str, Any]) -> str:
    return f"{found['rms']:.2g}{after_value(found['unit'])}"


def _chance(found: Mapping[str, Any]) -> str:
    """Its probability, and of which other places it may be."""
    rivals = [p for p in found["alternatives"] if p != found["place"]]
    others = f", or {listed(rivals, 'or')}" if rivals else ""
    return chance_text(found["probability"]) + others
