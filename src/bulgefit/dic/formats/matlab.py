"""What numbers do MATLAB files hold? Those up to v7, and v7.3, which is HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.hdf5 import child, largest_size, numbers
from bulgefit.dic.formats.matlab5 import names_of, values_of
from bulgefit.dic.formats.source import Head
from bulgefit.dic.registry import one_line
from bulgefit.errors import InputError

__all__ = ["arrays_of", "cells_of", "is_matlab", "variables_of"]

Floats = NDArray[np.floating]

_START = b"MATLAB "
_NEWEST = b"MATLAB 7.3"


def is_matlab(head: Head) -> bool:
    """Whether a file begins as MATLAB writes it."""
    return head.data.startswith(_START)


def variables_of(path: Path) -> set[str]:
    """Names of the variables; none where the file is damaged."""
    try:
        if _is_hdf5(path):
            import h5py

            with h5py.File(path, "r") as file:
                return {str(name) for name in file}
        with path.open("rb") as opened:
            return set(names_of(opened))
    except Exception:  # a damaged file can raise nearly anything
        return set()


def arrays_of(path: Path, names: list[str]) -> dict[str, Floats]:
    """The named variables that the file has, as MATLAB shows them.

    Raises
    ------
    InputError
        One holds something other than real numbers, or the file is damaged.
    """
    if _is_hdf5(path):
        import h5py

        with _open(path) as file:
            members = {name: child(file, name, path) for name in names}
            return {
                # h5py shows the axes of MATLAB's arrays the other way round
                name: numbers(dataset, name, path).astype(np.float64).T
                for name, dataset in members.items()
                if isinstance(dataset, h5py.Dataset)
            }
    found = _load(path, names)
    return {name: _real(found[name], name, path) for name in names if name in found}


def cells_of(path: Path, variable: str, *keys: str) -> list[Floats] | None:
    """The arrays of a cell array within a struct, such as DIC3D.Disp.DispVec; None without it.

    Raises
    ------
    InputError
        A cell holds something other than real numbers, or the file is damaged.
    """
    if not _is_hdf5(path):
        return _loaded_cells(path, variable, *keys)
    import h5py

    with _open(path) as file:
        member: Any = file
        for key in (variable, *keys):
            member = child(member, key, path) if isinstance(member, h5py.Group) else None
        if member is None:
            return None
        if not isinstance(member, h5py.Dataset) or member.dtype != h5py.ref_dtype:
            raise InputError(f"{path}: {variable}.{'.'.join(keys)} is not a cell array")
        name = f"{variable}.{'.'.join(keys)}"
        cells: list[Floats] = []
        size = 0
        for ref in member[()].ravel(order="F"):
            if "MATLAB_empty" in file[ref].attrs:  # it holds the shape in the place of the array
                cells.append(np.empty((0, 3)))
                continue
            cell = numbers(file[ref], name, path)
            size += cell.nbytes  # many cells may be the same data set
            if size > largest_size(path):
                raise InputError(f"{path}: {name} is larger than its file can hold; it is damaged")
            cells.append(cell.astype(np.float64).T)
        return cells


def _loaded_cells(path: Path, variable: str, *keys: str) -> list[Floats] | None:
    member: Any = _load(path, [variable]).get(variable)
    for key in keys:
        if not isinstance(member, dict) or key not in member:
            return None
        member = member[key]
    name = f"{variable}.{'.'.join(keys)}"
    if not isinstance(member, list):
        raise InputError(f"{path}: {name} is not a cell array")
    return [_real(cell, name, path) for cell in member]


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_NEWEST)) == _NEWEST


def _open(path: Path) -> Any:
    import h5py

    try:
        return h5py.File(path, "r")
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"{path}: damaged MATLAB file ({one_line(error)}); copy it again"
        ) from None


def _load(path: Path, names: list[str]) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            return values_of(file, names, largest_size(path))
    except ValueError as error:
        raise _damaged(path, error) from None


def _real(value: Any, name: str, path: Path) -> Floats:
    if not isinstance(value, np.ndarray):
        raise InputError(f"{path}: {name} is not an array of real numbers")
    return value.astype(np.float64)


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: damaged MATLAB file ({one_line(error)}); copy it again")
