"""How large is the gap: in mm, in noise units, on fitted and on held-out data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.objective import displacement_weight
from bulgefit.gap.data import FOLDS, Data
from bulgefit.gap.keys import by_value, has_offsets, names_of, specimen_values
from bulgefit.gap.normal import offsets_of
from bulgefit.gap.regress import Regression
from bulgefit.gap.step import along
from bulgefit.model.sight import Prediction

__all__ = ["Gap", "fitted_gap", "gap_of", "held_out_gap", "noise_gap", "weight_of"]

Floats = NDArray[np.float64]
Gap = dict[str, float]

#: Times that a step is halved which no shape is at the end of.
_HALVINGS = 5


def weight_of(data: Sequence[Data]) -> float:
    """Weight of dz in e_w from the maxima of the tests, as for the fit's objective."""
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
    """Gap on each fold under the fit without it.

    By the derivatives at the optimum. A fit that did not come to it may stand beside a kink or a
    loss of stability, where they hold for less than the step that leaving a fold out takes: there
    it is by what the model predicts at the step's end.
    """
    residuals = []
    for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True)):
        without = _by_derivatives if fit.converged else _by_shapes
        judged = np.full(p.displacement.shape, np.nan)
        for fold, seen in enumerate(without(d, p, fit, index)):
            held = d.blocks.held(fold)
            moved = d.specimen.measured - seen
            if has_offsets(fit.keys, index):
                moved -= offsets_of(moved, d.used & ~held[..., None], d.share)
            judged[held] = moved[held]
        residuals.append(np.where(d.used, judged, np.nan))
    return gap_of(residuals, [d.sigma for d in data], weight)


def _by_derivatives(d: Data, p: Prediction, fit: Regression, index: int) -> Iterator[Floats]:
    """Displacements (frames, points, 3) mm without each fold, to first order."""
    names, places = names_of(fit.keys, index)
    there = d.specimen.predict(specimen_values(fit.values, index), names, p.shapes)
    chain = np.array([by_value(n, p.shapes.values) for n in names])
    for fold in range(FOLDS):
        step = fit.normal.step_without(fold)[places] * chain
        yield p.displacement + np.tensordot(step, there.derivative, 1)


def _by_shapes(d: Data, p: Prediction, fit: Regression, index: int) -> Iterator[Floats]:
    """The same from the shapes at the end of each step, or as far along it as there are any.

    Where there are none a sixteenth of the way along, to first order.
    """
    for fold in range(FOLDS):
        steps = dict(zip(fit.columns, fit.normal.step_without(fold), strict=True))
        for halved in range(_HALVINGS):
            moved = {k: along(k, fit.values[k], s / 2**halved) for k, s in steps.items()}
            values = {**fit.values, **moved}
            try:
                there = d.specimen.predict(specimen_values(values, index), (), p.shapes)
            except (SolveError, InputError):  # as a descent, it goes half as far
                continue
            yield there.displacement
            break
        else:
            yield next(islice(_by_derivatives(d, p, fit, index), fold, None))


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
