"""What is to be done next, and which measurement would tell most?"""

from __future__ import annotations

from bulgefit.dic.noise import Source
from bulgefit.effects.registry import catalogue
from bulgefit.report.numbers import listed
from bulgefit.report.record import Record

__all__ = ["action_items", "advice_items"]

#: Separation (standard errors) from which two explanations need no further measurement.
_APART = 10.0


def action_items(record: Record) -> list[str]:
    """What to do about causes, noise and what could not be tried."""
    items = [f"{name}: {remedy}." for name, remedy in record["report"]["remedies"].items()]
    if any(noise["source"] != Source.AT_REST for noise in record["noise"]):
        items.append(
            "Film some ten images at rest before inflation: the noise had to be judged from the "
            "field itself."
        )
    for effect in record["skipped"]:
        needs = catalogue()[effect].needs if effect in catalogue() else ()
        items += [
            f"Record the {need} of every frame: without it {effect} cannot be tried."
            for need in needs
        ]
    return items


def advice_items(record: Record) -> list[str]:
    """Which measurement would split what competes."""
    if not record["advice"]:
        return ["No two explanations compete; no further measurement is needed to split them."]
    now, *others = record["advice"]
    pair = listed(now["between"])
    useful = [a for a in others if a["separation"] > 1.05 * now["separation"]]
    rivals = any(c["alternatives"] for c in record["causes"])
    if not rivals and now["separation"] >= _APART:
        return [
            f"The two leading explanations, {pair}, lie "
            f"{now['separation']:.0f} standard errors apart with this data: no further measurement "
            "is needed to split them."
        ]
    if not useful:
        return [f"No further measurement that was tried would split {pair}."]
    options = [f"{a['measurement']} ({a['separation']:.0f})" for a in useful[:3]]
    return [
        f"To split {pair}, best first: {'; '.join(options)}. In brackets the "
        f"standard errors that would lie between them; now it is {now['separation']:.0f}."
    ]
