"""A share of so many, and how far it can be trusted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from scipy.stats import binomtest

__all__ = ["share", "share_text"]


def share(answers: Iterable[bool]) -> dict[str, Any]:
    """Hits, number, share and its 95 % interval by Wilson (1927); (0, 1) of nothing."""
    found = [bool(answer) for answer in answers]
    hits, of = sum(found), len(found)
    low, high = 0.0, 1.0
    if of:
        low, high = binomtest(hits, of).proportion_ci(confidence_level=0.95, method="wilson")
    return {
        "hits": hits,
        "of": of,
        "share": hits / of if of else None,
        "wilson": [float(low), float(high)],
    }


def share_text(told: Mapping[str, Any]) -> str:
    """A share in words."""
    low, high = told["wilson"]
    return (
        f"{told['hits']}/{told['of']} = {100 * told['share']:.1f} % "
        f"({100 * low:.1f} to {100 * high:.1f})"
    )
