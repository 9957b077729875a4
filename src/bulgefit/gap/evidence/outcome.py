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
from bulgefit.gap.evidence.laplace import inverted
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.keys import by_value, has_offsets, names_of, offsets_of_points
from bulgefit.gap.normal import NormalEquations, Quadratic, normal_equations, offsets_of
from bulgefit.gap.regress import Regression
from bulgefit.model.sight import Prediction

__all__ = ["Seen", "posterior", "regression_of", "seen_by"]

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
    for index, (d, shapes) in enumerate(zip(weighing.data, fit.here.near, strict=True)):
        prediction = d.specimen.observe(shapes)
        creased = has_offsets(free, index)
        seen.append(_slim(prediction, _offset(d, prediction) if creased else None))
    return Seen((*keys, *free), seen)


def _keys(weighing: Weighing, fit: Fit) -> tuple[tuple[Key, ...], tuple[Key, ...]]:
    """Of a fit's coordinates, and of the offsets beside them, of specimens that have any."""
    every, creases = weighing.coordinates.every, weighing.offsets
    free: tuple[Key, ...] = ()
    if creases is not None:
        pairs = zip(offsets_of_points(len(creases)), creases, strict=True)
        free = tuple(key for key, own in pairs if own.sizes.any())
    return tuple(every[c].key for c in fit.here.columns), free


def posterior(weighing: Weighing, fit: Fit) -> Floats:
    """Covariance (p, p) of a fit's coordinates, a misfit counted in all directions.

    What errs may move the values of what does not beyond what a covariance of its own says: beside
    noise and offsets alone, variances are `Weighing.excess` times as large.
    """
    if weighing.misfits is None:
        return fit.covariance
    bare = Weighing(weighing.data, weighing.coordinates, weighing.offsets)
    columns = fit.here.columns
    hessian = bare.linearise(fit.x, columns, fit.here.near).hessian / weighing.excess
    width = np.array([weighing.coordinates.every[c].width for c in columns])
    covariance, _ = inverted(hessian + np.diag(width**-2))
    return covariance


def regression_of(weighing: Weighing, fit: Fit, covariance: Floats | None = None) -> Regression:
    """The regression that ended at a fit.

    A fold that is held out is met with what the others and the priors say.

    Parameters
    ----------
    weighing : Weighing
    fit : Fit
    covariance : (p, p) array, optional
        Of its coordinates, if not as it says (`posterior`).
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
    known += _heights(weighing.data, predictions, keys, free)
    stretch = np.array([_by_coordinate(c, x) for c, x in zip(chosen, fit.x[columns], strict=True)])
    covariance = fit.covariance if covariance is None else covariance
    covariance = covariance * np.outer(stretch, stretch)
    offsets: list[Floats | None] = [None] * len(predictions)
    errors: list[Floats | None] = [None] * len(predictions)
    for index, (d, p) in enumerate(zip(weighing.data, predictions, strict=True)):
        if has_offsets(free, index):
            offsets[index] = _offset(d, p)
            errors[index] = _offset_error(d, p, *names_of(keys, index), covariance)
    return Regression(
        (*keys, *free),
        values,
        _with(normal, known),
        [_slim(p, o) for p, o in zip(predictions, offsets, strict=True)],
        offsets,
        fit.converged,
        covariance,
        short=fit.short,
        offset_errors=errors,
    )


def _offset(data: Data, prediction: Prediction) -> Floats:
    """Of every point (n, 3), mm: the mean of its residual."""
    residual = data.specimen.measured - prediction.displacement
    return offsets_of(residual, data.used, data.share)


def _offset_error(
    data: Data, prediction: Prediction, names: list[str], places: list[int], covariance: Floats
) -> Floats:
    """Standard error (n, 3), mm, of `_offset`: of the noise's mean, and of the parameters."""
    values, used, trust = prediction.shapes.values, data.used, data.share
    number = np.tensordot(trust**2, used, 1)
    variance = data.sigma**2 * data.of_frames_mean(np.where(number > 0.0, number, 1.0))
    slopes = [
        offsets_of(by_value(name, values) * derivative, used, trust)
        for name, derivative in zip(names, prediction.derivative, strict=True)
    ]
    own = covariance[np.ix_(places, places)]
    variance += np.einsum("inc,ij,jnc->nc", slopes, own, slopes, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _slim(prediction: Prediction, offset: Floats | None) -> Prediction:
    seen = prediction.displacement if offset is None else prediction.displacement + offset
    # a view would keep the derivatives, hundreds of megabytes where fields are free
    return Prediction(seen, prediction.derivative[:0].copy(), prediction.shapes)


def _prior(chosen: list[Coordinate], x: Floats, excess: float) -> Floats:
    """[J r]ᵀ[J r] of the priors as data: one value each, the null, by the parameters' values."""
    matrix = np.zeros((len(chosen) + 1, len(chosen) + 1))
    for place, (coordinate, at) in enumerate(zip(chosen, x, strict=True)):
        by_value = 1.0 / _by_coordinate(coordinate, at)
        away = 0.0 if coordinate.parameter.period else coordinate.null - at  # `Layout.away`
        row = np.sqrt(excess) / coordinate.width * np.array([by_value, away])
        here = np.ix_([place, len(chosen)], [place, len(chosen)])
        matrix[here] += np.outer(row, row)
    return matrix


def _by_coordinate(coordinate: Coordinate, x: float) -> float:
    """∂(a parameter)/∂(its coordinate)."""
    value = coordinate.value(x)
    return coordinate.parameter.slope(value) / coordinate.parameter.by_value(value)


def _heights(
    data: Sequence[Data],
    predictions: Sequence[Prediction],
    keys: Sequence[Key],
    free: Sequence[Key],
) -> Floats:
    """[J r]ᵀ[J r] of heights before inflation; offsets of the points would take up most of them."""
    matrix = np.zeros((len(keys) + 1, len(keys) + 1))
    for index, (d, p) in enumerate(zip(data, predictions, strict=True)):
        if d.heights is not None and not has_offsets(free, index):
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
