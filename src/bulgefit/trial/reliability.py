"""Is what a diagnosis says with 90 % true nine times in ten?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from bulgefit.trial.right import Record, at_a_foreign_place, is_there, true_causes
from bulgefit.trial.shares import share

__all__ = ["reliability", "stated_causes", "stated_fields"]

#: Limits of the bins of stated probability; finer where a cause is called sure.
LIMITS = (0.0, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 1.0)


def stated_causes(records: Iterable[Record]) -> list[tuple[float, bool]]:
    """Probability of each cause that states one, and whether the cause is there.

    What stands in for a part of a foreign effect, at its place, is neither there nor not.
    """
    told = []
    for record in records:
        true = true_causes(record)
        for cause in record["answer"].get("causes", ()):
            there = any(is_there(cause, one) for one in true)
            if cause.get("probability") is not None and (
                there or not at_a_foreign_place(record, cause)
            ):
                told.append((float(cause["probability"]), there))
    return told


def stated_fields(records: Iterable[Record]) -> list[tuple[float, bool]]:
    """Probability of each field that states one, and whether something foreign is at its place."""
    return [
        (float(field["probability"]), field["place"] in record["truth"].get("places", {}).values())
        for record in records
        for field in record["answer"].get("fields") or ()
        if field.get("probability") is not None
    ]


def reliability(stated: Sequence[tuple[float, bool]]) -> dict[str, Any]:
    """Stated probabilities against true shares.

    Returns
    -------
    dict
        `bins`: of each that holds anything `from`, `to`, `stated` (mean) and the true share with
        its interval; `error`: their difference, averaged over what was stated; None of nothing.
    """
    bins = []
    for low, high in pairwise(LIMITS):
        here = [(p, t) for p, t in stated if low <= p < high or p == high == LIMITS[-1]]
        if here:
            mean = sum(p for p, _ in here) / len(here)
            told: Mapping[str, Any] = share(true for _, true in here)
            bins.append({"from": low, "to": high, "stated": mean, **told})
    off = sum(b["of"] * abs(b["stated"] - b["share"]) for b in bins)
    return {"bins": bins, "error": off / len(stated) if stated else None}
