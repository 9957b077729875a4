"""What numbers do MATLAB files hold? Those up to v7, and v7.3, which is HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.matlab5 import names_of, values_of
from bulgefit.dic.formats.source import Head
from bulgefit.dic.hdf5_apart import Contents, Dataset, read_apart
from bulgefit.dic.registry import one_line
from bulgefit.errors import InputError
from bulgefit.files import open_regular

__all__ = ["arrays_of", "cells_of", "is_matlab", "variables_of"]

Floats = NDArray[np.floating]

_START = b"MATLAB "
_NEWEST = b"MATLAB 7.3"
# Measured fields hardly compress, but masked ones do; 200 MB more is what any machine has.
_COMPRESSION, _SPARE = 4, 200 * 2**20


def is_matlab(head: Head) -> bool:
    """Whether a file begins as MATLAB writes it."""
    return head.data.startswith(_START)


def variables_of(path: Path) -> set[str]:
    """Names of the variables; none where the file is damaged."""
    try:
        if _is_hdf5(path):
            return set(_apart(path, []).names)
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
        return {name: _shown(found) for name, found in _apart(path, names).datasets.items()}
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
    key = "/".join((variable, *keys))
    contents = _apart(path, [key])
    if key in contents.datasets:
        raise InputError(f"{path}: {variable}.{'.'.join(keys)} is not a cell array")
    return [*map(_shown, contents.cells[key])] if key in contents.cells else None


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


def _apart(path: Path, keys: list[str]) -> Contents:
    with open_regular(path) as file:
        return read_apart(file, keys, str(path))


def _shown(dataset: Dataset) -> Floats:
    """An array as MATLAB shows it: HDF5 has the axes the other way round."""
    if "MATLAB_empty" in dataset.attributes:  # it holds the shape in the place of the array
        return np.empty((0, 3))
    return dataset.numbers.astype(np.float64).T


def _load(path: Path, names: list[str]) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            return values_of(file, names, _COMPRESSION * size + _SPARE)
    except ValueError as error:
        raise _damaged(path, error) from None


def _real(value: Any, name: str, path: Path) -> Floats:
    if not isinstance(value, np.ndarray):
        raise InputError(f"{path}: {name} is not an array of real numbers")
    return value.astype(np.float64)


def _damaged(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: damaged MATLAB file ({one_line(error)}); copy it again")
