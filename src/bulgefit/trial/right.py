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

from bulgefit.trial.known import OF_CLOTH, SILENT

__all__ = [
    "SAME_AS",
    "SURE",
    "Record",
    "TrueCause",
    "at_a_foreign_place",
    "false_causes",
    "found_causes",
    "is_right",
    "is_sure",
    "is_there",
    "names_of",
    "standing_in",
    "sure_causes",
    "true_causes",
]

Record = Mapping[str, Any]
#: An effect, and the specimen of a family whose own it is: None of a test alone, or of the cloth.
TrueCause = tuple[str, int | None]

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
    loud = [cause for cause in true_causes(record) if cause[0] not in SILENT]
    if truth["kind"] == "foreign":
        return verdict in _OPEN and {*loud} <= found_causes(record) and not false_causes(record)
    if not loud and verdict == "none":
        return True
    struck = [e for e in truth["effects"] if e in record["struck"]]
    if struck:
        others = [(same, None) for e in struck for same in SAME_AS.get(e, ())]
        return bool(verdict == "unknown" or (others and _named(others, others, record)))
    return _named(loud, true_causes(record), record)


def _named(needed: Sequence[TrueCause], allowed: Sequence[TrueCause], record: Record) -> bool:
    """Whether everything is named that must be, and nothing that may not."""
    return (
        record["answer"].get("verdict") in ("named", "ambiguous")
        and bool(sure_causes(record))
        and {*needed} <= _found(needed, record)
        and not _unmatched(allowed, record)
    )


def true_causes(record: Record) -> list[TrueCause]:
    """Effects of the catalogue that are there; older truths have no places but one effect alone."""
    truth = record["truth"]
    strangers = truth.get("places", truth["effects"] if truth["kind"] == "foreign" else ())
    if "specimens" not in truth:
        return [(effect, None) for effect in truth["effects"] if effect not in strangers]
    shared: list[TrueCause] = [(e, None) for e in truth["effects"] if e in OF_CLOTH]
    return shared + [
        (effect, number)
        for number, specimen in enumerate(truth["specimens"])
        for effect in specimen["effects"]
        if effect not in OF_CLOTH
    ]


def sure_causes(record: Record) -> list[Mapping[str, Any]]:
    """Causes that are said to be there."""
    answer = record["answer"]
    if answer.get("verdict") not in _MEANT:
        return []
    return [cause for cause in answer.get("causes", ()) if is_sure(cause)]


def is_sure(told: Mapping[str, Any]) -> bool:
    """Whether a cause or a field is said to be there, or that it or one of its alternatives is.

    Alternatives are told where all of them together are sure. One without a probability is sure.
    """
    probability = told.get("probability")
    return probability is None or bool(probability >= SURE or told.get("alternatives"))


def names_of(cause: Mapping[str, Any]) -> set[str]:
    """A cause and what cannot be told from it."""
    return {cause["effect"], *cause.get("alternatives", ())}


def is_there(cause: Mapping[str, Any], of: TrueCause) -> bool:
    """Whether a cause, or what cannot be told from it, is one of those that are there."""
    return of[0] in names_of(cause) and of[1] == cause.get("specimen")


def found_causes(record: Record) -> set[TrueCause]:
    """Those of the catalogue that have a sure cause of their own, alone or in a set of two."""
    return _found(true_causes(record), record)


def false_causes(record: Record) -> list[Mapping[str, Any]]:
    """Sure causes that are not there, but for those that stand in for a foreign effect."""
    left = _unmatched(true_causes(record), record)
    return [cause for cause in left if not at_a_foreign_place(record, cause)]


def standing_in(record: Record) -> list[Mapping[str, Any]]:
    """Sure causes that are not there, at the place of a foreign effect.

    A place's catalogue effects are directions of what may be wrong there; a foreign effect has a
    part along them.
    """
    left = _unmatched(true_causes(record), record)
    return [cause for cause in left if at_a_foreign_place(record, cause)]


def at_a_foreign_place(record: Record, cause: Mapping[str, Any]) -> bool:
    """Whether a foreign effect is at a cause's place."""
    return cause.get("place") in record["truth"].get("places", {}).values()


def _found(causes: Sequence[TrueCause], record: Record) -> set[TrueCause]:
    small = [cause for cause in sure_causes(record) if len(names_of(cause)) <= LARGEST_SET]
    matched = _matching(causes, small)
    return {true for true, match in zip(causes, matched, strict=True) if match >= 0}


def _unmatched(causes: Sequence[TrueCause], record: Record) -> list[Mapping[str, Any]]:
    """Sure causes that are none of those that are there."""
    sure = sure_causes(record)
    taken = {*_matching(causes, sure)}
    return [cause for number, cause in enumerate(sure) if number not in taken]


def _matching(causes: Sequence[TrueCause], told: Sequence[Mapping[str, Any]]) -> list[int]:
    """Number of what is told of each that is there, -1 for nothing: as many as can be."""
    if not causes or not told:
        return [-1] * len(causes)
    fits = np.array([[is_there(one, cause) for one in told] for cause in causes])
    return [int(i) for i in maximum_bipartite_matching(csr_array(fits), perm_type="column")]
