"""What does a report need to know of a diagnosis? Its JSON, and what the pictures show beside it.

Reports are drawn from this record alone, so that the JSON that a command wrote is drawn again as
it was the first time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bulgefit.effects.registry import acting
from bulgefit.errors import BulgefitError, InputError
from bulgefit.fitting.result import describe_tests
from bulgefit.gap.data import Data
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.explanation import Step
from bulgefit.gap.keys import columns_of
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.locate import azimuthal_modes
from bulgefit.gap.residual.measure import fitted_gap, held_out_gap, weight_of
from bulgefit.gap.residual.structure import cells_of
from bulgefit.report._diagnosis_parts import residual_of

__all__ = ["SIGNIFICANT", "Record", "budget_of", "checked_record", "record_of"]

Record = Mapping[str, Any]

#: Standard errors from which a mean counts as significant.
SIGNIFICANT = 3.0


def record_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """The diagnosis as JSON types, with `report`: what its pictures and words need beside.

    `report` has `tests` (as a fit describes them, with the pressures in bar that were judged
    and the trust in those frames), `kept_out` (the one that took no part, where
    there is one), `candidates` (effects that were weighed), `values` of all freed parameters before
    and after (`effect.parameter@i` is test i's own), `budget` (e_w in mm from the moduli alone over
    each effect), by test `cells` and `modes` of the residual before and after and `mesh`, and
    `structure`.
    """
    found = diagnosis.explanation
    data = [p.data for p in diagnosis.prepared]
    rest = found.remainder
    fits = {"baseline": found.baseline, "final": found.final}
    tests = describe_tests(diagnosis.went_in)
    return {
        **diagnosis.to_dict(),
        "report": {
            "tests": [
                {
                    **described,
                    "judged_bar": (10.0 * d.specimen.recorded).tolist(),
                    "trust": d.share.tolist(),
                }
                for described, d in zip(tests[: len(data)], data, strict=True)
            ],
            **({} if diagnosis.kept_out is None else {"kept_out": tests[-1]}),
            "candidates": _candidates(diagnosis),
            "law": data[0].specimen.setup.law,
            "values": {name: {**diagnosis.held, **_values(fit)} for name, fit in fits.items()},
            "offsets": [offset is not None for offset in found.final.offsets],
            "budget": budget_of(diagnosis),
            "mesh_error_mm": _mesh_error(data),
            "cells": {name: _cells(data, fit) for name, fit in fits.items()},
            "modes": {name: _modes(data, fit) for name, fit in fits.items()},
            "structure": {
                "statistic": rest.statistic,
                "threshold": rest.threshold,
                "persistent": rest.persistent,
                "allowed": rest.allowed,
            },
            "mesh": [
                {
                    "taken_off_mm": p.discretisation.tolist(),
                    "left_mm": None if p.mesh_error is None else p.mesh_error.tolist(),
                }
                for p in diagnosis.prepared
            ],
            "remedies": _remedies(diagnosis),
        },
    }


def checked_record(content: Mapping[str, Any], where: str) -> Record:
    """A record that was read from JSON; InputError where a report cannot be drawn from it."""
    if not isinstance(content.get("report"), dict):
        raise InputError(
            f"{where}: lacks what a report shows beside the result; write it by bulgefit diagnose "
            "--json of this version"
        )
    return content


def _candidates(diagnosis: Diagnosis) -> list[str]:
    """Effects that were weighed, in the catalogue or with no name but a place."""
    weighed = [key.effect for key in diagnosis.explanation.known.keys]
    return [effect for effect in dict.fromkeys(weighed) if effect in acting()]


def _values(fit: Regression) -> dict[str, float]:
    return {str(key): float(value) for key, value in fit.values.items()}


def _mesh_error(data: Sequence[Data]) -> float | None:
    """Mean error of the mesh that was taken off, as e_w in mm; None where it is not known."""
    known = [d.specimen.correction for d in data if d.specimen.correction is not None]
    if not known:
        return None
    means = np.mean([np.abs(c).mean(axis=(0, 1)) for c in known], axis=0)
    return float(means @ (1.0, 1.0, weight_of(data)))


def budget_of(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """e_w (mm) with the moduli alone and after each effect, fitted and held out.

    The form of each effect is told by its parameters: an effect of several forms is another model
    by each.
    """
    data = [p.data for p in diagnosis.prepared]
    weight, gaps = weight_of(data), diagnosis.gaps
    steps = diagnosis.explanation.steps
    rows: list[dict[str, Any]] = [
        {
            "effect": None,
            "specimen": None,
            "parameters": [],
            "fitted_mm": gaps["baseline"]["e_w"],
            "heldout_mm": gaps["heldout_baseline"]["e_w"],
        }
    ]
    for step in steps[:-1]:
        try:
            fitted = fitted_gap(data, step.after, weight)["e_w"]
            held = held_out_gap(data, step.after, weight)["e_w"]
        except BulgefitError:  # counts with its successor
            continue
        rows.append(_budget_row(step, fitted, held))
    if steps:
        ends = (gaps[key]["e_w"] for key in ("explained", "heldout_explained"))
        rows.append(_budget_row(steps[-1], *ends))
    return rows


def _budget_row(step: Step, fitted: float, held: float) -> dict[str, Any]:
    own = columns_of(key for key in step.after.keys if key not in step.before.keys)
    return {
        "effect": " + ".join(group.effect for group in step.groups),
        "specimen": step.groups[0].specimen,
        "parameters": [key.parameter for key in own],
        "fitted_mm": fitted,
        "heldout_mm": held,
    }


def _cells(data: Sequence[Data], fit: Regression) -> list[list[dict[str, Any]]]:
    """Of each test."""
    return [
        [
            {**cell.to_dict(), "band_bar": list(cell.band)}
            for cell in cells_of(d, residual_of(d, fit, index) / d.sigma)
        ]
        for index, d in enumerate(data)
    ]


def _modes(data: Sequence[Data], fit: Regression) -> list[list[dict[str, Any]]]:
    """Of each test."""
    return [
        [m.to_dict() for m in azimuthal_modes([d], replace(fit, predictions=[prediction]))]
        for d, prediction in zip(data, fit.predictions, strict=True)
    ]


def _remedies(diagnosis: Diagnosis) -> dict[str, str]:
    """What to do about everything that was named, or has no name but a place."""
    named = [e for c in diagnosis.causes for e in (c.effect, *c.alternatives)]
    unnamed = [f.group.effect for f in diagnosis.explanation.fields]
    return {e: acting()[e].remedy for e in dict.fromkeys((*named, *unnamed)) if e in acting()}
