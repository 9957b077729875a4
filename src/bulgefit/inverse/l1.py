"""Sums of absolute residuals over measured points, and what a descent on them needs.

All of it works on nodal fields and an observation operator, point by point, so nothing of the
size of the data is ever allocated: the cost is linear in points and memory does not grow.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.model.observation import Observation

__all__ = ["absolute_sums", "count_measured", "weighted_normal"]

Floats = NDArray[np.floating]


def count_measured(measured: NDArray[np.floating]) -> NDArray[np.int64]:
    """Measured values per frame and component, (k, 3)."""
    return np.isfinite(measured).sum(axis=1)


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
    if isinstance(observation.matrix, sparse.csr_array):
        matrix = observation.matrix
        sums = np.zeros((len(nodal), 3))
        target = np.zeros((1, 1, 3)) if pull is None else pull
        _absolute_sums(
            matrix.indptr, matrix.indices, matrix.data, nodal, measured, scale, sums, target,
            pull is not None,
        )  # fmt: skip
        return sums
    residual = observation(nodal) - measured
    if pull is not None:
        pull[:] = observation.adjoint(np.nan_to_num(np.sign(residual)) * scale[:, None, :])
    return np.nansum(np.abs(residual), axis=1)


def weighted_normal(
    observation: Observation,
    nodal: Floats,
    derivative: Floats,
    measured: NDArray[np.floating],
    scale: Floats,
    floor: Floats,
) -> tuple[Floats, Floats, float]:
    """Normal equations of iteratively reweighted least squares for Σ scale |residual|.

    Each residual r weighs scale / max(|r|, floor): (JᵀWJ, JᵀWr, Σ scale |r|).

    Parameters
    ----------
    nodal : (k, n, 3) array, mm
    derivative : (parameters, k, n, 3) array
    floor : (3,) array, mm
    """
    size = len(derivative)
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    if isinstance(observation.matrix, sparse.csr_array):
        matrix = observation.matrix
        columns = np.ascontiguousarray(np.moveaxis(derivative, 0, -1))
        value = _weighted_normal(
            matrix.indptr, matrix.indices, matrix.data, nodal, columns, measured, scale, floor,
            hessian, gradient,
        )  # fmt: skip
        return hessian, gradient, value
    residual = observation(nodal) - measured
    weight = np.nan_to_num(scale[:, None, :] / np.maximum(np.abs(residual), floor))
    residual = np.nan_to_num(residual)
    rows = np.stack([observation(column) for column in derivative])
    weighted = rows * weight
    hessian = np.tensordot(weighted, rows, axes=([1, 2, 3], [1, 2, 3]))
    gradient = np.tensordot(weighted, residual, axes=3)
    return hessian, gradient, float((scale[:, None, :] * np.abs(residual)).sum())


@njit(cache=True, nogil=True)
def _absolute_sums(indptr, indices, data, nodal, measured, scale, sums, pull, with_pull):
    if with_pull:
        pull[:] = 0.0
    for frame in range(nodal.shape[0]):
        for point in range(measured.shape[1]):
            first, last = indptr[point], indptr[point + 1]
            for c in range(3):
                seen = measured[frame, point, c]
                if not np.isfinite(seen):
                    continue
                value = 0.0
                for i in range(first, last):
                    value += data[i] * nodal[frame, indices[i], c]
                residual = value - seen
                sums[frame, c] += abs(residual)
                if with_pull and residual != 0.0:
                    share = scale[frame, c] if residual > 0.0 else -scale[frame, c]
                    for i in range(first, last):
                        pull[frame, indices[i], c] += share * data[i]


@njit(cache=True, nogil=True)
def _weighted_normal(
    indptr, indices, data, nodal, columns, measured, scale, floor, hessian, gradient
):
    size = columns.shape[3]
    row = np.empty(size)
    total = 0.0
    for frame in range(nodal.shape[0]):
        for point in range(measured.shape[1]):
            first, last = indptr[point], indptr[point + 1]
            for c in range(3):
                seen = measured[frame, point, c]
                if not np.isfinite(seen) or scale[frame, c] == 0.0:
                    continue
                value = 0.0
                row[:] = 0.0
                for i in range(first, last):
                    value += data[i] * nodal[frame, indices[i], c]
                    for j in range(size):
                        row[j] += data[i] * columns[frame, indices[i], c, j]
                residual = value - seen
                total += scale[frame, c] * abs(residual)
                weight = scale[frame, c] / max(abs(residual), floor[c])
                for j in range(size):
                    share = weight * row[j]
                    gradient[j] += share * residual
                    for i in range(j + 1):
                        hessian[j, i] += share * row[i]
    for j in range(size):
        for i in range(j):
            hessian[i, j] = hessian[j, i]
    return total
