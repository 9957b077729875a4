"""What is to be done next, and which measurement would tell most?"""

from __future__ import annotations

from bulgefit.dic.noise import Source
from bulgefit.effects.registry import catalogue
from bulgefit.report.record import Record
from bulgefit.report.words.names import names_of

__all__ = ["action_items", "advice_items"]

#: Separation (standard errors) from which two explanations need no further measurement.
_APART = 10.0


def action_items(record: Record) -> list[str]:
    """What to do about causes, noise and what could not be tried."""
    items = [f"{name}: {remedy}." for name, remedy in record["report"]["remedies"].items()]
    if any(noise["source"] != Source.AT_REST for noise in record["noise"]):
        items.append(
            "Film some ten images at rest before inflation (--at-rest): the noise had to be judged "
            "from the field itself."
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
        return ["No two effects compete; no further measurement is needed to split them."]
    now, *others = record["advice"]
    first, second = now["between"]
    # an earlier version judged the first test, and said nothing of it
    test = names_of(record)[now.get("specimen", 0)]
    useful = [a for a in others if a["separation"] > 1.05 * now["separation"]]
    rivals = any(c["alternatives"] for c in record["causes"])
    size = f"{second}, at a tenth of its plausible range, would show by"
    beyond = f"standard errors beyond what {first} and the moduli can imitate"
    if not rivals and now["separation"] >= _APART:
        return [
            f"The least sure of what was found is {first}, the most probable of what was left out "
            f"{second}. {test} alone tells them apart: {size} {now['separation']:.0f} {beyond}. "
            "No further measurement is needed for that."
        ]
    if not useful:
        return [
            f"No further measurement that was tried would tell {first} from {second} better than "
            f"{test} does."
        ]
    options = "; ".join(f"{a['measurement']} ({a['separation']:.0f})" for a in useful[:3])
    why = useful[0].get("why")
    return [
        f"To tell {first} from {second}, measure beside {test}, best first: {options}"
        + (f". The first because {why}." if why else ".")
        + f" In brackets: {size} so many {beyond}; with {test} alone by {now['separation']:.0f}."
    ]
