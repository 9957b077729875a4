"""How is a test read from HDF5? The npz names as data sets, each with its unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.hdf5_apart import HDF5_SIGNATURE, Dataset, read_apart
from bulgefit.dic.keyed_arrays import recording_from
from bulgefit.dic.registry import Recording, reader
from bulgefit.dic.units import ANGLE, LENGTH, PRESSURE, PURE, TIME, factor
from bulgefit.errors import InputError
from bulgefit.files import checksum_of, open_regular

__all__ = ["read_hdf5"]

_UNITS = {
    "reference": LENGTH,
    "displacement": LENGTH,
    "static_displacement": LENGTH,
    "radius": LENGTH,
    "thickness": LENGTH,
    "pressure": PRESSURE,
    "time": TIME,
    "schedule": TIME,
    "ellipticity": PURE,
    "poisson_ratio": PURE,
    "warp_angle": ANGLE,
    "frame": PURE,
    "history": PURE,
}


@reader(
    "hdf5",
    [".h5", ".hdf5", ".hdf"],
    example="data sets reference, displacement, pressure, each with an attribute unit",
)
def read_hdf5(path: Path) -> Recording:
    """Read the data sets of an HDF5 file, in the units of their `unit` attributes.

    A data set without a unit is in mm, MPa, s or degree.
    """
    with open_regular(path) as file:
        if file.read(len(HDF5_SIGNATURE)) != HDF5_SIGNATURE:
            raise InputError(f"{path}: not an HDF5 file, or damaged; copy it again")
        contents = read_apart(file, _UNITS, str(path))
        found = contents.datasets
        # names alone of what else it holds, for the message where something is missing
        arrays = {key: np.empty(0) for key in contents.names if key not in _UNITS}
        arrays |= {key: _in_own_units(dataset, key, path) for key, dataset in found.items()}
        recording = recording_from(arrays, checksum_of(file), str(path))
    recording.pressure_unit = _unit(found["pressure"], "pressure")
    return recording


def _in_own_units(dataset: Dataset, key: str, path: Path) -> NDArray[Any]:
    scale = factor(_unit(dataset, key), _UNITS[key], f"{path}: {key}")
    # a factor of 1 keeps whole numbers whole; a Python float keeps float32
    return dataset.numbers if scale == 1.0 else dataset.numbers * scale


def _unit(dataset: Dataset, key: str) -> str:
    # bulgefit's own stands first
    return next(iter(_UNITS[key])) if dataset.unit is None else dataset.unit
