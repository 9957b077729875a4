"""What a fit's errors are made of: the sums of residuals' pulls, and how far those are known.

At the optimum of Σ ρ(r), with ψ = ρ' and J the derivative of the model, each residual pulls by the
score ψ J. Here are A = Σ E[ρ''] J Jᵀ, and B, the covariance of the sum of all scores, in two ways:

* of noise that is correlated within a frame: pairs of scores count fully up to a distance at which
  the correlation has ended, and less from there on to twice that distance (Conley, 1999). Sums over
  cells would do the same without the pairs across their edges, a third of all where cells are four
  correlation lengths wide; a weight that is flat at first loses none of them (Politis and Romano,
  1995). Where a share of the noise persists in the points, pairs in different frames count, too.
* of residuals that may be alike in any way within blocks of frames and sectors of the disc (Liang
  and Zeger, 1986).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from bulgefit.dic.noise import Noise
from bulgefit.fitting.objective import Look, Objective

__all__ = ["Changed", "Scores"]

Floats = NDArray[np.floating]

#: Pairs count up to so many correlation lengths, and at least this share of the radius; fully up
#: to half of it. There the correlation of the noise has fallen to exp(-2), or exp(-4).
_LENGTHS, _LEAST_REACH = 4.0, 0.25
#: Scores are summed within cells this part of the reach wide: they only blur the weight of pairs.
_CELLS = 4
#: Blocks of neighbouring frames, and sectors.
_BLOCKS, _SECTORS = 4, 6
#: ∫ w² over the plane for the weight w of pairs, 11π/24 of the reach squared; of pairs in one
#: square as wide as the reach it is 1: so much less is the variance known than by such squares.
_OF_SQUARES = 11.0 * np.pi / 24.0


@dataclass(frozen=True, eq=False)
class Changed:
    """Values of which the model changes.

    Attributes
    ----------
    jacobian : (m, free) array
        Of the model, by the coordinates.
    change : (m,) array, mm
    scale : (m,) array
        In the objective.
    curvature : (m,) array
        E[ρ''].
    """

    jacobian: Floats
    change: Floats
    scale: Floats
    curvature: Floats


class Scores:
    """A, and the sums of scores of which B is made.

    A and the medians are means over points, which a sample tells; the sums of scores are not.

    Parameters
    ----------
    objective : Objective
    columns : per test, (names, free) array
        Derivatives by the coordinates of what the test differentiates by.
    noises : per test, Noise or None
    """

    def __init__(
        self, objective: Objective, columns: list[Floats], noises: Sequence[Noise | None]
    ) -> None:
        self.columns, self.squared = columns, objective.squared
        self.tests = objective.tests
        self.reach = [
            max(_LENGTHS * noise.correlation_length if noise else 0.0, _LEAST_REACH * test.radius)
            for noise, test in zip(noises, self.tests, strict=True)
        ]
        self.persists = [noise is not None and noise.persistent > 0.0 for noise in noises]
        self._size = columns[0].shape[1]
        self._grams: dict[tuple[int, int], Floats] = {}
        self._residuals: dict[tuple[int, int], list[Floats]] = {}
        self._of_cells: list[dict[tuple[int, int], Floats]] = [{} for _ in self.tests]
        self._of_sectors: list[dict[int, Floats]] = [{} for _ in self.tests]
        self._curvatures: dict[tuple[int, int], float] = {}

    def jacobian(self, look: Look) -> Floats:
        """By the coordinates, (k, m, 3, free)."""
        return np.tensordot(look.jacobian(), self.columns[look.test], (0, 0))

    def weigh(self, look: Look) -> None:
        """Take some points into A."""
        seen = np.isfinite(look.residual)
        weight = np.where(seen, look.scale[:, None], 0.0)
        jacobian = self.jacobian(look)
        for c in range(3):
            part = jacobian[:, :, c].reshape(-1, self._size)
            gram = part.T @ (part * weight[:, :, c].reshape(-1, 1))
            key = (look.test, c)
            self._grams[key] = self._grams.get(key, 0.0) + gram
            self._residuals.setdefault(key, []).append(look.residual[:, :, c][seen[:, :, c]])

    def places(self, test: int, position: Floats) -> NDArray[np.intp]:
        """Cell by x and y, and sector, of points (m, 2) mm of a test: (m, 3)."""
        cell = np.floor(position * (_CELLS / self.reach[test])).astype(np.intp)
        angle = np.arctan2(position[:, 1], position[:, 0]) + np.pi
        sector = np.minimum((angle * _SECTORS / (2 * np.pi)).astype(np.intp), _SECTORS - 1)
        return np.column_stack([cell, sector])

    def group(self, test: int, position: Floats) -> NDArray[np.intp]:
        """A number (m,) for each of the `places` of points."""
        places = self.places(test, position)
        return np.unique(places, axis=0, return_inverse=True)[1].ravel()

    def add(self, look: Look) -> None:
        """Take the scores of some points in."""
        of_points = self.places(look.test, look.position)
        places, which = np.unique(of_points, axis=0, return_inverse=True)
        by_name = look.gathered(look.pull(squared=self.squared), which.ravel())
        summed = np.tensordot(by_name, self.columns[look.test], (0, 0))  # (groups, frames, free)
        cells, sectors = self._of_cells[look.test], self._of_sectors[look.test]
        none = (self.tests[look.test].n_frames, self._size)
        for (x, y, sector), rows in zip(places.tolist(), summed, strict=True):
            cells.setdefault((x, y), np.zeros(none))[look.frames] += rows
            sectors.setdefault(sector, np.zeros(none))[look.frames] += rows

    def bread(self) -> Floats:
        """A: for absolute residuals twice their density at zero, as of a normal distribution."""
        out = np.zeros((self._size, self._size))
        for key, gram in self._grams.items():
            out += self.curvature(key) * gram
        return out

    def curvature(self, key: tuple[int, int]) -> float:
        """E[ρ''] of a test's component, once all points are in; 0 where too few are left to tell.

        A sum of absolute deviations is least where as many of them are nothing as parameters are
        free (Bassett and Koenker, 1978): those tell nothing of how large the others are.
        """
        if self.squared:
            return 1.0
        if key not in self._curvatures:
            left = np.sort(np.abs(np.concatenate(self._residuals[key])))[self._size :]
            deviation = max(1.4826 * float(np.median(left)), 1e-9) if len(left) else np.inf
            self._curvatures[key] = float(np.sqrt(2.0 / np.pi) / deviation)
        return self._curvatures[key]

    def of_noise(self, inverse: Floats) -> tuple[Floats, Floats]:
        """A⁻¹ B A⁻¹ of noise that is correlated in space or persists, and its degrees of freedom.

        Parameters
        ----------
        inverse : (free, free) array
            A⁻¹.

        Returns
        -------
        covariance : (free, free) array
        freedom : (free,) array
        """
        total, squares = np.zeros((self._size, self._size)), []
        for cells, persists in zip(self._of_cells, self.persists, strict=True):
            if not cells:
                continue
            cell, scores = np.array(list(cells)), np.array(list(cells.values())) @ inverse
            if persists:
                # a point's errors in all frames are alike: pairs of frames count as those of points
                scores = scores.sum(axis=1, keepdims=True)
            apart = cdist(cell, cell) / _CELLS  # of the reach
            near = np.tensordot(np.clip(2.0 - 2.0 * apart, 0.0, 1.0), scores, 1)
            total += np.tensordot(scores, near, ((0, 1), (0, 1)))
            squares.append(_together(cell // _CELLS, scores))
        rows = _filled(squares, self._size)
        return _proper(total), np.maximum(_freedom(rows) / _OF_SQUARES, 1.0)

    def of_blocks(self, inverse: Floats) -> tuple[Floats, Floats]:
        """The same of residuals that are alike in blocks of frames and sectors."""
        blocks = []
        for test, sectors in zip(self.tests, self._of_sectors, strict=True):
            if not sectors:
                continue
            rank = np.argsort(np.argsort(test.pressure))
            block = rank * _BLOCKS // max(test.n_frames, 1)
            scores = np.array(list(sectors.values())) @ inverse
            blocks.append(_together(block[:, None], scores.swapaxes(0, 1)))
        rows = _filled(blocks, self._size)
        return rows.T @ rows * (len(rows) / max(len(rows) - 1, 1)), _freedom(rows)

    def rows_of(self, look: Look, change: Floats) -> Changed:
        """A change (k, m, 3) mm of what is modelled, by value that was measured."""
        seen = np.isfinite(look.residual)
        scale, curvature = np.zeros_like(look.residual), np.zeros_like(look.residual)
        scale[:] = look.scale[:, None]
        curvature[:] = [self.curvature((look.test, c)) for c in range(3)]
        return Changed(self.jacobian(look)[seen], change[seen], scale[seen], curvature[seen])


def _together(label: NDArray[np.intp], rows: Floats) -> Floats:
    """Sums of rows (n, m, free) over rows of one label (n, ...): (labels, m, free)."""
    kinds, which = np.unique(label, axis=0, return_inverse=True)
    out = np.zeros((len(kinds), *rows.shape[1:]))
    np.add.at(out, which.ravel(), rows)
    return out


def _filled(parts: Sequence[Floats], size: int) -> Floats:
    """The sums (n, size) in which anything was measured."""
    rows = np.concatenate([part.reshape(-1, size) for part in parts])
    return rows[rows.any(axis=1)]


def _proper(covariance: Floats) -> Floats:
    """The nearest one that could be: without negative variances (Politis, 2011)."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(covariance)), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return np.asarray(kept * np.outer(scale, scale))


def _freedom(rows: Floats) -> Floats:
    """Degrees of freedom (free,) of the sums of squares of independent rows (n, free).

    Twice the square of its mean over its variance (Satterthwaite, 1946), with the variances of the
    rows taken from their fourth powers, as of normal ones: as many as there are rows, if they all
    weigh the same, and few where few of them weigh most.
    """
    squares, fourth = (rows**2).sum(axis=0), (rows**4).sum(axis=0)
    found = 3.0 * squares**2 / np.maximum(fourth, 1e-300)
    return np.asarray(np.clip(found, 1.0, max(len(rows) - 1, 1)))
