"""LAPACK's banded factorisations without the interpreter's lock.

scipy's wrappers keep the lock while LAPACK works, so that two threads take turns; the same
routines, called by the addresses that `scipy.linalg.cython_lapack` publishes for that, run side by
side. Matrices are column-major and overwritten.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np
from numba.extending import get_cython_function_address
from numpy.typing import NDArray

__all__ = ["dgbtrf", "dgbtrs", "dpbtrf"]

Floats = NDArray[np.float64]
Pivots = NDArray[np.intc]


@cache
def _routine(name: str, arguments: int) -> Callable[..., None]:
    """A Fortran subroutine: every argument is an address."""
    address = get_cython_function_address("scipy.linalg.cython_lapack", name)
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * arguments)(address)


def _call(name: str, *arguments: str | int | Floats | Pivots) -> int:
    """Call with letters, integers and arrays; the info that LAPACK returns."""
    kept: list[ctypes.c_char | ctypes.c_int] = []
    places = []
    for argument in (*arguments, 0):
        if isinstance(argument, np.ndarray):
            places.append(argument.ctypes.data)
            continue
        cell: ctypes.c_char | ctypes.c_int
        cell = (
            ctypes.c_char(argument.encode())
            if isinstance(argument, str)
            else ctypes.c_int(argument)
        )
        kept.append(cell)
        places.append(ctypes.addressof(cell))
    _routine(name, len(places))(*places)
    info = kept[-1]
    assert isinstance(info, ctypes.c_int)
    return info.value


def dpbtrf(band: Floats, below: int) -> int:
    """Cholesky factor of a lower band with `below` subdiagonals in its place.

    The rows of the band (height, N) below them are left alone. > 0: not positive definite.
    """
    height, size = band.shape
    return _call("dpbtrf", "L", size, below, band, height)


def dgbtrf(band: Floats, below: int) -> tuple[Pivots, int]:
    """LU factor of a band (3 below + 1, N) in its place; pivots, and > 0: a zero pivot."""
    rows, size = band.shape
    pivots = np.empty(size, dtype=np.intc)
    return pivots, _call("dgbtrf", size, size, below, below, band, rows, pivots)


def dgbtrs(band: Floats, below: int, pivots: Pivots, right: Floats) -> int:
    """Solve with `dgbtrf`'s factor for right-hand sides (N, k), in their place."""
    rows, size = band.shape
    count = right.shape[1]
    return _call("dgbtrs", "N", size, below, below, count, band, rows, pivots, right, size)
