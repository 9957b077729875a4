"""What is said of each cause: its parameters, what speaks for it, and what it is worth?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bulgefit.gap.effects import SHEAR
from bulgefit.gap.evidence.probability import SURE
from bulgefit.report.numbers import listed, value_text
from bulgefit.report.record import Record
from bulgefit.report.words.names import chance_text, owned, percent_text
from bulgefit.shown import after_value

__all__ = ["evidence_words", "is_undecided", "parameter_rows"]

_MOST_PARAMETERS = 9


def parameter_rows(record: Record, cause: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values of a cause."""
    for number, (name, found) in enumerate(cause["parameters"].items()):
        if number == _MOST_PARAMETERS:
            yield f"{len(cause['parameters']) - number} more", "see --json"
            return
        text = value_text(found["value"], found["stderr"]) + after_value(found["unit"])
        yield owned(record, name), text


def is_undecided(cause: Mapping[str, Any]) -> bool:
    """Whether a cause may not be there: it is not sure, and no other effect stands in for it."""
    return not cause["alternatives"] and cause["probability"] < SURE


def evidence_words(cause: Mapping[str, Any]) -> str:
    """What speaks for a cause, and what it is worth."""
    parts = [f"Its probability is {chance_text(cause['probability'])}.", *_worth(cause)]
    if cause["alternatives"]:
        parts.append(
            f"This data cannot tell it from {listed(cause['alternatives'], 'or')}; it is given "
            "because it is the most probable."
        )
    elif is_undecided(cause):
        parts.append("This data does not decide whether it is there.")
    if cause["at_bound"]:
        parts.append("A parameter sits at the edge of what is plausible: do not take it as it is.")
    if cause["partial"]:
        parts.append("It is a part of the answer only.")
    return " ".join(parts)


def _worth(cause: Mapping[str, Any]) -> Iterator[str]:
    """What omitting a cause does to the gap and to the moduli."""
    reduction, share = cause["heldout_reduction"], cause["share_of_gap"]
    if reduction is None or share is None:
        yield (
            "What it takes off is not known: without it the others, as they are, leave no "
            "equilibrium to start a fit from."
        )
        return
    yield (
        f"On data that was not fitted it takes off {percent_text(reduction)} of the squared misfit "
        f"that it found, {percent_text(share)} of the whole."
        if reduction > 0.0
        else "On data that was not fitted the others would do as well without it."
    )
    biased = [
        f"{m} comes out {'at least ' if m == SHEAR.name and b < 0 and cause['bias_held'] else ''}"
        f"{percent_text(abs(b))} too {'high' if b > 0 else 'low'}"
        for m, b in cause["bias_if_omitted"].items()
        if abs(b) >= 0.005
    ]
    if biased:
        yield f"Without it {listed(biased)}."
    else:
        yield "Without it the moduli change by less than 0.5 %."
