"""Least squares over one or several specimens, with what held-out judgement needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.guess import bounds_from, start_box
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI, SHEAR
from bulgefit.gap.keys import columns_of, names_of, parameter_of, specimen_values
from bulgefit.gap.normal import NormalEquations, normal_equations, scales
from bulgefit.gap.step import along, bounded_step
from bulgefit.model.inflation import Shapes
from bulgefit.model.sight import Prediction

__all__ = ["Regression", "regress", "starting_moduli"]

Floats = NDArray[np.float64]

#: Where descents start (MPa): a coated fabric with stiff shear, which is stable everywhere.
_START = dict(zip(MODULI, (320.0, 210.0, 20.0), strict=True))

MAX_ITERATIONS = 16
#: A fit has converged where a step promises less than this sum of squares, and this share of what
#: is left beyond the noise.
_SETTLED, _SETTLED_SHARE = 0.02, 1e-5
#: Damping (Marquardt's, on the scaled normal matrix) after a step that failed, and its growth.
_LEAST_DAMPING, _FIRMER = 1e-3, 6.0


@dataclass(eq=False)
class Regression:
    """A fit of chosen parameters.

    Attributes
    ----------
    keys : tuple of Key
        Freed parameters, and offsets of points.
    values : dict of Key to float
        Of every freed parameter.
    normal : NormalEquations
        r measured minus modelled, by the keys that have derivatives.
    predictions : list of Prediction
        Without derivatives kept; with the offsets.
    offsets : list of (points, 3) array or None
        Where an offset of every point is freed (mm).
    converged : bool
    covariance : (P, P) array
        Of the parameters with derivatives.
    held : bool
        G12 was kept from falling, or did not come to its end: the fit asks for a softer one, by
        which frames lose stability.
    offset_errors : list of (points, 3) array or None
        Standard errors (mm) of the offsets.
    short : float
        Of a fit that did not converge: standard errors by which the combination of parameters that
        is worst off lies away from the optimum that its derivatives promise.
    """

    keys: tuple[Key, ...]
    values: dict[Key, float]
    normal: NormalEquations
    predictions: list[Prediction]
    offsets: list[Floats | None]
    converged: bool
    covariance: Floats
    held: bool = False
    short: float = 0.0
    offset_errors: list[Floats | None] = field(default_factory=list)

    @property
    def columns(self) -> tuple[Key, ...]:
        """Keys that have derivatives."""
        return columns_of(self.keys)

    @property
    def floor(self) -> float:
        """What noise alone leaves of the misfit."""
        return self.normal.noise

    def held_out(self) -> float:
        """The misfit of what is held out; see `NormalEquations.held_out`."""
        return self.normal.held_out()

    def standard_errors(self) -> dict[Key, float]:
        """Of the parameters with derivatives."""
        return dict(zip(self.columns, np.sqrt(np.diag(self.covariance)), strict=True))


@dataclass(frozen=True, eq=False)
class _Point:
    """Parameters, what the model predicts by them, and the normal equations there."""

    values: dict[Key, float]
    predictions: list[Prediction]
    normal: NormalEquations

    @property
    def square(self) -> float:
        """Sum of squared residuals."""
        return self.normal.whole.square


def starting_moduli(data: Sequence[Data]) -> dict[Key, float]:
    """Where descents start (MPa): a coated fabric, but within what the tests' rise says."""
    box = start_box([d.specimen.test for d in data])
    out = {}
    for key, usual in _START.items():
        low, high = box.get(key.name, (usual, usual))
        out[key] = float(np.clip(usual, low, high))
    return out


def regress(
    data: Sequence[Data],
    keys: Sequence[Key],
    start: Mapping[Key, float],
    near: Sequence[Shapes] | None = None,
    iterations: int = MAX_ITERATIONS,
) -> Regression:
    """Least squares by Gauss-Newton steps within the plausible ranges.

    Parameters
    ----------
    data : sequence of Data
    keys : sequence of Key
        Freed parameters; without any, the start is only compared.
    start : mapping
        Values of the freed and of any held parameter.
    near : sequence of Shapes, optional
        Of a neighbouring parameter set.
    iterations : int
        Most steps.

    Raises
    ------
    SolveError
        No equilibrium at the start.
    """
    keys = tuple(keys)
    bounds = _bounds(data, keys)
    values = dict(start)
    for key, (low, high) in zip(keys, bounds, strict=True):
        values[key] = float(np.clip(values[key], low, high))
    predictions = _predict(data, keys, values, near)
    here = _Point(values, predictions, normal_equations(data, predictions, keys))
    converged = not keys
    if keys:
        here, converged = _descended(data, keys, here, bounds, iterations)
    return Regression(
        keys,
        here.values,
        here.normal,
        [Prediction(p.displacement, p.derivative[:0].copy(), p.shapes) for p in here.predictions],
        [None] * len(data),
        converged,
        _inverse(here.normal.whole.hessian),
        _is_held(keys, here.values, bounds, _bounds(data, keys)),
    )


def _inverse(hessian: Floats) -> Floats:
    """Of a normal matrix in any units; none along what the data do not determine."""
    scale = scales(hessian)
    inverse = np.linalg.pinv(hessian * np.outer(scale, scale), rcond=1e-12, hermitian=True)
    return np.asarray(inverse * np.outer(scale, scale))


def _descended(
    data: Sequence[Data], keys: tuple[Key, ...], here: _Point, bounds: Floats, iterations: int
) -> tuple[_Point, bool]:
    """The lowest point found in so many steps, and whether no step promises to lead lower."""
    damping = 0.0
    left: _Point | None = None  # the lowest point, while a step uphill is given one more
    for _ in range(iterations):
        step = bounded_step(here.normal.whole, here.values, keys, bounds, damping)
        expected = here.square - here.normal.whole.at(step)
        beyond_noise = max(here.square - here.normal.noise, 0.0)
        if left is None and expected <= _SETTLED + _SETTLED_SHARE * beyond_noise:
            return here, True
        there = _stepped(data, keys, here, step)
        lowest = left or here
        softer = dict(zip(keys, step, strict=True)).get(SHEAR, 0.0) < 0.0
        lost = there is not None and _destabilised(lowest.predictions, there.predictions)
        if there is not None and there.square < lowest.square and not lost:
            if left is None and here.square - there.square > 0.5 * expected:
                damping = _relaxed(damping)
            here, left = there, None
        elif there is not None and left is None and damping == 0.0 and not (lost and softer):
            # a full step across a bend of a narrow valley leads uphill, the next one down again
            # (the watchdog technique of Chamberlain et al., 1982); one away from soft shear may
            # meet instability on its way
            here, left = there, here
        else:
            if lost:
                _hold_shear(bounds, keys, lowest.values)
            here, left = lowest, None
            damping = max(_FIRMER * damping, _LEAST_DAMPING)
            if damping > 1e4:
                break
    return left or here, False


def _stepped(
    data: Sequence[Data], keys: tuple[Key, ...], here: _Point, step: Floats
) -> _Point | None:
    """The point a step ahead; None where nothing balances there."""
    moved = {k: along(k, here.values[k], s) for k, s in zip(keys, step, strict=True)}
    values = {**here.values, **moved}
    try:
        there = _predict(data, keys, values, [p.shapes for p in here.predictions])
    except (SolveError, InputError):
        return None
    return _Point(values, there, normal_equations(data, there, keys))


def _relaxed(damping: float) -> float:
    return damping / _FIRMER if damping > _LEAST_DAMPING else 0.0


def _bounds(data: Sequence[Data], keys: Sequence[Key]) -> Floats:
    """Plausible ranges (keys, 2): what is woven has, and what the tests' rise says they may have.

    An elastomer is softer, and a film of aramid stiffer, than what is woven.
    """
    implied = bounds_from([d.specimen.test for d in data])
    out = []
    for key in keys:
        parameter = parameter_of(key)
        low, high = implied.get(key.name, (parameter.lower, parameter.upper))
        out.append((min(low, parameter.lower), max(high, parameter.upper)))
    return np.array(out).reshape(-1, 2)


def _hold_shear(bounds: Floats, keys: Sequence[Key], values: Mapping[Key, float]) -> None:
    """Let G12 fall no further: soft shear is what stability is lost by."""
    if SHEAR in keys:
        bounds[keys.index(SHEAR), 0] = values[SHEAR]


def _is_held(
    keys: Sequence[Key], values: Mapping[Key, float], bounds: Floats, plausible: Floats
) -> bool:
    """Whether G12 ended where it was held, above the least that is plausible."""
    if SHEAR not in keys:
        return False
    lowest, least = (of[keys.index(SHEAR), 0] for of in (bounds, plausible))
    return bool(lowest > least and values[SHEAR] <= lowest * (1.0 + 1e-9))


def _destabilised(before: Sequence[Prediction], after: Sequence[Prediction]) -> bool:
    """Whether frames lost stability: beyond it, fields are as wild as the mesh allows."""
    return any(
        (b.shapes.stable & ~a.shapes.stable).any() for b, a in zip(before, after, strict=True)
    )


def _predict(
    data: Sequence[Data],
    keys: Sequence[Key],
    values: Mapping[Key, float],
    near: Sequence[Shapes] | None,
) -> list[Prediction]:
    out = []
    for index, d in enumerate(data):
        names, _ = names_of(keys, index)
        out.append(
            d.specimen.predict(
                specimen_values(values, index), names, None if near is None else near[index]
            )
        )
    return out
