"""How far is the gap closed, and what becomes of the moduli?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bulgefit.gap.effects import MODULI
from bulgefit.report.numbers import value_text
from bulgefit.report.record import Record
from bulgefit.report.words.names import percent_text

__all__ = ["GAP_COLUMNS", "gap_rows", "held_out_words", "moduli_rows", "shrinkage"]

#: Of the table of gaps.
GAP_COLUMNS = ("dx", "dy", "dz", "e", "e_w", "chi")


def gap_rows(record: Record) -> list[tuple[str, dict[str, float]]]:
    """Gaps before and after, fitted and held out, and of noise alone."""
    gap, added = record["gap"], bool(record["tried"])
    rows = [("fitted, moduli alone", gap["baseline"])]
    if added:
        rows.append(("fitted, with causes", gap["explained"]))
    rows.append(("held out, moduli alone", gap["heldout"]["baseline"]))
    if added:
        rows.append(("held out, with causes", gap["heldout"]["explained"]))
    return [*rows, ("noise alone", gap["noise_floor"])]


def shrinkage(record: Record) -> str:
    """How far the gap on data that was not fitted shrinks."""
    gap = record["gap"]
    before, after = (gap["heldout"][k]["e_w"] for k in ("baseline", "explained"))
    floor = gap["noise_floor"]["e_w"]
    if not record["tried"]:
        return f"Nothing was added: e_w is {before:.3g} mm, of which noise makes {floor:.3g} mm."
    return (
        f"On data that was not fitted e_w falls from {before:.3g} to {after:.3g} mm "
        f"({percent_text(1 - after / before)} less); noise alone makes {floor:.3g} mm."
        + (" What is left is no larger than the noise." if after <= floor else "")
    )


def held_out_words(record: Record) -> str:
    """How the specimen that was kept out is met; nothing where there is none."""
    kept = record.get("holdout")
    if kept is None:
        return ""
    own = sorted({name.partition(".")[0] for name in kept["parameters"]})
    found = f" ({', '.join(own)})" if own else ""
    return (
        f"{kept['test']} took no part. With what specimens share from the other tests, and what it "
        f"has of its own{found} by {len(kept['fitted_bar'])} of its frames, e_w on the "
        f"{len(kept['judged_bar'])} between them goes from "
        f"{kept['baseline']['e_w']:.4f} to {kept['explained']['e_w']:.4f} mm (noise "
        f"{kept['noise_floor']['e_w']:.4f})."
    )


def moduli_rows(record: Record) -> list[tuple[str, str, str]]:
    """Moduli (MPa) before and after, with their standard errors."""
    fits = [record["parameters"][kind] for kind in ("baseline", "corrected")]
    return [(m.name, *(_modulus(fit[m.name]) for fit in fits)) for m in MODULI]  # type: ignore[misc]


def _modulus(found: Mapping[str, Any]) -> str:
    if found["held"]:
        return f"{found['value']:.3g} at most"
    return value_text(found["value"], found["stderr"])
