"""How is a test read from HDF5? The npz names as data sets, each with its unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import recording_from
from bulgefit.dic.registry import Recording, file_checksum, one_line, reader
from bulgefit.dic.units import LENGTH, PRESSURE, PURE, TIME, factor
from bulgefit.errors import InputError

__all__ = ["read_hdf5"]

_UNITS = {
    "reference": LENGTH,
    "displacement": LENGTH,
    "static_displacement": LENGTH,
    "radius": LENGTH,
    "thickness": LENGTH,
    "pressure": PRESSURE,
    "time": TIME,
    "poisson_ratio": PURE,
    "frame": PURE,
}


@reader(
    "hdf5",
    [".h5", ".hdf5", ".hdf"],
    example="data sets reference, displacement, pressure, each with an attribute unit",
)
def read_hdf5(path: Path) -> Recording:
    """Read the data sets of an HDF5 file, in the units of their `unit` attributes.

    A data set without a unit is in mm, MPa or s.
    """
    import h5py

    if path.is_file() and not h5py.is_hdf5(path):
        raise InputError(f"{path}: not an HDF5 file, or damaged; copy it again")
    try:
        with h5py.File(path, "r") as file:
            arrays = {key: _in_own_units(file[key], key, path) for key in _UNITS if key in file}
            units = {key: _unit(file[key], key) for key in arrays}
            others = {key: np.empty(0) for key in file if key not in _UNITS}
    except InputError:
        raise
    except (KeyError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: damaged HDF5 file ({one_line(error)}); copy it again") from None
    recording = recording_from({**arrays, **others}, file_checksum(path), str(path))
    recording.pressure_unit = units["pressure"]
    return recording


def _in_own_units(dataset: Any, key: str, path: Path) -> NDArray[Any]:
    if getattr(dataset, "shape", None) is None or dataset.dtype.kind not in "fiu":
        raise InputError(f"{path}: {key} is not a data set of real numbers")
    array = np.asarray(dataset[()])
    scale = factor(_unit(dataset, key), _UNITS[key], f"{path}: {key}")
    # a factor of 1 keeps whole numbers whole; a Python float keeps float32
    return array if scale == 1.0 else array * scale


def _unit(dataset: Any, key: str) -> str:
    unit = dataset.attrs.get("unit")
    if unit is None:
        return next(iter(_UNITS[key]))  # bulgefit's own stands first
    return unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
