"""How is what a diagnosis found written to JSON? Each part by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bulgefit.effects.registry import acting, fields
from bulgefit.gap.causes import Cause
from bulgefit.gap.effects import MODULI, SHEAR
from bulgefit.gap.explanation import Explanation, FoundField, Step
from bulgefit.gap.level import Level
from bulgefit.gap.prepare import Prepared
from bulgefit.gap.regress import Regression
from bulgefit.gap.residual.measure import Gap
from bulgefit.gap.residual.structure import Cell
from bulgefit.gap.scatter import Scatter, of_the_cloth

__all__ = [
    "cells_dict",
    "field_dict",
    "gaps_dict",
    "moduli_dict",
    "noise_dict",
    "scatter_dict",
    "specimens_dict",
    "step_dict",
]

#: Standard errors from which a cell is told.
_TOLD = 3.0
#: Places of a field's map.
_PLACES = 1000


def gaps_dict(gaps: Mapping[str, Gap], prepared: Sequence[Prepared]) -> dict[str, Any]:
    """Before and after, fitted and held out, beside the noise and the mesh's error."""
    return {
        "baseline": gaps["baseline"],
        "explained": gaps["explained"],
        "heldout": {
            "baseline": gaps["heldout_baseline"],
            "explained": gaps["heldout_explained"],
        },
        "noise_floor": gaps["noise_floor"],
        "discretisation_mm": _mesh_error(prepared),
        "discretisation_corrected_mm": float(max(p.discretisation.max() for p in prepared)),
    }


def _mesh_error(prepared: Sequence[Prepared]) -> float | None:
    """Largest component (mm) of what is left of the mesh's error; None where not known."""
    found = [p.mesh_error for p in prepared if p.mesh_error is not None]
    return float(np.max(found)) if len(found) == len(prepared) else None


def cells_dict(cells: Sequence[Cell], most: int) -> list[dict[str, Any]]:
    """The most significant ones."""
    return [c.to_dict() for c in cells if abs(c.significance) > _TOLD][:most]


def moduli_dict(fit: Regression, level: Level | None = None) -> dict[str, dict[str, Any]]:
    """Of the cloth, where there are several specimens; times the level of a single one's fields."""
    level = level or Level()
    values, errors = of_the_cloth(fit.values), level.errors(fit)
    return {
        m.name: {
            "value": level.value * float(values[m]),
            "stderr": float(errors[m]),
            "unit": "MPa",
            "held": fit.held and m == SHEAR,
        }
        for m in MODULI
    }


def scatter_dict(found: Mapping[str, Scatter]) -> dict[str, Any] | None:
    """Of E1 and E2; None for one specimen."""
    if not found:
        return None
    values = {modulus: s.value for modulus, s in found.items()}
    return {**values, "stderr": {modulus: s.stderr for modulus, s in found.items()}}


def specimens_dict(
    prepared: Sequence[Prepared], scatter: Mapping[str, Scatter], causes: Sequence[Cause]
) -> list[dict[str, Any]]:
    """What each specimen has of its own; nothing for one."""
    if not scatter:
        return []
    return [
        {
            "test": p.data.specimen.test.name,
            "factors": {
                modulus: dict(zip(("value", "stderr"), s.factors[index], strict=True))
                for modulus, s in scatter.items()
            },
            "effects": [c.effect for c in causes if c.specimen == index],
        }
        for index, p in enumerate(prepared)
    ]


def field_dict(found: Explanation, field: FoundField) -> dict[str, Any]:
    """What has no name but its place."""
    evidence = found.evidence[field.group]
    kind = fields()[field.group.effect]
    largest, where = field.sampled.largest
    before, final = found.baseline, found.final
    share = None
    if (without := evidence.without) is not None:
        excess = max(before.held_out() - final.floor, 1e-9)
        share = float(np.clip((without.held_out() - final.held_out()) / excess, 0.0, 1.0))
    return {
        "place": kind.place,
        "field": kind.id,
        "specimen": field.group.specimen,
        "probability": evidence.probability,
        "alternatives": sorted({acting()[r.effect].place for r in evidence.rivals}),
        "quantity": kind.quantity,
        "rms": field.sampled.rms,
        "unit": kind.unit,
        "where": where,
        "largest": largest,
        "stderr": float(field.stderr[field.sampled.at_largest]),
        "share_of_gap": share,
        "map": _map_of(field),
    }


def _map_of(field: FoundField) -> dict[str, list[float]]:
    """A field and its standard error at its places, or at some of many: of a grid, every k-th line.

    Fields vary over a tenth of the radius and more, so that a thousand places of a disc show them.
    """
    where, kept = field.sampled.where, np.ones(len(field.stderr), dtype=bool)
    if "x_mm" in where and len(kept) > _PLACES:
        lines = [np.unique(where[axis], return_inverse=True) for axis in ("x_mm", "y_mm")]
        if np.prod([len(values) for values, _ in lines]) < 2 * len(kept):
            every = int(np.ceil(np.sqrt(len(kept) / _PLACES)))
            kept = np.all([line % every == every // 2 for _, line in lines], axis=0)
        else:
            kept = np.arange(len(kept)) % int(np.ceil(len(kept) / _PLACES)) == 0
    found = {**where, "value": field.sampled.values, "stderr": field.stderr}
    return {name: [_short(v) for v in each[kept]] for name, each in found.items()}


def _short(value: float) -> float:
    """To the digits that a map has room for."""
    return float(f"{value:.4g}") + 0.0  # not -0.0


def step_dict(step: Step) -> dict[str, Any]:
    """What was taken, and what it made of the held-out misfit."""
    return {
        "heldout_before": step.before.held_out(),
        "taken": step.name,
        "candidates": [
            {
                "effect": step.name,
                "parameters": len(step.after.keys) - len(step.before.keys),
                "heldout": step.after.held_out(),
            }
        ],
    }


def noise_dict(prepared: Prepared) -> dict[str, Any]:
    """Of one test."""
    return {
        "test": prepared.data.specimen.test.name,
        "sigma_mm": prepared.noise.sigma.tolist(),
        "correlation_length_mm": prepared.noise.correlation_length,
        "effective_points_per_point": 1.0 / prepared.noise.inflation,
        "effective_frames_per_frame": 1.0 / prepared.data.mixture,
        "source": prepared.noise.source,
    }
