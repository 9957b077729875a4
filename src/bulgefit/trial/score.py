"""How good are blind diagnoses, once their truth is opened? All figures of a trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.trial.accuracy import judge_law, moduli_errors, parameter_errors, summary
from bulgefit.trial.known import SILENT
from bulgefit.trial.places import false_fields, judge_place
from bulgefit.trial.reliability import reliability, stated_causes, stated_fields
from bulgefit.trial.right import (
    Record,
    false_causes,
    found_causes,
    is_right,
    names_of,
    standing_in,
    sure_causes,
    true_causes,
)
from bulgefit.trial.shares import share
from bulgefit.trial.sizes import by_size, detectable, heldout

__all__ = ["judge", "score"]

#: Kinds of tests whose every cause is in the catalogue.
_KNOWN = ("one", "two", "several", "family")


def judge(record: Record) -> dict[str, Any]:
    """A line about one test: what was true, what was said, and whether that is right."""
    truth, answer = record["truth"], record["answer"]
    place, law = judge_place(record), judge_law(record)
    return {
        "file": record["file"],
        "truth": list(truth["effects"]),
        "verdict": answer.get("verdict"),
        "causes": [[c["effect"], *c.get("alternatives", ())] for c in answer.get("causes", ())],
        "right": is_right(record),
        "signature_mm": truth.get("signature_mm"),
        "struck": list(record["struck"]),
        **({} if place is None else {"place_right": place}),
        **({} if law is None else {"law_right": law}),
        **({"error": answer["error"]} if "error" in answer else {}),
    }


def score(records: Sequence[Record]) -> dict[str, Any]:
    """All figures of a trial.

    Returns
    -------
    dict
        Shares with Wilson's intervals: of tests that are right, `found` (nothing foreign),
        `found_one`, `found_two`, `found_several`, `families`, `false_alarms`, `foreign_unknown`,
        `struck_right`; of causes, `causes` (`found`, `false` of what was sure, `standing_in`,
        `by_effect`, `by_size`); of foreign effects, `places` and `spots`; of tests without one,
        `false_fields`; of families, `laws`. `reliability` of causes and fields, `failed`
        (diagnoses that raised an error), `confusion` (truth to answer to number), `parameters`,
        `moduli` and `moduli_all` (errors), `heldout` (gaps, mm) and `detectable` (sizes, mm).
    """
    struck = [r for r in records if r["struck"]]
    whole = [r for r in records if not r["struck"]]
    clean, known, foreign = (
        [r for r in whole if r["truth"]["kind"] in kinds]
        for kinds in (("none",), _KNOWN, ("foreign",))
    )
    places = [told for r in foreign if (told := judge_place(r)) is not None]
    laws = [met for r in known if (met := judge_law(r)) is not None]
    return {
        "tests": len(records),
        "found": share(is_right(r) for r in known),
        "found_one": _right_of(known, "one"),
        "found_two": _right_of(known, "two"),
        "found_several": _right_of(known, "several"),
        "families": _right_of(known, "family"),
        "false_alarms": share(not is_right(r) for r in clean),
        "foreign_unknown": share(is_right(r) for r in foreign),
        "struck_right": share(is_right(r) for r in struck),
        "causes": _causes(whole),
        "places": share(told["place"] for told in places),
        "spots": share(told["spot"] for told in places if "spot" in told),
        "false_fields": share(bool(false_fields(r)) for r in (*clean, *known)),
        "laws": share(laws),
        "reliability": {
            "causes": reliability(stated_causes(whole)),
            "fields": reliability(stated_fields(whole)),
        },
        "failed": sum("error" in r["answer"] for r in records),
        "confusion": _confusion(records),
        "parameters": parameter_errors(known),
        "moduli": summary([e for r in known if is_right(r) for e in moduli_errors(r)]),
        "moduli_all": summary([e for r in whole for e in moduli_errors(r)]),
        "heldout": heldout(known),
        "detectable": detectable(known),
    }


def _right_of(records: Sequence[Record], kind: str) -> dict[str, Any]:
    return share(is_right(r) for r in records if r["truth"]["kind"] == kind)


def _causes(records: Sequence[Record]) -> dict[str, Any]:
    """Catalogue causes that were found, those of a family by specimen; sure ones not there."""
    by_effect: dict[str, list[bool]] = {}
    for record in records:
        found = found_causes(record)
        for cause in true_causes(record):
            if cause[0] not in SILENT:
                by_effect.setdefault(cause[0], []).append(cause in found)
    sure, false, standing = (
        sum(len(count(record)) for record in records)
        for count in (sure_causes, false_causes, standing_in)
    )
    return {
        "found": share(hit for hits in by_effect.values() for hit in hits),
        "false": share([True] * false + [False] * (sure - false)),
        "standing_in": standing,
        "by_effect": {effect: share(hits) for effect, hits in sorted(by_effect.items())},
        "by_size": by_size(records),
    }


def _confusion(records: Sequence[Record]) -> dict[str, dict[str, int]]:
    """How often each truth was answered in which way."""
    table: dict[str, dict[str, int]] = {}
    for record in records:
        kind, effects = record["truth"]["kind"], record["truth"]["effects"]
        row = str(effects[0]) if len(effects) == 1 and kind != "family" else kind
        row = f"{row}, struck" if record["struck"] else row
        column = _said(record["answer"])
        table.setdefault(row, {}).setdefault(column, 0)
        table[row][column] += 1
    return {row: dict(sorted(table[row].items())) for row in sorted(table)}


def _said(answer: Mapping[str, Any]) -> str:
    """The answer in a word: the verdict, or the causes, alternatives after a stroke."""
    verdict = str(answer.get("verdict"))
    if verdict not in ("named", "ambiguous", "partial"):
        return verdict
    causes = " + ".join(sorted("/".join(sorted(names_of(c))) for c in answer.get("causes", ())))
    return f"partial {causes}" if verdict == "partial" else causes
