"""How are tests, effects, causes and chances called in sentences?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bulgefit.effects.parameter import Owned
from bulgefit.gap.effects import CREASES
from bulgefit.gap.residual.locate import Growth
from bulgefit.report.numbers import listed
from bulgefit.report.record import Record

__all__ = [
    "SMALL",
    "budget_labels",
    "called_together",
    "chance_text",
    "mode_label",
    "named_set",
    "names_of",
    "of_whom",
    "owned",
    "owned_together",
    "percent_text",
    "with_rivals",
]

#: Probability below which only that is said.
SMALL = 0.001
#: Parameters of a form that are named one by one.
_NAMED = 4
#: Causes that a sentence says the meaning of.
_EXPLAINED = 3


def names_of(record: Record) -> list[str]:
    """Of the tests."""
    return [str(t["name"]) for t in record["report"]["tests"]]


def mode_label(order: int, growth: str) -> str:
    """An azimuthal mode and how it goes with the pressure p, for legends."""
    return f"m = {order}: {'in proportion to p' if growth == Growth.LINEAR else growth}"


def owned(record: Record, group: str) -> str:
    """A group as `effect`, or `effect of test`."""
    effect, owner = Owned.read(group)
    return effect if owner is None else f"{effect} of {names_of(record)[owner]}"


def budget_labels(record: Record) -> list[str]:
    """Rows of the budget: each effect by its form, since several forms are several models."""
    labels, waiting = ["moduli alone"], False
    for row in record["report"]["budget"][1:]:
        owner = "" if row["specimen"] is None else f" of {names_of(record)[row['specimen']]}"
        form = _form(row["effect"], row["parameters"])
        if waiting and row["parameters"]:
            form = f"with those above, {len(row['parameters'])} parameters"
        waiting = not row["parameters"] and row["effect"] != CREASES
        labels.append(f"{row['effect']}{owner} ({form})")
    return labels


def _form(effect: str, parameters: Sequence[str]) -> str:
    if not parameters:
        # nothing balanced with it and what came before alone
        return "an offset of every point" if effect == CREASES else "counted with the next one"
    if len(parameters) > _NAMED:
        return f"{parameters[0]} to {parameters[-1]}, {len(parameters)} parameters"
    return ", ".join(parameters)


def of_whom(record: Record, cause: Mapping[str, Any]) -> str:
    """Of which test, where each of several has causes of its own."""
    owner = cause["specimen"]
    return "" if owner is None else f" of {names_of(record)[owner]}"


def named_set(cause: Mapping[str, Any]) -> str:
    """A cause and what this data cannot tell from it."""
    return " or ".join((cause["effect"], *cause["alternatives"]))


def with_rivals(record: Record, cause: Mapping[str, Any]) -> str:
    """The same, and of which test."""
    return named_set(cause) + of_whom(record, cause)


def called_together(record: Record, causes: Sequence[Mapping[str, Any]]) -> str:
    """Causes in a sentence, an effect of several tests once: what it means is said once, too.

    Of many causes it is left to the words of each.
    """
    together: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for cause in causes:
        together.setdefault((cause["effect"], *cause["alternatives"]), []).append(cause)
    names = names_of(record)
    told = []
    for (effect, *rivals), each in together.items():
        owners = [names[c["specimen"]] for c in each if c["specimen"] is not None]
        whose = f" of {listed(owners)}" if owners else ""
        if rivals:
            told.append(f"one of {listed([effect, *rivals], 'or')}{whose}")
        else:
            means = f" ({each[0]['meaning']})" if len(together) <= _EXPLAINED else ""
            told.append(f"{effect}{whose}{means}")
    return listed(told)


def owned_together(record: Record, groups: Iterable[str]) -> list[str]:
    """Groups as `effect` or `effect of test, test and test`, each effect once."""
    owners: dict[str, list[str]] = {}
    for group in groups:
        effect, owner = Owned.read(group)
        ours = owners.setdefault(effect, [])
        if owner is not None:
            ours.append(names_of(record)[owner])
    return [f"{e} of {listed(ours)}" if ours else e for e, ours in owners.items()]


def chance_text(probability: float) -> str:
    """A probability, without more nines or zeros than a search can know."""
    if probability > 0.999:
        return "over 0.999"
    return "below 0.001" if probability < SMALL else f"{probability:.3f}"


def percent_text(share: float) -> str:
    """A share in per cent, without rounding nearly all up to all."""
    share *= 100.0
    if share > 99.9 and share < 100.0:
        return f"{min(share, 99.99):.2f} %"
    return f"{share:.0f} %" if share >= 100.0 else f"{share:.3g} %"
