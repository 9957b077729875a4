"""How good are blind diagnoses, once their truth is opened?

A record is a dict of `file`, `truth` (as `make` writes it), `answer` (as a diagnosis's
`to_dict` gives it) and `struck`, the effects that were taken out of the catalogue.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import permutations
from math import isfinite, sqrt
from statistics import median
from typing import Any

__all__ = ["SAME_AS", "is_right", "judge", "report", "score", "wilson"]

Record = Mapping[str, Any]

#: Effects that no test, or next to none, can show beside the moduli: silence about them is right.
SILENT = ("pressure_gain", "poisson_ratio")

#: What may stand for an effect that is struck from the catalogue, since data of this kind cannot
#: tell them apart or one is nearly a special case of the other.
SAME_AS: dict[str, tuple[str, ...]] = {
    "clamp_shape": ("dic_scale",),  # radius_error
    "dic_scale": ("clamp_shape",),
    "rigid_motion": ("reference_state",),
    "initial_shape": ("reference_state",),
}

#: A cause counts as found in a set of at most this many effects.
LARGEST_SET = 2
#: Standard errors within which a parameter counts as met.
WITHIN = 3.0
#: Held-out gap over the noise floor that counts as closed.
CLOSED = 1.15


def wilson(hits: int, of: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's interval of a share, 95 % unless `z` says otherwise; (0, 1) of nothing."""
    if of == 0:
        return 0.0, 1.0
    share, square = hits / of, z * z / of
    middle = (share + 0.5 * square) / (1.0 + square)
    half = z * sqrt(share * (1.0 - share) / of + 0.25 * square / of) / (1.0 + square)
    return max(0.0, middle - half), min(1.0, middle + half)


def is_right(record: Record) -> bool:
    """Whether a verdict is right.

    Where nothing is wrong, `none` is right. Each effect must be named, or be in a set of at most
    two, and nothing else may be named; about `SILENT` effects silence is right too. A foreign
    effect must be answered `unknown`. An effect that was struck must be answered `unknown`, or
    by one that is known to be indistinguishable from it.
    """
    truth, answer = record["truth"], record["answer"]
    verdict = answer.get("verdict")
    if truth["kind"] == "foreign":
        return bool(verdict == "unknown")
    silent = [e for e in truth["effects"] if e in SILENT]
    loud = [e for e in truth["effects"] if e not in SILENT]
    if not loud and verdict == "none":
        return True
    struck = [e for e in truth["effects"] if e in record["struck"]]
    if struck:
        return verdict == "unknown" or _covers(
            [s for e in struck for s in SAME_AS.get(e, ())], (), answer
        )
    return verdict in ("named", "ambiguous") and _covers(loud, silent, answer)


def _covers(needed: Sequence[str], allowed: Sequence[str], answer: Mapping[str, Any]) -> bool:
    """Whether each needed effect has a cause of its own, and each cause an effect."""
    causes = [_names(cause) for cause in answer.get("causes", ())]
    if not causes or any(len(names) > LARGEST_SET for names in causes):
        return False
    # which cause is meant for which effect: any order in which all fit
    return any(
        all(effect in names for effect, names in zip(needed, order, strict=False))
        and all(names & {*allowed} for names in order[len(needed) :])
        for order in permutations(causes)
        if len(order) >= len(needed)
    )


def _names(cause: Mapping[str, Any]) -> set[str]:
    return {cause["effect"], *cause.get("alternatives", ())}


def judge(record: Record) -> dict[str, Any]:
    """A line about one test: what was true, what was said, and whether that is right."""
    truth, answer = record["truth"], record["answer"]
    return {
        "file": record["file"],
        "truth": list(truth["effects"]),
        "verdict": answer.get("verdict"),
        "causes": [[c["effect"], *c.get("alternatives", ())] for c in answer.get("causes", ())],
        "right": is_right(record),
        "signature_mm": truth.get("signature_mm"),
        "struck": list(record["struck"]),
        **({"error": answer["error"]} if "error" in answer else {}),
    }


def score(records: Sequence[Record]) -> dict[str, Any]:
    """All figures of a trial.

    Returns
    -------
    dict
        `found`, `false_alarms`, `foreign_unknown`, `struck_right` (shares with Wilson's
        intervals), `failed` (diagnoses that raised an error), `confusion` (truth to answer to
        number), `parameters`, `moduli` (errors), `heldout` (gaps, mm) and `detectable` (sizes,
        mm).
    """
    struck = [r for r in records if r["struck"]]
    whole = [r for r in records if not r["struck"]]
    clean, known, foreign = (
        [r for r in whole if r["truth"]["kind"] in kinds]
        for kinds in (("none",), ("one", "two"), ("foreign",))
    )
    return {
        "tests": len(records),
        "found": _share(is_right(r) for r in known),
        "found_one": _share(is_right(r) for r in known if r["truth"]["kind"] == "one"),
        "found_two": _share(is_right(r) for r in known if r["truth"]["kind"] == "two"),
        "false_alarms": _share(not is_right(r) for r in clean),
        "foreign_unknown": _share(is_right(r) for r in foreign),
        "struck_right": _share(is_right(r) for r in struck),
        "failed": sum("error" in r["answer"] for r in records),
        "confusion": _confusion(records),
        "parameters": _parameter_errors(known),
        "moduli": _errors_summary([e for r in known if is_right(r) for e in _moduli_errors(r)]),
        "heldout": _heldout(known),
        "detectable": _detectable(known),
    }


def _share(answers: Iterable[bool]) -> dict[str, Any]:
    found = list(answers)
    hits = sum(found)
    return {
        "hits": hits,
        "of": len(found),
        "share": hits / len(found) if found else None,
        "wilson": list(wilson(hits, len(found))),
    }


def _confusion(records: Sequence[Record]) -> dict[str, dict[str, int]]:
    """How often each truth was answered in which way."""
    table: dict[str, dict[str, int]] = {}
    for record in records:
        kind, effects = record["truth"]["kind"], record["truth"]["effects"]
        row = kind if kind in ("none", "two") else str(effects[0])
        row = f"{row}, struck" if record["struck"] else row
        column = _said(record["answer"])
        table.setdefault(row, {}).setdefault(column, 0)
        table[row][column] += 1
    return {row: dict(sorted(table[row].items())) for row in sorted(table)}


def _said(answer: Mapping[str, Any]) -> str:
    """The answer in a word: the verdict, or the causes, alternatives after a stroke."""
    verdict = str(answer.get("verdict"))
    if verdict not in ("named", "ambiguous"):
        return verdict
    return " + ".join(sorted("/".join(sorted(_names(c))) for c in answer.get("causes", ())))


def _parameter_errors(records: Sequence[Record]) -> dict[str, Any]:
    """Errors of the parameters of effects that were named, over all and by effect."""
    by_effect: dict[str, list[tuple[float | None, float | None]]] = {}
    for record in records:
        for effect, error in _named_errors(record):
            by_effect.setdefault(effect, []).append(error)
    everything = [e for errors in by_effect.values() for e in errors]
    summary = _errors_summary(everything)
    return {**summary, "by_effect": {k: _errors_summary(v) for k, v in sorted(by_effect.items())}}


def _named_errors(record: Record) -> Iterator[tuple[str, tuple[float | None, float | None]]]:
    """Effect and (error in standard errors, relative error) of each parameter reported.

    The relative error is over the largest true parameter of the same effect and kind, so that a
    component near zero does not count for more than the vector it belongs to.
    """
    if not is_right(record):
        return
    for cause in record["answer"].get("causes", ()):
        effect = cause["effect"]
        true = record["truth"]["parameters"].get(effect, {})
        told = {_plain(effect, n): v for n, v in cause.get("parameters", {}).items()}
        for name, value in true.items():
            if name in told:
                same = [abs(v) for n, v in true.items() if _sort(n) == _sort(name)]
                yield effect, _error(told[name], value, max(same))


def _plain(effect: str, name: str) -> str:
    """A parameter's bare name."""
    return name.removeprefix(f"{effect}.").replace("_per_bar", "")


def _sort(name: str) -> str:
    """Parameters of one effect that compare have one unit: rotations do not with shifts."""
    return "rotation" if name.startswith("rotation") else "other"


def _error(told: Mapping[str, Any], true: float, scale: float) -> tuple[float | None, float | None]:
    value, stderr = told.get("value"), told.get("stderr")
    if value is None or not isfinite(value):
        return None, None
    off = abs(value - true)
    known = stderr is not None and isfinite(stderr) and stderr > 0
    return (off / stderr if known else None), (off / scale if scale > 0 else None)


def _moduli_errors(record: Record) -> list[tuple[float | None, float | None]]:
    """Errors of E1, E2, G12 once the effect is added; not where they cannot be known."""
    if any(e in SILENT for e in record["truth"]["effects"]):
        return []
    told = record["answer"].get("parameters", {}).get("corrected", {})
    true = record["truth"]["moduli"]
    return [_error(told[n], true[n], true[n]) for n in true if n in told]


def _errors_summary(errors: Sequence[tuple[float | None, float | None]]) -> dict[str, Any]:
    in_stderr = [z for z, _ in errors if z is not None]
    relative = [r for _, r in errors if r is not None]
    return {
        "within_3_stderr": _share(z <= WITHIN for z in in_stderr),
        "median_stderrs": median(in_stderr) if in_stderr else None,
        "median_relative": median(relative) if relative else None,
    }


def _heldout(records: Sequence[Record]) -> dict[str, Any]:
    """Held-out gap e (mm) before and after, and the noise floor; medians over the tests."""
    rows = [row for record in records if (row := _gaps(record["answer"])) is not None]
    ratios = [after / floor for _, after, floor in rows]
    middle = [median(row[i] for row in rows) if rows else None for i in range(3)]
    return {
        **dict(zip(("before_mm", "after_mm", "floor_mm"), middle, strict=True)),
        "median_ratio": median(ratios) if ratios else None,
        "closed": _share(r <= CLOSED for r in ratios),
    }


def _gaps(answer: Mapping[str, Any]) -> tuple[float, float, float] | None:
    """Held-out e (mm) before and after, and the floor; None where one is missing."""
    gap = answer.get("gap") or {}
    heldout = gap.get("heldout") or {}
    parts = heldout.get("baseline"), heldout.get("explained"), gap.get("noise_floor")
    found = [float(v) for part in parts if (v := (part or {}).get("e")) is not None]
    if len(found) < 3 or not all(map(isfinite, found)) or found[2] <= 0.0:
        return None
    return found[0], found[1], found[2]


def _detectable(records: Sequence[Record]) -> dict[str, dict[str, Any]]:
    """Of each effect alone: the smallest signature (rms, mm) found and the largest missed.

    `_left` is the part of the signature that changed moduli cannot imitate.
    """
    sizes: dict[str, dict[bool, list[tuple[float, float]]]] = {}
    for record in records:
        truth = record["truth"]
        if truth["kind"] == "one":
            answer = record["answer"]
            found = answer.get("verdict") in ("named", "ambiguous") and any(
                truth["effects"][0] in _names(c) for c in answer.get("causes", ())
            )
            size = truth["signature_mm"], truth["signature_left_mm"]
            sizes.setdefault(truth["effects"][0], {True: [], False: []})[found].append(size)
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


def report(scores: Mapping[str, Any]) -> str:
    """The figures as a table of text."""
    lines = [f"{scores['tests']} made tests, {scores['failed']} diagnoses failed"]
    for key, words in (
        ("found", "effects named, or in a set of at most two"),
        ("false_alarms", "false alarms on clean tests"),
        ("foreign_unknown", "foreign effects answered unknown"),
        ("struck_right", "effects struck from the catalogue, not misnamed"),
    ):
        if scores[key]["of"]:
            lines.append(f"  {words:<50}{_share_text(scores[key])}")
    for key, words in (("parameters", "parameters"), ("moduli", "moduli")):
        part = scores[key]
        if part["within_3_stderr"]["of"]:
            lines.append(
                f"  {words + ' within 3 standard errors':<50}{_share_text(part['within_3_stderr'])}"
                f"; median error {100 * part['median_relative']:.1f} %"
            )
    held = scores["heldout"]
    if held["median_ratio"] is not None:
        lines.append(
            f"  {'held-out gap, medians':<50}{held['before_mm']:.4f} mm before, "
            f"{held['after_mm']:.4f} after, noise {held['floor_mm']:.4f} "
            f"(ratio {held['median_ratio']:.2f})"
        )
        lines.append(f"  {'held-out gap <= 1.15 times the noise':<50}{_share_text(held['closed'])}")
    return "\n".join([*lines, "", *_confusion_lines(scores), "", *_detectable_lines(scores)])


def _share_text(share: Mapping[str, Any]) -> str:
    low, high = share["wilson"]
    return (
        f"{share['hits']}/{share['of']} = {100 * share['share']:.1f} % "
        f"({100 * low:.1f} to {100 * high:.1f})"
    )


def _confusion_lines(scores: Mapping[str, Any]) -> list[str]:
    lines = ["truth".ljust(28) + "answers"]
    for row, answers in scores["confusion"].items():
        lines.append(f"{row:<28}" + ", ".join(f"{said} {n}" for said, n in answers.items()))
    return lines


def _detectable_lines(scores: Mapping[str, Any]) -> list[str]:
    if not scores["detectable"]:
        return []
    head = "effect".ljust(28) + "".join(
        f"{title:>22}" for title in ("found", "smallest found, mm", "largest missed, mm")
    )
    lines = [head]
    for effect, row in scores["detectable"].items():
        sizes = (row["smallest_found_mm"], row["largest_missed_mm"])
        shown = "".join(f"{'-' if size is None else f'{size:.4f}':>22}" for size in sizes)
        lines.append(f"{effect:<28}{row['found']:>15} of {row['tests']:>3}{shown}")
    return lines
