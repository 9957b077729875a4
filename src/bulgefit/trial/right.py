"""Is a verdict right? Causes that were found, that were missed, and that are not there.

A record is a dict of `file`, `truth` (as `make` or `family` writes it), `answer` (as a
diagnosis's `to_dict` gives it) and `struck`, the effects that were taken out of the catalogue.
Answers without probabilities, places and fields are judged by what they have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from bulgefit.trial.known import SILENT

__all__ = [
    "SAME_AS",
    "SURE",
    "Record",
    "at_a_foreign_place",
    "false_causes",
    "found_effects",
    "is_right",
    "is_sure",
    "names_of",
    "standing_in",
    "sure_causes",
]

Record = Mapping[str, Any]

#: What may stand for an effect that is struck from the catalogue, since data of this kind cannot
#: tell them apart or one is nearly a special case of the other.
SAME_AS: dict[str, tuple[str, ...]] = {
    "clamp_shape": ("dic_scale",),  # radius_error
    "dic_scale": ("clamp_shape",),
    "rigid_motion": ("reference_state",),
    "initial_shape": ("reference_state",),
}

#: Probability from which on a cause, or a field, is said to be there.
SURE = 0.95
#: A cause counts as found in a set of at most this many effects.
LARGEST_SET = 2
#: Verdicts whose causes are meant, and those that leave something without a name.
_MEANT, _OPEN = ("named", "ambiguous", "partial"), ("partial", "unknown")


def is_right(record: Record) -> bool:
    """Whether a verdict is right.

    Where nothing is wrong, `none` is right. Each effect must be named, or be in a set of at most
    two, and no other may be sure; about `SILENT` effects silence is right too. Where a foreign
    effect is at work, something must be left without a name: `partial`, or `unknown` where it is
    alone. An effect that was struck must be answered `unknown`, or by one that is known to be
    indistinguishable from it.
    """
    truth, verdict = record["truth"], record["answer"].get("verdict")
    loud = [e for e in _catalogued(truth) if e not in SILENT]
    if truth["kind"] == "foreign":
        return verdict in _OPEN and {*loud} <= found_effects(record) and not false_causes(record)
    if not loud and verdict == "none":
        return True
    struck = [e for e in truth["effects"] if e in record["struck"]]
    if struck:
        others = [same for e in struck for same in SAME_AS.get(e, ())]
        return bool(verdict == "unknown" or (others and _named(others, others, record)))
    return _named(loud, truth["effects"], record)


def _named(needed: Sequence[str], allowed: Sequence[str], record: Record) -> bool:
    """Whether everything is named that must be, and nothing that may not."""
    return (
        record["answer"].get("verdict") in ("named", "ambiguous")
        and bool(sure_causes(record))
        and {*needed} <= _found(needed, record)
        and not _unmatched(allowed, record)
    )


def sure_causes(record: Record) -> list[Mapping[str, Any]]:
    """Causes that are said to be there, each set of effects once.

    Specimens of a family have causes of their own, which count as one where they are right.
    """
    answer = record["answer"]
    if answer.get("verdict") not in _MEANT:
        return []
    sure = [cause for cause in answer.get("causes", ()) if is_sure(cause)]
    return list({(frozenset(names_of(c)), _at_another(record, c)): c for c in sure}.values())


def _at_another(record: Record, cause: Mapping[str, Any]) -> bool:
    """Whether a cause is said of a specimen of a family that does not have it."""
    return any(
        cause.get("specimen") == number and not names_of(cause) & {*specimen["effects"]}
        for number, specimen in enumerate(record["truth"].get("specimens", ()))
    )


def is_sure(told: Mapping[str, Any]) -> bool:
    """Whether a cause or a field is said to be there, or that it or one of its alternatives is.

    Alternatives are told where all of them together are sure. One without a probability is sure.
    """
    probability = told.get("probability")
    return probability is None or bool(probability >= SURE or told.get("alternatives"))


def names_of(cause: Mapping[str, Any]) -> set[str]:
    """A cause and what cannot be told from it."""
    return {cause["effect"], *cause.get("alternatives", ())}


def found_effects(record: Record) -> set[str]:
    """Effects of the catalogue that have a sure cause of their own, alone or in a set of two."""
    return _found(_catalogued(record["truth"]), record)


def false_causes(record: Record) -> list[Mapping[str, Any]]:
    """Sure causes that are not there, but for those that stand in for a foreign effect."""
    left = _unmatched(record["truth"]["effects"], record)
    return [cause for cause in left if not at_a_foreign_place(record, cause)]


def standing_in(record: Record) -> list[Mapping[str, Any]]:
    """Sure causes that are not there, at the place of a foreign effect.

    A place's catalogue effects are directions of what may be wrong there; a foreign effect has a
    part along them.
    """
    left = _unmatched(record["truth"]["effects"], record)
    return [cause for cause in left if at_a_foreign_place(record, cause)]


def at_a_foreign_place(record: Record, cause: Mapping[str, Any]) -> bool:
    """Whether a foreign effect is at a cause's place."""
    return cause.get("place") in record["truth"].get("places", {}).values()


def _catalogued(truth: Mapping[str, Any]) -> list[str]:
    """True effects without the foreign ones; older truths have no places but one effect alone."""
    strangers = truth.get("places", truth["effects"] if truth["kind"] == "foreign" else ())
    return [effect for effect in truth["effects"] if effect not in strangers]


def _found(effects: Sequence[str], record: Record) -> set[str]:
    small = [cause for cause in sure_causes(record) if len(names_of(cause)) <= LARGEST_SET]
    matched = _matching(effects, small, record)
    return {effect for effect, match in zip(effects, matched, strict=True) if match >= 0}


def _unmatched(effects: Sequence[str], record: Record) -> list[Mapping[str, Any]]:
    """Sure causes that are no true effect's own."""
    causes = sure_causes(record)
    taken = {*_matching(effects, causes, record)}
    return [cause for number, cause in enumerate(causes) if number not in taken]


def _matching(
    effects: Sequence[str], causes: Sequence[Mapping[str, Any]], record: Record
) -> list[int]:
    """Number of the cause that is meant for each effect, -1 for none: as many as can be."""
    if not effects or not causes:
        return [-1] * len(effects)
    meant = [set() if _at_another(record, cause) else names_of(cause) for cause in causes]
    fits = np.array([[effect in names for names in meant] for effect in effects])
    return [int(i) for i in maximum_bipartite_matching(csr_array(fits), perm_type="column")]
