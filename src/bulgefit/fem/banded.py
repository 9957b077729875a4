"""Products and substitutions with a symmetric band, all columns of the other side together.

LAPACK's dpbtrs takes one right-hand side after the other and reads the factor anew for each. Here
four columns of the factor at a time serve all of them while they are in the fastest memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import compiled, inlined

__all__ = ["PANEL", "multiply", "substitute"]

Floats = NDArray[np.float64]

#: Columns of the factor that are taken together; the kernels below are written out for four.
PANEL = 4


@inlined
def _forward(column: Floats, j: int, y: Floats) -> None:
    """Unknowns j to j + 3 of L y' = y, and what they take from the rows below."""
    n, height = column.shape
    y0 = y[j] / column[j, 0]
    y1 = (y[j + 1] - column[j, 1] * y0) / column[j + 1, 0]
    y2 = (y[j + 2] - column[j, 2] * y0 - column[j + 1, 1] * y1) / column[j + 2, 0]
    y3 = y[j + 3] - column[j, 3] * y0 - column[j + 1, 2] * y1 - column[j + 2, 1] * y2
    y3 /= column[j + 3, 0]
    y[j], y[j + 1], y[j + 2], y[j + 3] = y0, y1, y2, y3
    below = y[j + 4 : j + height]
    a, b, c, d = column[j, 4:], column[j + 1, 3:], column[j + 2, 2:], column[j + 3, 1:]
    for t in range(len(below)):
        below[t] -= a[t] * y0 + b[t] * y1 + c[t] * y2 + d[t] * y3
    # the last rows, which not all four columns reach
    for m in range(1, PANEL):
        for i in range(j + height, min(j + m + height, n)):
            y[i] -= column[j + m, i - j - m] * y[j + m]


@inlined
def _backward(column: Floats, j: int, y: Floats) -> None:
    """Unknowns j to j + 3 of Lᵀ y' = y, from those below."""
    n, height = column.shape
    below = y[j + 4 : j + height]
    a, b, c, d = column[j, 4:], column[j + 1, 3:], column[j + 2, 2:], column[j + 3, 1:]
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for t in range(len(below)):
        s0 += a[t] * below[t]
        s1 += b[t] * below[t]
        s2 += c[t] * below[t]
        s3 += d[t] * below[t]
    y[j], y[j + 1], y[j + 2], y[j + 3] = y[j] - s0, y[j + 1] - s1, y[j + 2] - s2, y[j + 3] - s3
    for m in range(1, PANEL):
        for i in range(j + height, min(j + m + height, n)):
            y[j + m] -= column[j + m, i - j - m] * y[i]
    for m in range(PANEL - 1, -1, -1):
        for i in range(m + 1, PANEL):
            y[j + m] -= column[j + m, i - m] * y[j + i]
        y[j + m] /= column[j + m, 0]


@compiled
def substitute(column: Floats, right: Floats) -> None:
    """Solve L Lᵀ x = b in place.

    Parameters
    ----------
    column : (N, height) array
        The factor's columns from the diagonal down; height at least `PANEL`.
    right : (k, N) array
        Right-hand sides, one a row; overwritten with the solutions.
    """
    n, height = column.shape
    whole = n - n % PANEL
    for j in range(0, whole, PANEL):
        for k in range(len(right)):
            _forward(column, j, right[k])
    for y in right:
        for j in range(whole, n):
            y[j] /= column[j, 0]
            for i in range(j + 1, min(j + height, n)):
                y[i] -= column[j, i - j] * y[j]
        for j in range(n - 1, whole - 1, -1):
            for i in range(j + 1, min(j + height, n)):
                y[j] -= column[j, i - j] * y[i]
            y[j] /= column[j, 0]
    for j in range(whole - PANEL, -1, -PANEL):
        for k in range(len(right)):
            _backward(column, j, right[k])


@compiled
def multiply(column: Floats, x: Floats, out: Floats) -> None:
    """Symmetric matrix times vectors.

    Parameters
    ----------
    column : (N, height) array
        The matrix's columns from the diagonal down.
    x : (k, N) array
        Vectors, one a row.
    out : (k, N) array
        Overwritten with the products.
    """
    n, height = column.shape
    out[:] = 0.0
    for j in range(n):
        below = column[j, 1 : min(height, n - j)]
        for k in range(len(x)):
            here, total = x[k, j], column[j, 0] * x[k, j]
            known, sums = x[k, j + 1 :], out[k, j + 1 :]
            for t in range(len(below)):
                sums[t] += below[t] * here
                total += below[t] * known[t]
            out[k, j] += total
