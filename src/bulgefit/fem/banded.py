"""What LAPACK has no fast routine for: substitutions with a band's factor, and the whole band.

LAPACK's dpbtrs takes one right-hand side after the other and reads the factor anew for each. Here
four columns of the factor at a time serve all of them while they are in the fastest memory, and two
right-hand sides share what has been read into registers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import compiled, inlined, merged

__all__ = ["stored_height", "substitute", "widen"]

Floats = NDArray[np.float64]

#: Columns of the factor that are taken together; the kernels below are written out for four.
PANEL = 4
#: Rows that the processor's vectors take at once: loops over a multiple of them have no remainder,
#: which would be done one by one.
ROWS = 16


def stored_height(below: int) -> int:
    """Rows to store of a band with `below` subdiagonals; those beyond them must be zero.

    Then the rows that the four columns of a panel reach together are all that any of them has.
    """
    return PANEL + ROWS * -(-below // ROWS)


@merged
def _solve_panel(column: Floats, j: int, y: Floats) -> tuple[float, float, float, float]:
    """Unknowns j to j + 3 of L y' = y."""
    y0 = y[j] / column[j, 0]
    y1 = (y[j + 1] - column[j, 1] * y0) / column[j + 1, 0]
    y2 = (y[j + 2] - column[j, 2] * y0 - column[j + 1, 1] * y1) / column[j + 2, 0]
    y3 = y[j + 3] - column[j, 3] * y0 - column[j + 1, 2] * y1 - column[j + 2, 1] * y2
    y3 /= column[j + 3, 0]
    y[j], y[j + 1], y[j + 2], y[j + 3] = y0, y1, y2, y3
    return y0, y1, y2, y3


@merged
def _solve_transposed_panel(
    column: Floats, j: int, y: Floats, s0: float, s1: float, s2: float, s3: float
) -> None:
    """Unknowns j to j + 3 of Lᵀ y' = y, given the sums over the rows below."""
    y3 = (y[j + 3] - s3) / column[j + 3, 0]
    y2 = (y[j + 2] - s2 - column[j + 2, 1] * y3) / column[j + 2, 0]
    y1 = (y[j + 1] - s1 - column[j + 1, 1] * y2 - column[j + 1, 2] * y3) / column[j + 1, 0]
    y0 = y[j] - s0 - column[j, 1] * y1 - column[j, 2] * y2 - column[j, 3] * y3
    y[j], y[j + 1], y[j + 2], y[j + 3] = y0 / column[j, 0], y1, y2, y3


@inlined
def _forward(column: Floats, j: int, y: Floats) -> None:
    """Unknowns j to j + 3 of L y' = y, and what they take from the rows below."""
    y0, y1, y2, y3 = _solve_panel(column, j, y)
    below = y[j + 4 : j + column.shape[1]]
    a, b, c, d = column[j, 4:], column[j + 1, 3:], column[j + 2, 2:], column[j + 3, 1:]
    for t in range(len(below)):
        below[t] -= a[t] * y0 + b[t] * y1 + c[t] * y2 + d[t] * y3


@inlined
def _forward_two(column: Floats, j: int, y: Floats, z: Floats) -> None:
    """The same for two right-hand sides."""
    y0, y1, y2, y3 = _solve_panel(column, j, y)
    z0, z1, z2, z3 = _solve_panel(column, j, z)
    of_y, of_z = y[j + 4 : j + column.shape[1]], z[j + 4 : j + column.shape[1]]
    a, b, c, d = column[j, 4:], column[j + 1, 3:], column[j + 2, 2:], column[j + 3, 1:]
    for t in range(len(of_y)):
        of_y[t] -= a[t] * y0 + b[t] * y1 + c[t] * y2 + d[t] * y3
        of_z[t] -= a[t] * z0 + b[t] * z1 + c[t] * z2 + d[t] * z3


@inlined
def _backward(column: Floats, j: int, y: Floats) -> None:
    """Unknowns j to j + 3 of Lᵀ y' = y, from those below."""
    below = y[j + 4 : j + column.shape[1]]
    a, b, c, d = column[j, 4:], column[j + 1, 3:], column[j + 2, 2:], column[j + 3, 1:]
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for t in range(len(below)):
        s0 += a[t] * below[t]
        s1 += b[t] * below[t]
        s2 += c[t] * below[t]
        s3 += d[t] * below[t]
    _solve_transposed_panel(column, j, y, s0, s1, s2, s3)


@inlined
def _backward_two(column: Floats, j: int, y: Floats, z: Floats) -> None:
    """The same for two right-hand sides."""
    of_y, of_z = y[j + 4 : j + column.shape[1]], z[j + 4 : j + column.shape[1]]
    a, b, c, d = column[j, 4:], column[j + 1, 3:], column[j + 2, 2:], column[j + 3, 1:]
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    r0, r1, r2, r3 = 0.0, 0.0, 0.0, 0.0
    for t in range(len(of_y)):
        s0 += a[t] * of_y[t]
        s1 += b[t] * of_y[t]
        s2 += c[t] * of_y[t]
        s3 += d[t] * of_y[t]
        r0 += a[t] * of_z[t]
        r1 += b[t] * of_z[t]
        r2 += c[t] * of_z[t]
        r3 += d[t] * of_z[t]
    _solve_transposed_panel(column, j, y, s0, s1, s2, s3)
    _solve_transposed_panel(column, j, z, r0, r1, r2, r3)


@compiled
def substitute(column: Floats, right: Floats) -> None:
    """Solve L Lᵀ x = b in place.

    Parameters
    ----------
    column : (N, height) array
        The factor's columns from the diagonal down, with as many zeros below the band as
        `stored_height` asks for.
    right : (k, N) array
        Right-hand sides, one a row; overwritten with the solutions.
    """
    n, height = column.shape
    whole = n - n % PANEL
    paired = len(right) - len(right) % 2
    for j in range(0, whole, PANEL):
        for k in range(0, paired, 2):
            _forward_two(column, j, right[k], right[k + 1])
        if paired < len(right):
            _forward(column, j, right[paired])
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
        for k in range(0, paired, 2):
            _backward_two(column, j, right[k], right[k + 1])
        if paired < len(right):
            _backward(column, j, right[paired])


@compiled
def widen(column: Floats, below: int, general: Floats) -> None:
    """The whole of a symmetric band from its columns, as LAPACK's dgbtrf takes it.

    Parameters
    ----------
    column : (N, height) array
        The columns from the diagonal down, with `below` subdiagonals.
    general : (N, 3 below + 1) array
        Overwritten: row j holds column j, its diagonal after 2 below places, of which the first
        half are left for the factor to fill, and set by it.
    """
    for j in range(len(column)):
        general[j, 2 * below :] = column[j, : below + 1]
        for k in range(1, min(j, below) + 1):
            general[j, 2 * below - k] = column[j - k, k]
