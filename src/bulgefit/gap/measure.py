"""How large is the gap: in mm, in noise units, on fitted and on held-out data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.regress import (
    FOLDS,
    Data,
    Regression,
    chain_factor,
    names_of,
    specimen_values,
)

__all__ = ["Gap", "fitted_gap", "gap_of", "held_out_gap", "noise_gap", "weight_of"]

Floats = NDArray[np.float64]
Gap = dict[str, float]


def weight_of(data: Sequence[Data]) -> float:
    """Weight of dz in e_w from the maxima of the tests, as for the fit's objective."""
    from bulgefit.inverse.objective import displacement_weight

    return displacement_weight([d.specimen.test for d in data])


def gap_of(residuals: Sequence[Floats], sigmas: Sequence[Floats], weight: float) -> Gap:
    """Mean absolute residual per component, e, e_w (mm; mean over tests) and chi."""
    means = np.mean([np.nanmean(np.abs(r).reshape(-1, 3), axis=0) for r in residuals], axis=0)
    squares = [np.nanmean((r / s) ** 2) for r, s in zip(residuals, sigmas, strict=True)]
    dx, dy, dz = (float(m) for m in means)
    return {
        "e": dx + dy + dz,
        "e_w": dx + dy + weight * dz,
        "dx": dx,
        "dy": dy,
        "dz": dz,
        "chi": float(np.sqrt(np.mean(squares))),
    }


def _residuals(data: Sequence[Data], fit: Regression) -> list[Floats]:
    return [
        np.where(d.used, d.specimen.measured - p.displacement, np.nan)
        for d, p in zip(data, fit.predictions, strict=True)
    ]


def fitted_gap(data: Sequence[Data], fit: Regression, weight: float) -> Gap:
    """Gap on the data that were fitted."""
    return gap_of(_residuals(data, fit), [d.sigma for d in data], weight)


def held_out_gap(data: Sequence[Data], fit: Regression, weight: float) -> Gap:
    """Gap on each fold under the fit without it."""
    residuals = _residuals(data, fit)
    for index, (d, p, r) in enumerate(zip(data, fit.predictions, residuals, strict=True)):
        names, places = names_of(fit.keys, index, len(data) > 1)
        derivative = d.specimen.predict(
            specimen_values(fit.values, index), names, p.shapes
        ).derivative
        chain = np.array([chain_factor(n, p.shapes.values) for n in names])
        for fold in range(FOLDS):
            everywhere = _fold_of_all(data, fold)
            step = fit.step_without(everywhere)[places] * chain
            own = d.blocks.folds()[fold]
            inside = np.isin(d.blocks.cell, own)
            r[inside] -= np.tensordot(step, derivative[:, inside], 1)
    return gap_of(residuals, [d.sigma for d in data], weight)


def _fold_of_all(data: Sequence[Data], fold: int) -> NDArray[np.int64]:
    first, out = 0, []
    for d in data:
        out.append(d.blocks.folds()[fold] + first)
        first += d.blocks.count
    return np.concatenate(out)


def noise_gap(data: Sequence[Data], weight: float) -> Gap:
    """What Gaussian noise alone leaves."""
    mean = np.sqrt(2.0 / np.pi) * np.mean([d.sigma for d in data], axis=0)
    dx, dy, dz = (float(m) for m in mean)
    return {
        "e": dx + dy + dz,
        "e_w": dx + dy + weight * dz,
        "dx": dx,
        "dy": dy,
        "dz": dz,
        "chi": 1.0,
    }
