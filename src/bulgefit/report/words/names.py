"""How are tests, effects, causes and chances called in sentences?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.effects.parameter import Owned
from bulgefit.report.numbers import listed
from bulgefit.report.record import Record

__all__ = [
    "budget_labels",
    "called",
    "chance_text",
    "names_of",
    "of_whom",
    "owned",
    "percent_text",
    "with_rivals",
]

#: Parameters of a form that are named one by one.
_NAMED = 4


def names_of(record: Record) -> list[str]:
    """Of the tests."""
    return [str(t["name"]) for t in record["report"]["tests"]]


def owned(record: Record, group: str) -> str:
    """A group as `effect`, or `effect of test`."""
    effect, owner = Owned.read(group)
    return effect if owner is None else f"{effect} of {names_of(record)[owner]}"


def budget_labels(record: Record) -> list[str]:
    """Rows of the budget: each effect by its form, since several forms are several models."""
    labels = ["moduli alone"]
    for row in record["report"]["budget"][1:]:
        owner = "" if row["specimen"] is None else f" of {names_of(record)[row['specimen']]}"
        labels.append(f"{row['effect']}{owner} ({_form(row['parameters'])})")
    return labels


def _form(parameters: Sequence[str]) -> str:
    if not parameters:
        return "an offset of every point"
    if len(parameters) > _NAMED:
        return f"{parameters[0]} to {parameters[-1]}, {len(parameters)} parameters"
    return ", ".join(parameters)


def of_whom(record: Record, cause: Mapping[str, Any]) -> str:
    """Of which test, where each of several has causes of its own."""
    owner = cause["specimen"]
    return "" if owner is None else f" of {names_of(record)[owner]}"


def with_rivals(record: Record, cause: Mapping[str, Any]) -> str:
    """A cause and what this data cannot tell from it."""
    return " or ".join((cause["effect"], *cause["alternatives"])) + of_whom(record, cause)


def called(record: Record, cause: Mapping[str, Any]) -> str:
    """A cause in a sentence."""
    whose = of_whom(record, cause)
    if cause["alternatives"]:
        return f"one of {listed([cause['effect'], *cause['alternatives']], 'or')}{whose}"
    return f"{cause['effect']}{whose} ({cause['meaning']})"


def chance_text(probability: float) -> str:
    """A probability, without more nines or zeros than a search can know."""
    if probability > 0.999:
        return "over 0.999"
    return "below 0.001" if probability < 0.001 else f"{probability:.3f}"


def percent_text(share: float) -> str:
    """A share in per cent, without rounding nearly all up to all."""
    share *= 100.0
    if share > 99.9 and share < 100.0:
        return f"{min(share, 99.99):.2f} %"
    return f"{share:.3g} %"
