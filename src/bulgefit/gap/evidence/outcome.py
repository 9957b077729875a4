"""A weighed model as a regression: values, errors, held-out misfit; its priors are data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinate
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.heights import height_rows, off_planes, plane_rows
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.keys import by_value, names_of, offsets_of_points
from bulgefit.gap.normal import NormalEquations, Quadratic, normal_equations, offsets_of
from bulgefit.gap.regress import Regression
from bulgefit.model.virtual_test import Prediction

__all__ = ["Seen", "regression_of", "seen_by"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Seen:
    """What a fit predicts, without the derivatives that a regression is told by.

    Attributes
    ----------
    keys : tuple of Key
        Freed parameters, and offsets of points.
    predictions : list of Prediction
        With the offsets.
    """

    keys: tuple[Key, ...]
    predictions: list[Prediction]


def seen_by(weighing: Weighing, fit: Fit) -> Seen:
    """What a fit predicts of each specimen: all that is asked of most of them."""
    keys, free = _keys(weighing, fit)
    seen = []
    for d, shapes in zip(weighing.data, fit.here.near, strict=True):
        prediction = d.specimen.observe(shapes)
        seen.append(_slim(prediction, _offset(d, prediction) if free else None))
    return Seen((*keys, *free), seen)


def _keys(weighing: Weighing, fit: Fit) -> tuple[tuple[Key, ...], tuple[Key, ...]]:
    """Of a fit's coordinates, and of the offsets beside them."""
    every = weighing.coordinates.every
    free = () if weighing.offsets is None else offsets_of_points(len(weighing.data))
    return tuple(every[c].key for c in fit.here.columns), free


def regression_of(weighing: Weighing, fit: Fit) -> Regression:
    """The regression that ended at a fit.

    Standard errors are the posterior's, of a misfit beside the noise too. A fold that is held out
    is met with what the others and the priors say.
    """
    every, columns = weighing.coordinates.every, fit.here.columns
    chosen = [every[c] for c in columns]
    keys, free = _keys(weighing, fit)
    predictions = []
    for index, (d, shapes) in enumerate(zip(weighing.data, fit.here.near, strict=True)):
        names = [every[c].key.name for c in weighing.coordinates.of_specimen(columns, index)]
        predictions.append(d.specimen.observe(shapes, names))
    normal = normal_equations(weighing.data, predictions, (*keys, *free))
    values = {k: c.value(x) for k, c, x in zip(keys, chosen, fit.x[columns], strict=True)}
    known = _prior(chosen, fit.x[columns], weighing.excess)
    if not free:
        known += _heights(weighing.data, predictions, keys)
    offsets = [
        _offset(d, p) if free else None for d, p in zip(weighing.data, predictions, strict=True)
    ]
    return Regression(
        (*keys, *free),
        values,
        _with(normal, known),
        [_slim(p, o) for p, o in zip(predictions, offsets, strict=True)],
        offsets,
        fit.converged,
        excess=weighing.excess,
    )


def _offset(data: Data, prediction: Prediction) -> Floats:
    """Of every point (n, 3), mm: the mean of its residual."""
    residual = data.specimen.measured - prediction.displacement
    return offsets_of(residual, data.used, data.share)


def _slim(prediction: Prediction, offset: Floats | None) -> Prediction:
    seen = prediction.displacement if offset is None else prediction.displacement + offset
    # a view would keep the derivatives, hundreds of megabytes where fields are free
    return Prediction(seen, prediction.derivative[:0].copy(), prediction.shapes)


def _prior(chosen: list[Coordinate], x: Floats, excess: float) -> Floats:
    """[J r]ᵀ[J r] of the priors as data: one value each, the null, by the parameters' values."""
    matrix = np.zeros((len(chosen) + 1, len(chosen) + 1))
    for place, (coordinate, at) in enumerate(zip(chosen, x, strict=True)):
        value = coordinate.value(at)
        by_value = coordinate.parameter.by_value(value) / coordinate.parameter.slope(value)
        row = np.sqrt(excess) / coordinate.width * np.array([by_value, coordinate.null - at])
        here = np.ix_([place, len(chosen)], [place, len(chosen)])
        matrix[here] += np.outer(row, row)
    return matrix


def _heights(
    data: Sequence[Data], predictions: Sequence[Prediction], keys: Sequence[Key]
) -> Floats:
    """[J r]ᵀ[J r] of heights before inflation; offsets of the points would take up most of them."""
    matrix = np.zeros((len(keys) + 1, len(keys) + 1))
    for index, (d, p) in enumerate(zip(data, predictions, strict=True)):
        if d.heights is not None:
            names, places = names_of(keys, index)
            values = p.shapes.values
            rows = off_planes(height_rows(d, values, names), plane_rows(d))
            rows *= np.append([by_value(name, values) for name in names], 1.0)[:, None]
            here = np.ix_([*places, len(keys)], [*places, len(keys)])
            matrix[here] += rows @ rows.T / d.inflation
    return matrix


def _with(normal: NormalEquations, known: Floats) -> NormalEquations:
    """Normal equations with priors, and heights, that are known whatever is held out."""
    return NormalEquations(
        Quadratic(normal.whole.matrix + known),
        tuple(Quadratic(q.matrix + known) for q in normal.kept),
        normal.held,
        normal.noise,
    )
