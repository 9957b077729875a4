"""Normal equations, whole and with each fold held out.

Near the optimum the model is linear, so leaving data out costs no further solve: one step on the
remaining data is the refit without them, and its sum of squares on what was left out is a quadratic
form as well.

An offset of every point (`OFFSETS`) is no column. With the trust t in each frame its best value,
for given parameters, is Σt²r/Σt² over the point's frames, and that is taken off residuals and
derivatives alike (variable projection; Golub and Pereyra, 1973). A fold that holds frames of a
point out takes the offset from the point's other frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import FOLDS, FRAME_BLOCKS, Data
from bulgefit.gap.keys import by_value, columns_of, has_offsets, names_of
from bulgefit.model.sight import Prediction

__all__ = ["NormalEquations", "Quadratic", "normal_equations", "offsets_of", "scales"]

Floats = NDArray[np.float64]

#: Share of a column's square below which offsets of the points are all there is to it.
CONTAINED = 1e-10


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Sum of squared residuals of a linear model, |r - J s|², as a function of the step s.

    Attributes
    ----------
    matrix : (P + 1, P + 1) array
        [J r]ᵀ[J r], residuals and derivatives over the noise: |r|² is -2 ln of the likelihood.
    """

    matrix: Floats

    @property
    def hessian(self) -> Floats:
        """JᵀJ, (P, P)."""
        return self.matrix[:-1, :-1]

    @property
    def gradient(self) -> Floats:
        """Jᵀr, (P,)."""
        return self.matrix[:-1, -1]

    @property
    def square(self) -> float:
        """rᵀr."""
        return float(self.matrix[-1, -1])

    def at(self, step: Floats) -> float:
        """Sum of squares after a step."""
        return float(self.square - 2 * step @ self.gradient + step @ self.hessian @ step)

    def step(self) -> Floats:
        """To the optimum; along what the data do not determine, none."""
        scale = scales(self.hessian)
        scaled = self.hessian * np.outer(scale, scale)
        return scale * (
            np.linalg.pinv(scaled, rcond=1e-10, hermitian=True) @ (self.gradient * scale)
        )


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Of all data, and of the data kept and held out in each fold.

    Attributes
    ----------
    whole : Quadratic
    kept, held : tuple of Quadratic
        One for each fold.
    noise : float
        What noise alone leaves of the sum of squares: values, as many as are independent.
    """

    whole: Quadratic
    kept: tuple[Quadratic, ...]
    held: tuple[Quadratic, ...]
    noise: float

    def step_without(self, fold: int) -> Floats:
        """Change of the optimum when a fold is left out."""
        return self.kept[fold].step() - self.whole.step()

    def held_out(self) -> float:
        """Sum of squared residuals of each fold under the fit without it.

        A fit that stopped short of its optimum, or at a bound, is judged where it stands: only
        what leaving the fold out changes is added.
        """
        return sum(held.at(self.step_without(k)) for k, held in enumerate(self.held))


def scales(h: Floats) -> Floats:
    """Of the parameters: one over the root of the diagonal, 0 for those without effect."""
    root = np.sqrt(np.maximum(np.diag(h), 0.0))
    return np.divide(1.0, root, out=np.zeros_like(root), where=root > 1e-150)


def normal_equations(
    data: Sequence[Data], predictions: Sequence[Prediction], keys: Sequence[Key]
) -> NormalEquations:
    """Of all specimens by the freed keys; predictions have derivatives by the specimen's own.

    Each specimen counts by its own noise, correlation included (`Data.inflation`).
    """
    size = len(columns_of(keys)) + 1
    whole = np.zeros((size, size))
    kept, held = np.zeros((FOLDS, size, size)), np.zeros((FOLDS, size, size))
    for index, (d, p) in enumerate(zip(data, predictions, strict=True)):
        names, places = names_of(keys, index)
        weight = d.weight
        rows = np.empty((len(names) + 1, *weight.shape))
        for row, name, derivative in zip(rows[:-1], names, p.derivative, strict=True):
            np.multiply(derivative, by_value(name, p.shapes.values) * weight, out=row)
        rows[-1] = d.residual(p)
        here = np.ix_([*places, size - 1], [*places, size - 1])
        parts = _projected(d, rows) if has_offsets(keys, index) else _plain(d, rows)
        whole[here] += parts[0] / d.inflation
        for fold in range(FOLDS):
            kept[fold][here] += parts[1][fold] / d.inflation
            held[fold][here] += parts[2][fold] / d.inflation
    return NormalEquations(
        Quadratic(whole),
        tuple(Quadratic(m) for m in kept),
        tuple(Quadratic(m) for m in held),
        sum(float(d.used.sum()) / d.inflation for d in data),
    )


_Parts = tuple[Floats, Floats, Floats]


def _plain(data: Data, rows: Floats) -> _Parts:
    """Gram matrices of all rows, and of those kept and held in each fold."""
    held = np.empty((FOLDS, len(rows), len(rows)))
    flat = rows.reshape(len(rows), -1)
    for fold in range(FOLDS):
        values = np.flatnonzero(np.repeat(data.blocks.held(fold), rows.shape[-1]))
        upper = dsyrk(1.0, flat.take(values, axis=1).T, trans=1)
        held[fold] = upper + np.triu(upper, 1).T
    whole = held.sum(axis=0)
    return whole, whole - held, held


def _projected(data: Data, rows: Floats) -> _Parts:
    """The same with each point's offset over its kept frames taken off.

    With sums S of t times the rows and n of t² over the kept frames of a point, the kept rows lose
    SSᵀ/n; the held rows, with sums T and m, lose TSᵀ/n + STᵀ/n - m SSᵀ/n².
    """
    whole, kept, held = _plain(data, rows)
    blocks = data.blocks
    chosen = [blocks.block == block for block in range(FRAME_BLOCKS)]
    trust = data.share
    sums = np.stack([np.tensordot(trust[f], rows[:, f], (0, 1)) for f in chosen])
    counts = np.stack([np.tensordot(trust[f] ** 2, data.used[f], 1) for f in chosen])
    total, number = sums.sum(axis=0), counts.sum(axis=0)
    before = np.diag(whole)
    whole = whole - _gram(total, total, _fitting(number))
    # what the offsets contain (to first order a dome at rest is one of them) leaves rounding alone
    contained = np.diag(whole) < CONTAINED * before
    points = np.arange(rows.shape[2])
    for fold in range(FOLDS):
        block = blocks.held_block(fold)
        t, m = sums[block, :, points].swapaxes(0, 1), counts[block, points]
        s, inverse = total - t, _fitting(number - m)
        across = _gram(t, s, inverse)
        kept[fold] -= _gram(s, s, inverse)
        held[fold] -= across + across.T - _gram(s, s, m * inverse**2)
    for matrices in (whole, kept, held):
        matrices[..., contained, :] = 0.0
        matrices[..., :, contained] = 0.0
    return whole, kept, held


def _gram(a: Floats, b: Floats, weight: Floats) -> Floats:
    return (a * weight).reshape(len(a), -1) @ b.reshape(len(b), -1).T


def _fitting(count: Floats) -> Floats:
    """1/count, 0 for points that were never kept: their offset stays none."""
    return np.divide(1.0, count, out=np.zeros_like(count), where=count > 0)


def offsets_of(residual: Floats, used: NDArray[np.bool_], trust: Floats) -> Floats:
    """Offset (points, 3) of every point that leaves least of a residual (frames, points, 3).

    By the used values, with the trust (frames,) in each frame; 0 where there are none.
    """
    total = np.tensordot(trust**2, np.where(used, residual, 0.0), 1)
    return total * _fitting(np.tensordot(trust**2, used, 1))
