"""Least squares over one or several specimens, with what held-out judgement needs.

Residuals are in units of the noise: (measured - modelled)/sigma of the component. Every fit keeps
its normal equations cell by cell (blocks of frames times sectors), so leaving cells out costs no
further solve: near the optimum the model is linear, and one step on the remaining cells is the
refit without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.optimize import lsq_linear

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.model.specimen import Prediction, Shapes, Specimen

__all__ = ["Blocks", "Data", "Regression", "chain_factor", "regress"]

Floats = NDArray[np.float64]

FRAME_BLOCKS, SECTORS, FOLDS = 4, 6, 4
_MODULUS_BOUNDS = {"E1": (20.0, 3000.0), "E2": (20.0, 3000.0), "G12": (0.5, 1000.0)}
MAX_ITERATIONS = 16
#: A fit has converged where a step promises less than this sum of squares, and this share of what
#: is left beyond the noise.
_SETTLED, _SETTLED_SHARE = 0.02, 1e-5
#: Damping (Marquardt's, on the scaled normal matrix) after a step that failed, and its growth.
_LEAST_DAMPING, _FIRMER = 1e-3, 6.0


@dataclass(frozen=True, eq=False)
class Blocks:
    """Cell (frame block times sector) of each frame and point, and the fold that it is held in."""

    cell: NDArray[np.int64]
    count: int

    @classmethod
    def of(cls, reference: Floats, pressure: Floats) -> Blocks:
        """Contiguous blocks of pressure times sectors."""
        rank = np.argsort(np.argsort(pressure))
        block = rank * FRAME_BLOCKS // max(len(pressure), 1)
        angle = np.arctan2(reference[:, 1], reference[:, 0]) + np.pi
        sector = np.minimum((angle * SECTORS / (2 * np.pi)).astype(int), SECTORS - 1)
        return cls(block[:, None] * SECTORS + sector[None, :], FRAME_BLOCKS * SECTORS)

    def folds(self) -> list[NDArray[np.int64]]:
        """Cells held out together: a diagonal pattern, so each fold has all blocks and sectors."""
        cells = np.arange(self.count)
        block, sector = cells // SECTORS, cells % SECTORS
        return [cells[(block + sector) % FOLDS == k] for k in range(FOLDS)]


@dataclass(eq=False)
class Data:
    """A specimen with its noise and cells.

    Attributes
    ----------
    specimen : Specimen
    sigma : (3,) array, mm
    used : (frames, points, 3) bool array
        Measured, and not an outlier.
    inflation : float
        Factor on variances of means: noise that is correlated in space counts less.
    persistent : float
        Share of the noise's variance that is the same in every frame.
    """

    specimen: Specimen
    sigma: Floats
    used: NDArray[np.bool_]
    inflation: float = 1.0
    persistent: float = 0.0
    blocks: Blocks = field(init=False)

    def __post_init__(self) -> None:
        self.blocks = Blocks.of(self.specimen.reference, self.specimen.recorded)

    def residual(self, prediction: Prediction) -> Floats:
        """(measured - modelled)/sigma, 0 where unused: (frames, points, 3)."""
        difference = (self.specimen.measured - prediction.displacement) / self.sigma
        return np.where(self.used, difference, 0.0)


@dataclass(eq=False)
class Regression:
    """A fit of chosen parameters.

    Attributes
    ----------
    keys : tuple of str
        Freed parameters; `name@i` is specimen i's own.
    values : dict
        Of every freed parameter.
    hessian : (cells, P, P) array
    gradient : (cells, P) array
        JᵀJ and Jᵀr of each cell, r measured minus modelled in noise units.
    square : (cells,) array
        Sum of squared residuals of each cell.
    count : (cells,) array
        Values in each cell.
    predictions : list of Prediction
        Without derivatives kept.
    inflation : float
    converged : bool
    """

    keys: tuple[str, ...]
    values: dict[str, float]
    hessian: Floats
    gradient: Floats
    square: Floats
    count: NDArray[np.int64]
    predictions: list[Prediction]
    inflation: float
    converged: bool

    @property
    def chi_square(self) -> float:
        """Sum of squared residuals over the noise."""
        return float(self.square.sum())

    def covariance(self) -> Floats:
        """Of the freed parameters, correlated noise included, (P, P)."""
        scale = _scales(self.hessian.sum(axis=0))
        h = self.hessian.sum(axis=0) * np.outer(scale, scale)
        inverse = np.linalg.pinv(h, rcond=1e-12, hermitian=True)
        return self.inflation * inverse * np.outer(scale, scale)

    def standard_errors(self) -> dict[str, float]:
        """Of the freed parameters."""
        return dict(zip(self.keys, np.sqrt(np.diag(self.covariance())), strict=True))

    def held_out(self, folds: Sequence[NDArray[np.int64]], *, realised: bool = True) -> float:
        """Sum of squared residuals of each fold under the fit without it.

        A fit that stopped short of its optimum, or at a bound, is judged where it stands: only
        what leaving the fold out changes is added. A forecast (`realised` false) is judged where
        the linear step would take it.
        """
        return sum(self._held_out_of(fold, realised) for fold in folds)

    def _held_out_of(self, fold: NDArray[np.int64], realised: bool) -> float:
        step = self.step_without(fold) if realised else self._step(self._others(fold))
        h, g = self.hessian[fold].sum(axis=0), self.gradient[fold].sum(axis=0)
        return float(self.square[fold].sum() - 2 * step @ g + step @ h @ step)

    def step_without(self, fold: NDArray[np.int64]) -> Floats:
        """Change of the parameters when a fold is left out."""
        return self._step(self._others(fold)) - self._step(np.ones(len(self.square), dtype=bool))

    def _others(self, fold: NDArray[np.int64]) -> NDArray[np.bool_]:
        kept = np.ones(len(self.square), dtype=bool)
        kept[fold] = False
        return kept

    def _step(self, kept: NDArray[np.bool_]) -> Floats:
        """Linear step to the optimum of some cells."""
        h = self.hessian[kept].sum(axis=0)
        scale = _scales(h)
        return scale * (
            np.linalg.pinv(h * np.outer(scale, scale), rcond=1e-10, hermitian=True)
            @ (self.gradient[kept].sum(axis=0) * scale)
        )


def _scales(h: Floats) -> Floats:
    return 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))


def own_key(name: str, index: int, several: bool) -> str:
    """The regression's name of a model parameter of specimen `index`."""
    effect = name.partition(".")[0]
    shared = name in MODULI or CATALOGUE[effect].shared
    return f"{name}@{index}" if several and not shared else name


def bounds_of(key: str) -> tuple[float, float]:
    """Plausible range of a freed parameter."""
    name = key.partition("@")[0]
    if name in _MODULUS_BOUNDS:
        return _MODULUS_BOUNDS[name]
    effect, _, parameter = name.partition(".")
    (found,) = (p for p in CATALOGUE[effect].parameters if p.name == parameter)
    return found.lower, found.upper


def start_of(key: str, data: Sequence[Data]) -> float:
    """Where a fit of a freed parameter starts."""
    name, _, owner = key.partition("@")
    if name == "poisson_ratio.nu12":
        return data[int(owner) if owner else 0].specimen.test.poisson_ratio
    effect, _, parameter = name.partition(".")
    (found,) = (p for p in CATALOGUE[effect].parameters if p.name == parameter)
    return found.start


def null_of(key: str, data: Sequence[Data]) -> float:
    """The value at which a parameter's effect is absent."""
    name, _, owner = key.partition("@")
    return data[int(owner) if owner else 0].specimen.nulls().get(name, 0.0)


def names_of(keys: Sequence[str], index: int, several: bool) -> tuple[list[str], list[int]]:
    """Model parameters of specimen `index` among the keys, and their places."""
    names, places = [], []
    for place, key in enumerate(keys):
        name, _, owner = key.partition("@")
        if not owner or int(owner) == index:
            names.append(name)
            places.append(place)
    return names, places


def normal_equations(
    data: Sequence[Data], predictions: Sequence[Prediction], keys: Sequence[str]
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Cell by cell: JᵀJ, Jᵀr, rᵀr and counts, specimens one after the other."""
    size = len(keys)
    parts = []
    for index, (d, p) in enumerate(zip(data, predictions, strict=True)):
        _, places = names_of(keys, index, len(data) > 1)
        residual = d.residual(p)
        scaled = np.where(d.used, p.derivative / d.sigma, 0.0)
        for slope, key in zip(scaled, (keys[i] for i in places), strict=True):
            slope *= chain_factor(key, p.shapes.values)
        count = d.blocks.count
        h, g = np.zeros((count, size, size)), np.zeros((count, size))
        square, n = np.zeros(count), np.zeros(count, dtype=np.int64)
        for cell in range(count):
            inside = d.blocks.cell == cell
            rows = scaled[:, inside].reshape(len(places), 3 * int(inside.sum()))
            r = residual[inside].ravel()
            h[cell][np.ix_(places, places)] = rows @ rows.T
            g[cell, places] = rows @ r
            square[cell], n[cell] = r @ r, int(d.used[inside].sum())
        parts.append((h, g, square, n))
    hs, gs, squares, ns = (np.concatenate(group) for group in zip(*parts, strict=True))
    return hs, gs, squares, ns


def chain_factor(key: str, values: Mapping[str, float]) -> float:
    """∂(what the model differentiates by)/∂(the parameter): the window enters as its square."""
    if key.startswith("dic_smoothing.window"):
        return 2.0 * max(values.get("dic_smoothing.window", 0.0), 0.5)
    return 1.0


def regress(
    data: Sequence[Data],
    keys: Sequence[str],
    start: Mapping[str, float],
    near: Sequence[Shapes] | None = None,
    iterations: int = MAX_ITERATIONS,
    known: Sequence[Prediction] | None = None,
) -> Regression:
    """Least squares by Gauss-Newton steps within the plausible ranges.

    Parameters
    ----------
    data : sequence of Data
    keys : sequence of str
        Freed parameters; without any, the start is only compared.
    start : mapping
        Values of the freed and of any held parameter.
    near : sequence of Shapes, optional
        Of a neighbouring parameter set.
    iterations : int
        Most steps.
    known : sequence of Prediction, optional
        At the start, with derivatives by `keys`, where they are known already.

    Raises
    ------
    SolveError
        No equilibrium at the start.
    """
    keys = tuple(keys)
    bounds = np.array([bounds_of(key) for key in keys])
    values = dict(start)
    for key, (low, high) in zip(keys, bounds, strict=True):
        values[key] = float(np.clip(values[key], low, high))
    predictions = list(known) if known is not None else _predict(data, keys, values, near)
    current = normal_equations(data, predictions, keys)
    converged, damping = not keys, 0.0
    for _ in range(iterations if keys else 0):
        step = _bounded_step(current, values, keys, bounds, damping)
        trial = {**values, **{k: values[k] + s for k, s in zip(keys, step, strict=True)}}
        expected = float(2 * step @ current[1].sum(axis=0) - step @ current[0].sum(axis=0) @ step)
        beyond_noise = max(float(current[2].sum() - current[3].sum()), 0.0)
        if expected <= _SETTLED + _SETTLED_SHARE * beyond_noise:
            converged = True
            break
        gained = -np.inf
        try:
            there = _predict(data, keys, trial, [p.shapes for p in predictions])
            if _destabilised(predictions, there):
                _hold_shear(bounds, keys, values)
            else:
                new = normal_equations(data, there, keys)
                gained = float(current[2].sum() - new[2].sum())
        except (SolveError, InputError):
            pass  # no equilibrium there: a shorter step
        if gained > 0.0:
            values, predictions, current = trial, there, new
            damping = _relaxed(damping) if gained > 0.5 * expected else damping
        else:
            damping = max(_FIRMER * damping, _LEAST_DAMPING)
            if damping > 1e4:
                break
    slim = [Prediction(p.displacement, p.derivative[:0], p.shapes) for p in predictions]
    return Regression(
        keys, values, *current, slim, float(np.mean([d.inflation for d in data])), converged
    )


def _relaxed(damping: float) -> float:
    return damping / _FIRMER if damping > _LEAST_DAMPING else 0.0


def _hold_shear(bounds: Floats, keys: Sequence[str], values: Mapping[str, float]) -> None:
    """Let G12 fall no further: soft shear is what stability is lost by."""
    if "G12" in keys:
        bounds[keys.index("G12"), 0] = values["G12"]


def _destabilised(before: Sequence[Prediction], after: Sequence[Prediction]) -> bool:
    """Whether frames lost stability: beyond it, fields are as wild as the mesh allows."""
    return any(
        (b.shapes.stable & ~a.shapes.stable).any() for b, a in zip(before, after, strict=True)
    )


def _predict(
    data: Sequence[Data],
    keys: Sequence[str],
    values: Mapping[str, float],
    near: Sequence[Shapes] | None,
) -> list[Prediction]:
    out = []
    for index, d in enumerate(data):
        names, _ = names_of(keys, index, len(data) > 1)
        out.append(
            d.specimen.predict(
                specimen_values(values, index), names, None if near is None else near[index]
            )
        )
    return out


def specimen_values(values: Mapping[str, float], index: int) -> dict[str, float]:
    """Model parameters of one specimen."""
    out = {}
    for key, value in values.items():
        name, _, owner = key.partition("@")
        if not owner or int(owner) == index:
            out[name] = value
    return out


def _bounded_step(
    current: tuple[Floats, Floats, Floats, NDArray[np.int64]],
    values: Mapping[str, float],
    keys: Sequence[str],
    bounds: Floats,
    damping: float,
) -> Floats:
    """Damped Gauss-Newton step that stays in the bounds; a modulus changes by half at most."""
    h, g = current[0].sum(axis=0), current[1].sum(axis=0)
    here = np.array([values[key] for key in keys])
    low, high = bounds[:, 0] - here, bounds[:, 1] - here
    moduli = np.array([key in MODULI for key in keys])
    low = np.where(moduli, np.maximum(low, -0.4 * here), low)
    high = np.where(moduli, np.minimum(high, 0.6 * here), high)
    low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    scale = _scales(h)
    scaled = h * np.outer(scale, scale)
    scaled += (damping + 1e-9) * np.eye(len(keys))
    root = np.linalg.cholesky(scaled)
    free = scale * cho_solve((root, True), g * scale)
    if ((free >= low) & (free <= high)).all():
        return free
    found = lsq_linear(
        root.T,
        np.linalg.solve(root, g * scale),
        bounds=(low / scale, high / scale),
        method="bvls" if len(keys) < 40 else "trf",
    )
    return np.clip(found.x * scale, low, high)
