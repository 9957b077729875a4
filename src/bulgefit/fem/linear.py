"""Factorise the tangent and solve with it: one seam, the solver that suits the size.

A solver numbers the free displacements itself (its fill-reducing order), tells the assembly where
each entry of a cell's matrix goes, and turns the assembled entries into a factor. The tangent is
symmetric; only its lower triangle is assembled.
"""

from __future__ import annotations

import copy
import weakref
from functools import cache
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from bulgefit.errors import InputError, one_of
from bulgefit.fem import lapack
from bulgefit.fem.banded import stored_height, substitute, widen
from bulgefit.fem.ordering import narrow_order

__all__ = ["SOLVERS", "Factor", "LinearSolver", "NotPositiveDefiniteError", "make_solver"]

Floats = NDArray[np.float64]

#: Free displacements up to which banded Cholesky is chosen: where PARDISO is installed, and where
#: SuperLU has to do for larger ones (docs/performance.md).
BANDED_UP_TO = {"pardiso": 4_000, "superlu": 30_000}

#: Bytes of a band up to which its memory is used again: fresh memory takes a tenth of the time of
#: a small factorisation, and next to nothing of a large one.
_REUSED_UP_TO = 2**24
#: How many are kept for that: as many as are factorised side by side, and a path's last ones.
_IDLE = 8

_ROWS, _COLUMNS = np.tril_indices(12)


class NotPositiveDefiniteError(ArithmeticError):
    """The tangent has a direction of no or negative stiffness."""


class Factor(Protocol):
    """A factorised tangent."""

    def solve(self, right: Floats) -> Floats:
        """Solution for right-hand sides (N,) or (N, k)."""
        ...


class LinearSolver(Protocol):
    """Numbering, storage and factorisation of the tangent of one mesh.

    Attributes
    ----------
    size : int
        Free displacements N.
    dof : (n, 3) int array
        Number of each nodal displacement, -1 where it is fixed.
    scatter : (m, 78) int array
        Place of each entry of a cell's lower triangle in `data`; entries of fixed
        displacements go to the last place.
    length : int
        Entries of `data`, the last one included.
    """

    size: int
    dof: NDArray[np.int64]
    scatter: NDArray[np.int64]
    length: int

    def blank(self) -> Floats:
        """An array (length,) of any content, to assemble in."""
        ...

    def factorise(self, data: Floats, shift: float = 0.0, *, spent: bool = False) -> Factor:
        """Factor of the tangent plus `shift` times its mean diagonal entry on the diagonal.

        With `spent`, `data` is not needed afterwards and may be overwritten.

        Raises
        ------
        NotPositiveDefiniteError
        """
        ...

    def factorise_indefinite(self, data: Floats) -> Factor:
        """Factor of a tangent that need not be positive definite, with pivoting.

        Raises
        ------
        NotPositiveDefiniteError
            The tangent is singular to the last digit: a pivot is nothing.
        """
        ...


def _number(
    cells: NDArray[np.int64], free: NDArray[np.bool_], order: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Numbers (n, 3) of the free displacements along `order`, and each cell's pairs."""
    numbers = np.full((len(order), 3), -1, dtype=np.int64)
    ordered = free[order]
    numbers[ordered] = np.arange(int(ordered.sum()))
    dof = np.full(free.shape, -1, dtype=np.int64)
    dof[order] = numbers
    cell_dof = dof[cells].reshape(len(cells), 12)
    return dof, cell_dof[:, _ROWS], cell_dof[:, _COLUMNS]


class BandedCholesky:
    """LAPACK's banded Cholesky in the narrowest order found."""

    def __init__(
        self, positions: Floats, cells: NDArray[np.int64], free: NDArray[np.bool_]
    ) -> None:
        order = narrow_order(positions, cells, np.asarray(free.any(axis=1)))
        self.dof, row, column = _number(cells, free, order)
        self.size = int(free.sum())
        kept = (row >= 0) & (column >= 0)
        below = np.abs(row - column)
        self._below = int(below[kept].max(initial=0))
        self._height = stored_height(self._below)
        self.length = self._height * self.size + 1
        # column-major: entry (i, j), i >= j, stands at row i - j of column j
        place = np.minimum(row, column) * self._height + below
        self.scatter = np.where(kept, place, self.length - 1)
        self._idle: list[Floats] = []

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_idle": []}

    def blank(self) -> Floats:
        """An array (length,) of any content: that of a factor that is gone, or a new one."""
        try:
            return self._idle.pop()
        except IndexError:
            return np.empty(self.length)

    def factorise(self, data: Floats, shift: float = 0.0, *, spent: bool = False) -> BandedFactor:
        """In place where `data` is spent; raises NotPositiveDefiniteError."""
        if spent:
            whole = data
        else:
            whole = self.blank()
            whole[:] = data
        band = whole[:-1]
        if shift:
            band[:: self._height] += shift * np.abs(band[:: self._height]).mean()
        band = band.reshape((self._height, self.size), order="F")
        info = lapack.dpbtrf(band, self._below)
        if info != 0:
            raise NotPositiveDefiniteError(f"leading minor {info}")
        result = BandedFactor(band)
        if whole.nbytes <= _REUSED_UP_TO:
            weakref.finalize(result, _lay_by, self._idle, whole).atexit = False
        return result

    def factorise_indefinite(self, data: Floats) -> Factor:
        """LAPACK's banded LU with partial pivoting."""
        below = self._below
        general = np.empty((self.size, 3 * below + 1))
        widen(data[:-1].reshape(self.size, self._height), below, general)
        general = general.T
        pivots, info = lapack.dgbtrf(general, below)
        if info != 0:
            raise NotPositiveDefiniteError(f"zero pivot {info}")
        return BandedLUFactor(general, pivots, below)


def _lay_by(idle: list[Floats], whole: Floats) -> None:
    """Keep the memory of a factor that is gone, unless enough of it lies idle."""
    if len(idle) < _IDLE:
        idle.append(whole)


class BandedLUFactor:
    """A banded LU factor."""

    def __init__(self, band: Floats, pivots: NDArray[np.intc], below: int) -> None:
        self._band, self._pivots, self._below = band, pivots, below

    def solve(self, right: Floats) -> Floats:
        """Solution for right-hand sides (N,) or (N, k)."""
        solution = np.array(right.T, ndmin=2, order="C").T
        lapack.dgbtrs(self._band, self._below, self._pivots, solution)
        return solution[:, 0] if right.ndim == 1 else solution


class BandedFactor:
    """A banded Cholesky factor."""

    def __init__(self, band: Floats) -> None:
        self._columns = band.T

    def solve(self, right: Floats) -> Floats:
        """Solution for right-hand sides (N,) or (N, k)."""
        solution = np.array(right.T, ndmin=2, order="C")
        substitute(self._columns, solution)
        return solution[0] if right.ndim == 1 else solution.T


class SparseLU:
    """SuperLU on the symmetric pattern, minimum degree of A + Aᵀ, diagonal pivots."""

    def __init__(
        self, positions: Floats, cells: NDArray[np.int64], free: NDArray[np.bool_]
    ) -> None:
        self.dof, row, column = _number(cells, free, np.arange(len(free)))
        self.size = int(free.sum())
        kept = (row >= 0) & (column >= 0)
        lower = np.maximum(row, column), np.minimum(row, column)
        keys = np.where(kept, lower[1] * self.size + lower[0], -1)
        unique, inverse = np.unique(keys[kept], return_inverse=True)
        self.length = len(unique) + 1
        self.scatter = np.full(row.shape, self.length - 1)
        self.scatter[kept] = inverse
        i, j = unique % self.size, unique // self.size
        off = i != j
        # the full matrix takes each off-diagonal entry twice
        entry = np.concatenate([np.arange(len(unique)), np.flatnonzero(off)])
        full = coo_matrix(
            (entry + 1.0, (np.concatenate([i, j[off]]), np.concatenate([j, i[off]]))),
            shape=(self.size, self.size),
        ).tocsc()
        self._entry = full.data.astype(np.int64) - 1
        self._indices, self._indptr = full.indices, full.indptr
        self._diagonal = np.flatnonzero(i == j)
        self._rows = i

    def blank(self) -> Floats:
        """A new array (length,)."""
        return np.empty(self.length)

    def factorise(self, data: Floats, shift: float = 0.0, *, spent: bool = False) -> Factor:
        """Overwrites nothing; raises NotPositiveDefiniteError."""
        values = data[:-1]
        if shift:
            values = values.copy()
            values[self._diagonal] += shift * np.abs(values[self._diagonal]).mean()
        try:
            factor = splu(
                self._matrix(values),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:  # SuperLU's word for a zero pivot
            raise NotPositiveDefiniteError(str(error)) from error
        # with pivots on the diagonal, U's diagonal carries the inertia
        if (factor.U.diagonal() <= 0.0).any() or (factor.perm_r != factor.perm_c).any():
            raise NotPositiveDefiniteError("negative pivot")
        return LUFactor(factor)

    def factorise_indefinite(self, data: Floats) -> LUFactor:
        """SuperLU with its threshold pivoting."""
        try:
            return LUFactor(splu(self.matrix(data), permc_spec="MMD_AT_PLUS_A"))
        except RuntimeError as error:
            raise NotPositiveDefiniteError(str(error)) from error

    def matrix(self, data: Floats) -> csc_matrix:
        """The whole symmetric matrix of what was assembled."""
        return self._matrix(data[:-1])

    def _matrix(self, values: Floats) -> csc_matrix:
        return csc_matrix(
            (values[self._entry], self._indices, self._indptr), shape=(self.size, self.size)
        )


class LUFactor:
    """A SuperLU factor."""

    def __init__(self, factor: object) -> None:
        self._factor = factor

    def solve(self, right: Floats) -> Floats:
        """Solution for right-hand sides (N,) or (N, k)."""
        return self._factor.solve(right)  # type: ignore[attr-defined]


class Pardiso(SparseLU):
    """Intel's PARDISO, a supernodal Cholesky: the fastest on large meshes, where installed.

    Analyses the pattern once for each factor that is alive at a time, and keeps the handles of
    those that are not for the next ones. Indefinite tangents are left to SuperLU.
    """

    def __init__(
        self, positions: Floats, cells: NDArray[np.int64], free: NDArray[np.bool_]
    ) -> None:
        if not has_pardiso():
            raise InputError(
                "linear solver: pardiso needs pypardiso; pip install bulgefit[pardiso]"
            )
        super().__init__(positions, cells, free)
        # the lower triangle by columns is the upper one by rows, as PARDISO takes it
        self._upper_indptr = np.concatenate([self._diagonal, [self.length - 1]])
        self._idle: list[Any] = []

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_idle": []}

    def factorise(self, data: Floats, shift: float = 0.0, *, spent: bool = False) -> Factor:
        """Overwrites nothing; raises NotPositiveDefiniteError."""
        values = data[:-1]
        if shift:
            values = values.copy()
            values[self._diagonal] += shift * np.abs(values[self._diagonal]).mean()
        matrix = csr_matrix(
            (values, self._rows, self._upper_indptr), shape=(self.size, self.size), copy=False
        )
        handle = self._idle.pop() if self._idle else _analysed(matrix)
        factor = PardisoFactor(handle, matrix)
        weakref.finalize(factor, self._idle.append, handle)
        try:
            _run(handle, 22, matrix, np.zeros((self.size, 1)))
        except ArithmeticError as error:
            raise NotPositiveDefiniteError(str(error)) from error
        return factor


class PardisoFactor:
    """A factor that PARDISO holds."""

    def __init__(self, handle: Any, matrix: csr_matrix) -> None:
        self._handle, self._matrix = handle, matrix

    def solve(self, right: Floats) -> Floats:
        """Solution for right-hand sides (N,) or (N, k)."""
        columns = np.asfortranarray(right.reshape(len(right), -1))
        return _run(self._handle, 33, self._matrix, columns).reshape(right.shape)


_MKL_DOMAIN_PARDISO = 4  # of mkl_types.h


@cache
def _pardiso() -> Any:
    """pypardiso's handle for symmetric positive definite matrices, unused: one to copy."""
    handle = import_module("pypardiso").PyPardisoSolver(mtype=2)
    handle.set_iparm(1, 1)  # the values below, not the defaults
    handle.set_iparm(2, 2)  # nested dissection
    # on one thread: its own ones crash when it is called by several of ours at once
    handle.libmkl.MKL_Domain_Set_Num_Threads(1, _MKL_DOMAIN_PARDISO)
    return handle


@cache
def has_pardiso() -> bool:
    """True where pypardiso and the library that it needs are installed."""
    try:
        _pardiso()
    except (ImportError, OSError):
        return False
    return True


def _analysed(matrix: csr_matrix) -> Any:
    """A new handle that knows the pattern."""
    handle = copy.copy(_pardiso())
    handle.pt, handle.iparm = handle.pt.copy(), handle.iparm.copy()
    weakref.finalize(handle, _release, copy.copy(handle)).atexit = False
    _run(handle, 11, matrix, np.zeros((matrix.shape[0], 1)))
    return handle


def _release(handle: Any) -> None:
    """Give PARDISO's memory back; `handle` shares its address table with one that is gone."""
    handle.free_memory(everything=True)


def _run(handle: Any, phase: int, matrix: csr_matrix, right: Floats) -> Floats:
    """Analyse (11), factorise (22) or solve (33)."""
    handle.set_phase(phase)
    try:
        return handle._call_pardiso(matrix, right)
    except Exception as error:
        if type(error).__name__ != "PyPardisoError":
            raise
        raise ArithmeticError(str(error)) from error


#: Solvers that can be forced by name.
SOLVERS: dict[str, type[BandedCholesky] | type[SparseLU]] = {
    "banded": BandedCholesky,
    "superlu": SparseLU,
    "pardiso": Pardiso,
}


def make_solver(
    positions: Floats,
    cells: NDArray[np.int64],
    free: NDArray[np.bool_],
    name: str | None = None,
) -> LinearSolver:
    """The solver called `name`, or the one that measured best for the size.

    Parameters
    ----------
    positions : (n, 2) array, mm
    cells : (m, 4) int array
    free : (n, 3) bool array
        True where a nodal displacement is unknown.
    name : str, optional
        A key of `SOLVERS`.
    """
    if name is None:
        name = _best(int(free.sum()))
    one_of(name, SOLVERS, "linear solver")
    return SOLVERS[name](positions, cells, free)


def _best(size: int) -> str:
    """The solver that measured best for so many unknowns."""
    if size <= min(BANDED_UP_TO.values()):  # PARDISO takes a while to look for
        return "banded"
    sparse = "pardiso" if has_pardiso() else "superlu"
    return "banded" if size <= BANDED_UP_TO[sparse] else sparse
