"""How far off are the parameters, the moduli and the laws that a diagnosis states?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from statistics import median
from typing import Any

import numpy as np

from bulgefit.trial.cloth import moduli_about
from bulgefit.trial.known import SILENT
from bulgefit.trial.right import Record, is_right
from bulgefit.trial.shares import share

__all__ = ["judge_law", "moduli_errors", "parameter_errors", "summary"]

#: Standard errors within which a parameter counts as met.
WITHIN = 3.0
#: A family's law is met within so many standard errors, and within this share of it.
LAW_STDERRS, LAW_SHARE = 2.0, 0.02


def parameter_errors(records: Sequence[Record]) -> dict[str, Any]:
    """Errors of the parameters of effects that were named, over all and by effect."""
    by_effect: dict[str, list[tuple[float | None, float | None]]] = {}
    for record in records:
        for effect, error in _named_errors(record):
            by_effect.setdefault(effect, []).append(error)
    everything = summary([e for errors in by_effect.values() for e in errors])
    return {**everything, "by_effect": {k: summary(v) for k, v in sorted(by_effect.items())}}


def _named_errors(record: Record) -> Iterator[tuple[str, tuple[float | None, float | None]]]:
    """Effect and (error in standard errors, relative error) of each parameter reported.

    The relative error is over the largest true parameter of the same effect and kind, so that a
    component near zero does not count for more than the vector it belongs to.
    """
    if not is_right(record):
        return
    for cause in record["answer"].get("causes", ()):
        effect = cause["effect"]
        true = record["truth"].get("parameters", {}).get(effect, {})
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


def moduli_errors(record: Record) -> list[tuple[float | None, float | None]]:
    """Errors of E1, E2, G12 once the causes are added, where they can be known.

    Of a family the law is judged instead. Of plies that lie askew those of all of them are meant,
    about the axes that the answer has: about such as lie between theirs they may be orthotropic.
    """
    if "specimens" in record["truth"] or any(e in SILENT for e in record["truth"]["effects"]):
        return []
    told = record["answer"].get("parameters", {}).get("corrected", {})
    true = record["truth"]["moduli"]
    if (whole := record["truth"].get("stiffness_MPa")) is not None:
        true = moduli_about(np.array(whole), _turn(record))
    return [_error(told[n], true[n], true[n]) for n in true if n in told]


def _turn(record: Record) -> float:
    """Degrees by which the answer's warp is turned against the true one."""
    true = record["truth"]["parameters"].get("axis_misalignment", {}).get("angle", 0.0)
    told = [c for c in record["answer"].get("causes", ()) if c["effect"] == "axis_misalignment"]
    return sum(float(c["parameters"]["angle"]["value"]) for c in told[:1]) - float(true)


def summary(errors: Sequence[tuple[float | None, float | None]]) -> dict[str, Any]:
    """Share within 3 standard errors, and medians, of errors in standard errors and relative."""
    in_stderr = [z for z, _ in errors if z is not None]
    relative = [r for _, r in errors if r is not None]
    return {
        "within_3_stderr": share(z <= WITHIN for z in in_stderr),
        "median_stderrs": median(in_stderr) if in_stderr else None,
        "median_relative": median(relative) if relative else None,
    }


def judge_law(record: Record) -> bool | None:
    """Whether a family's law is met at every strain of the truth; None where none is told."""
    true, told = record["truth"].get("law"), record["answer"].get("law")
    if true is None or told is None:
        return None
    for side in ("warp_N_per_mm", "fill_N_per_mm"):
        at = np.array(true["strain"])
        found = np.interp(at, told["strain"], told[side], left=np.nan, right=np.nan)
        error = np.abs(found - true[side])
        stderr = np.interp(at, told["strain"], _stderr(told, side))
        if not (
            (error <= LAW_STDERRS * stderr) & (error <= LAW_SHARE * np.array(true[side]))
        ).all():
            return False
    return True


def _stderr(told: Mapping[str, Any], side: str) -> Sequence[float]:
    """Standard errors of one side of a law: told for each, or for both as one."""
    stderr = told["stderr"]
    return list(stderr[side]) if isinstance(stderr, Mapping) else list(stderr)
