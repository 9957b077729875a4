"""How is the study's published layout read? Rows of [(n, 6) array in mm, pressure in GPa]."""

from __future__ import annotations

from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import need_memory
from bulgefit.dic.read_npz import READ_HEADER
from bulgefit.dic.registry import Recording, one_line, reader
from bulgefit.dic.safe_pickle import Shell, UnsafePickleError, load_shells, to_array
from bulgefit.dic.units import PRESSURE
from bulgefit.errors import InputError
from bulgefit.files import checksum_of, memory_for, open_regular

__all__ = ["read_study"]

_LAYOUT = "the study's layout is rows of [(n, 6) array x y z dx dy dz in mm, pressure in GPa]"


@reader(
    "study",
    [".npy", ".pkl", ".pickle", ".p"],
    example="rows of [(n, 6) array x y z dx dy dz in mm, pressure in GPa]",
)
def read_study(path: Path) -> Recording:
    """Read a pickled object array (frames, 2), from .npy or a plain pickle, running no code.

    The layout does not say the specimen; radius 100 mm, thickness 0.81 mm and poisson_ratio 0.24
    are those of the study.
    """
    with open_regular(path) as file:
        try:
            rows = _rows(_load(file, path))
            frames, pressure = _frames(rows, memory_for(file), path)
        except UnsafePickleError as refused:
            raise InputError(
                f"{path}: refused, the pickle asks for {one_line(refused)}, which could "
                "run code; only numpy arrays are loaded"
            ) from None
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f"{path}: not a bulge test ({one_line(error)}); {_LAYOUT}") from None
        checksum = checksum_of(file)
    return Recording(
        pressure=np.array(pressure) * PRESSURE["GPa"],
        checksum=checksum,
        frames=frames,
        radius=100.0,
        thickness=0.81,
        poisson_ratio=0.24,
        pressure_unit="GPa",
    )


def _load(file: IO[bytes], path: Path) -> Any:
    magic = np.lib.format.MAGIC_PREFIX
    start = file.read(len(magic))
    file.seek(0)
    if start != magic:
        return load_shells(file)
    dtype = _dtype_of_header(file)
    if not dtype.hasobject:
        raise ValueError(f"the array holds {dtype}, not objects")
    return load_shells(file)


def _dtype_of_header(file: IO[bytes]) -> np.dtype[Any]:
    version = np.lib.format.read_magic(file)
    if version not in READ_HEADER:
        raise ValueError(f"npy version {version[0]}.{version[1]} is not one of 1.0 and 2.0")
    try:
        _, _, dtype = READ_HEADER[version](file)
    except Exception as error:  # a damaged header can raise nearly anything
        raise ValueError(f"damaged header: {one_line(error)}") from None
    return dtype


def _rows(value: Any) -> list[Any]:
    rows = _elements(value)
    if not rows:
        raise ValueError("it has no frames")
    return rows


def _elements(value: Any) -> list[Any]:
    """The elements of a list, a tuple, or the first axis of an object array."""
    if isinstance(value, Shell):
        value = to_array(value)
    if isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim):
        return list(value)
    raise ValueError(f"found {type(value).__name__} where rows should be")


def _frames(
    rows: list[Any], allowed: int, path: Path
) -> tuple[list[tuple[NDArray[Any], NDArray[Any]]], list[float]]:
    frames, pressure = [], []
    for i, row in enumerate(rows):
        cells = _elements(row)
        if len(cells) != 2:
            raise ValueError(f"row {i} has {len(cells)} entries, not 2")
        points, load = to_array(cells[0]), to_array(cells[1])
        if points.ndim != 2 or points.shape[1] != 6 or points.dtype.kind not in "fiu":
            raise ValueError(f"row {i} has points of shape {points.shape}, not (n, 6)")
        if load.size != 1 or load.dtype.kind not in "fiu":
            raise ValueError(f"row {i} has a pressure of shape {load.shape}, not one number")
        # rows may all name one array
        allowed = need_memory(points.shape, points.dtype, allowed, f"{path}: row {i}")
        frames.append((points[:, :3], points[:, 3:]))
        pressure.append(float(load.reshape(())))
    return frames, pressure
