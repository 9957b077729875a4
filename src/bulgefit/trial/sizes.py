"""How small may a cause be and still be found, and how far does the gap close?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import inf, isfinite
from statistics import median
from typing import Any

from bulgefit.trial.known import SILENT
from bulgefit.trial.right import Record, found_causes
from bulgefit.trial.shares import share

__all__ = ["by_size", "detectable", "heldout"]

#: Held-out gap over the noise floor that counts as closed.
CLOSED = 1.15
#: Limits of the bands of a cause's size, over the noise.
BANDS = (0.0, 0.3, 1.0, 3.0, 10.0, inf)


def by_size(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Causes found, by what they change beyond moduli and other causes, over the noise.

    Both are rms over points and frames, of the three components together. Families are left out:
    each specimen has sizes of its own.
    """
    sizes = list(_sizes(records))
    return [
        {"from": low, "to": high if high < inf else None, **share(found)}
        for low, high in pairwise(BANDS)
        if (found := [hit for size, hit in sizes if low <= size < high])
    ]


def _sizes(records: Sequence[Record]) -> Iterator[tuple[float, bool]]:
    """Size over the noise of each catalogue cause, and whether it was found."""
    for record in records:
        truth, found = record["truth"], found_causes(record)
        for effect, worth in truth.get("signatures", {}).items():
            if effect in truth.get("places", {}) or effect in SILENT:
                continue
            across, out = truth["noise_mm"]
            noise = (2 * across**2 + out**2) ** 0.5
            yield worth["signature_left_mm"] / noise, (effect, None) in found


def detectable(records: Sequence[Record]) -> dict[str, dict[str, Any]]:
    """Of each effect alone: the smallest signature (rms, mm) found and the largest missed.

    `_left` is the part of the signature that changed moduli cannot imitate.
    """
    sizes: dict[str, dict[bool, list[tuple[float, float]]]] = {}
    for record in records:
        truth = record["truth"]
        if truth["kind"] == "one":
            (effect,) = truth["effects"]
            size = truth["signature_mm"], truth["signature_left_mm"]
            found = (effect, None) in found_causes(record)
            sizes.setdefault(effect, {True: [], False: []})[found].append(size)
    return {
        effect: {
            "tests": len(by[True]) + len(by[False]),
            "found": len(by[True]),
            "smallest_found_mm": min((s for s, _ in by[True]), default=None),
            "smallest_found_left_mm": min((s for _, s in by[True]), default=None),
            "largest_missed_mm": max((s for s, _ in by[False]), default=None),
            "largest_missed_left_mm": max((s for _, s in by[False]), default=None),
        }
        for effect, by in sorted(sizes.items())
    }


def heldout(records: Sequence[Record]) -> dict[str, Any]:
    """Held-out gap e (mm) before and after, and the noise floor; medians over the tests."""
    rows = [row for record in records if (row := _gaps(record["answer"])) is not None]
    ratios = [after / floor for _, after, floor in rows]
    middle = [median(row[i] for row in rows) if rows else None for i in range(3)]
    return {
        **dict(zip(("before_mm", "after_mm", "floor_mm"), middle, strict=True)),
        "median_ratio": median(ratios) if ratios else None,
        "closed": share(r <= CLOSED for r in ratios),
    }


def _gaps(answer: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """Held-out e (mm) before and after, and the floor; None where one is missing."""
    gap = answer.get("gap") or {}
    kept_out = gap.get("heldout") or {}
    parts = kept_out.get("baseline"), kept_out.get("explained"), gap.get("noise_floor")
    found = [float(v) for part in parts if (v := (part or {}).get("e")) is not None]
    if len(found) < 3 or not all(map(isfinite, found)) or found[2] <= 0.0:
        return None
    return found[0], found[1], found[2]
