"""Sums of absolute residuals over measured points, and what a descent on them needs.

The sums run over nodal fields and an observation operator, point by point: nothing of the size
of the data is allocated, whatever its precision, and the cost is linear in points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.fem.jit import compiled
from bulgefit.model.observation import Observation

__all__ = ["Rows", "absolute_sums", "count_and_peaks", "linearised_rows"]

Floats = NDArray[np.floating]

#: Frames that a dense operator handles at once.
_CHUNK = 8
#: Frames from which on it pays to run along the frames instead of the points.
_MANY = 6
#: Points whose measured values are turned round together.
_TILE = 32


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals r + J d of a linearised model, and their weights: F(d) = Σ scale |r + J d|.

    Attributes
    ----------
    jacobian : (m, free) array
    residual : (m,) array, mm
    scale : (m,) array
    whole : bool
        False where the rows are a sample that stands for all data.
    """

    jacobian: Floats
    residual: Floats
    scale: Floats
    whole: bool

    def value(self, step: Floats) -> float:
        """The linearised objective after a step, mm."""
        return float(self.scale @ np.abs(self.residual + self.jacobian @ step))

    def slope(self) -> Floats:
        """Its derivative at no step, (free,)."""
        return (self.scale * np.sign(self.residual)) @ self.jacobian

    def normal(self, step: Floats, floor: float) -> tuple[Floats, Floats]:
        """Reweighted normal equations JᵀWJ, JᵀW(r + J step), W = scale / max(|r + J step|, floor).

        Their quadratic lies above Σ scale |r + J d| rounded off below `floor`, and touches it at
        `step`: minimising it again and again descends (Hunter and Lange, 2004).
        """
        size = self.jacobian.shape[1]
        hessian, gradient = np.zeros((size, size)), np.zeros(size)
        _normal(self.jacobian, self.residual, self.scale, step, floor, hessian, gradient)
        return hessian, gradient


def count_and_peaks(measured: NDArray[np.floating]) -> tuple[NDArray[np.int64], Floats]:
    """Measured values per frame and component (k, 3), and the largest |value| of each, (3,) mm."""
    counts = np.zeros((len(measured), 3), dtype=np.int64)
    peaks = np.zeros(3)
    _count_and_peaks(measured, counts, peaks)
    return counts, peaks


def absolute_sums(
    observation: Observation,
    nodal: Floats,
    measured: NDArray[np.floating],
    scale: Floats,
    pull: Floats | None = None,
) -> Floats:
    """Sum of |modelled - measured| over the points of each frame, (k, 3) mm.

    Parameters
    ----------
    nodal : (k, n, 3) array, mm
    measured : (k, points, 3) array, mm
        NaN is left out.
    scale : (k, 3) array
        Factor of each sum in the objective; used for `pull` alone.
    pull : (k, n, 3) array, optional
        Overwritten with the derivative of Σ scale · sums by the nodal field.
    """
    sums = np.zeros((len(nodal), 3))
    if isinstance(observation.matrix, sparse.csr_array):
        _sparse_sums(observation.matrix, nodal, measured, scale, sums, pull)
        return sums
    for first in range(0, len(nodal), _CHUNK):
        some = slice(first, first + _CHUNK)
        residual = observation(nodal[some]) - measured[some]
        sums[some] = np.nansum(np.abs(residual), axis=1)
        if pull is not None:
            sign = np.nan_to_num(np.sign(residual))
            pull[some] = observation.adjoint(sign * scale[some, None, :])
    return sums


def linearised_rows(
    observation: Observation,
    nodal: Floats,
    derivative: Floats,
    measured: NDArray[np.floating],
    scale: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Jacobian (m, free), residual (m,) mm and scale (m,) of the values that count.

    Parameters
    ----------
    nodal : (k, n, 3) array, mm
    derivative : (free, k, n, 3) array
    measured : (k, points, 3) array, mm
    scale : (k, 3) array
    """
    seen = np.isfinite(measured) & (scale != 0.0)[:, None, :]
    residual = (observation(nodal) - measured)[seen]
    jacobian = np.empty((len(residual), len(derivative)))
    for j, column in enumerate(derivative):
        jacobian[:, j] = observation(column)[seen]
    return jacobian, residual, np.broadcast_to(scale[:, None, :], measured.shape)[seen]


@compiled
def _count_and_peaks(measured, counts, peaks):
    for frame in range(measured.shape[0]):
        for point in range(measured.shape[1]):
            for c in range(3):
                seen = measured[frame, point, c]
                if np.isfinite(seen):
                    counts[frame, c] += 1
                    peaks[c] = max(peaks[c], abs(seen))


def _sparse_sums(
    matrix: sparse.csr_array,
    nodal: Floats,
    measured: NDArray[np.floating],
    scale: Floats,
    sums: Floats,
    pull: Floats | None,
) -> None:
    csr = matrix.indptr, matrix.indices, matrix.data
    if len(nodal) < _MANY:
        target = np.zeros((1, 1, 3)) if pull is None else pull
        _sums_by_frame(*csr, nodal, measured, scale, sums, target, pull is not None)
        return
    turned = np.ascontiguousarray(np.moveaxis(nodal, 0, -1))
    target = np.zeros_like(turned if pull is not None else turned[:1])
    found = np.zeros((3, len(nodal)))
    _sums_by_point(
        *csr, turned, measured, np.ascontiguousarray(scale.T), found, target, pull is not None
    )
    sums[:] = found.T
    if pull is not None:
        pull[:] = np.moveaxis(target, -1, 0)


@compiled
def _sums_by_frame(indptr, indices, data, nodal, measured, scale, sums, pull, with_pull):
    if with_pull:
        pull[:] = 0.0
    for frame in range(nodal.shape[0]):
        sx, sy, sz = 0.0, 0.0, 0.0
        for point in range(measured.shape[1]):
            first, last = indptr[point], indptr[point + 1]
            x, y, z = 0.0, 0.0, 0.0
            for i in range(first, last):
                node, weight = indices[i], data[i]
                x += weight * nodal[frame, node, 0]
                y += weight * nodal[frame, node, 1]
                z += weight * nodal[frame, node, 2]
            x -= measured[frame, point, 0]
            y -= measured[frame, point, 1]
            z -= measured[frame, point, 2]
            x = 0.0 if np.isnan(x) else x
            y = 0.0 if np.isnan(y) else y
            z = 0.0 if np.isnan(z) else z
            sx, sy, sz = sx + abs(x), sy + abs(y), sz + abs(z)
            if with_pull:
                x, y, z = np.sign(x), np.sign(y), np.sign(z)
                for i in range(first, last):
                    node, weight = indices[i], data[i]
                    pull[frame, node, 0] += weight * x
                    pull[frame, node, 1] += weight * y
                    pull[frame, node, 2] += weight * z
        sums[frame, 0], sums[frame, 1], sums[frame, 2] = sx, sy, sz
        if with_pull:
            for node in range(nodal.shape[1]):
                for c in range(3):
                    pull[frame, node, c] *= scale[frame, c]


@compiled
def _sums_by_point(indptr, indices, data, nodal, measured, scale, sums, pull, with_pull):
    # nodal and pull are (n, 3, k), scale and sums (3, k): the inner loops run along the frames
    count, frames = measured.shape[1], nodal.shape[2]
    tile = np.empty((_TILE, 3, frames), dtype=measured.dtype)
    row = np.empty(frames)
    for start in range(0, count, _TILE):
        stop = min(start + _TILE, count)
        for frame in range(frames):
            for point in range(start, stop):
                for c in range(3):
                    tile[point - start, c, frame] = measured[frame, point, c]
        for point in range(start, stop):
            first, last = indptr[point], indptr[point + 1]
            for c in range(3):
                for k in range(frames):
                    row[k] = -tile[point - start, c, k]
                for i in range(first, last):
                    node, weight = indices[i], data[i]
                    for k in range(frames):
                        row[k] += weight * nodal[node, c, k]
                for k in range(frames):
                    r = row[k]
                    sums[c, k] += 0.0 if np.isnan(r) else abs(r)
                    # NaN compares false, so it pulls nowhere
                    row[k] = ((1.0 if r > 0.0 else 0.0) - (1.0 if r < 0.0 else 0.0)) * scale[c, k]
                if with_pull:
                    for i in range(first, last):
                        node, weight = indices[i], data[i]
                        for k in range(frames):
                            pull[node, c, k] += weight * row[k]


@compiled
def _normal(jacobian, residual, scale, step, floor, hessian, gradient):
    size = jacobian.shape[1]
    for row in range(jacobian.shape[0]):
        moved = residual[row]
        for j in range(size):
            moved += jacobian[row, j] * step[j]
        weight = scale[row] / max(abs(moved), floor)
        for j in range(size):
            share = weight * jacobian[row, j]
            gradient[j] += share * moved
            for i in range(j + 1):
                hessian[j, i] += share * jacobian[row, i]
    for j in range(size):
        for i in range(j):
            hessian[i, j] = hessian[j, i]
