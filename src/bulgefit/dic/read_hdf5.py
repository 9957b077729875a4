"""How is a test read from HDF5? The npz names as data sets, each with its unit.

Only what stands in the file itself is read: links, external storage and virtual data sets could
name any file of the machine, and no checksum would cover that.
"""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import need_memory, recording_from
from bulgefit.dic.registry import Recording, one_line, reader
from bulgefit.dic.units import LENGTH, PRESSURE, PURE, TIME, factor
from bulgefit.errors import InputError
from bulgefit.files import checksum_of, memory_for, open_regular

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
# Names of others that are told where something is missing.
_MOST_OTHERS = 20
# deflate, shuffle, fletcher32, szip, nbit, scale-offset, and h5py's own lzf. Others are loaded as
# code from a folder of plugins.
_FILTERS = {1, 2, 3, 4, 5, 6, 32000}


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

    with open_regular(path) as file:
        if not h5py.is_hdf5(path):
            raise InputError(f"{path}: not an HDF5 file, or damaged; copy it again")
        try:
            arrays, unit = _arrays(file, path)
        except (InputError, MemoryError):
            raise
        except Exception as error:  # a damaged file can raise nearly anything
            raise InputError(
                f"{path}: damaged HDF5 file ({one_line(error)}); copy it again"
            ) from None
        recording = recording_from(arrays, checksum_of(file), str(path))
    recording.pressure_unit = unit
    return recording


def _arrays(file: BinaryIO, path: Path) -> tuple[dict[str, NDArray[Any]], str]:
    """The data sets, and the unit of the pressures."""
    import h5py

    allowed = memory_for(file)
    with h5py.File(file, "r") as archive:
        others = islice((key for key in archive if key not in _UNITS), _MOST_OTHERS)
        arrays = {key: np.empty(0) for key in others}
        unit = ""
        for key in _UNITS:
            if key in archive:
                dataset = _own_dataset(archive, key, path)
                allowed = need_memory(dataset.shape, dataset.dtype, allowed, f"{path}: {key}")
                arrays[key] = _in_own_units(dataset, key, path)
                unit = _unit(dataset, key) if key == "pressure" else unit
    return arrays, unit


def _own_dataset(archive: Any, key: str, path: Path) -> Any:
    """A data set whose numbers stand in the file, in a known form."""
    import h5py

    if not isinstance(archive.get(key, getlink=True), h5py.HardLink):
        raise InputError(f"{path}: {key} is a link, which is not followed; store the array itself")
    dataset = archive[key]
    if getattr(dataset, "shape", None) is None or dataset.dtype.kind not in "fiu":
        raise InputError(f"{path}: {key} is not a data set of real numbers")
    if dataset.external or dataset.is_virtual:
        raise InputError(
            f"{path}: {key} stands in another file, which is not read; store the array itself"
        )
    creation = dataset.id.get_create_plist()
    filters = {creation.get_filter(i)[0] for i in range(creation.get_nfilters())}
    if not filters <= _FILTERS:
        raise InputError(f"{path}: {key} is compressed in an unknown way; use gzip or none")
    # a chunk is unpacked whole, however little of it is asked for
    if dataset.chunks and math.prod(dataset.chunks) > max(dataset.size, 1) * 2 + (1 << 20):
        raise InputError(f"{path}: {key} has chunks far larger than itself; store it anew")
    return dataset


def _in_own_units(dataset: Any, key: str, path: Path) -> NDArray[Any]:
    array = np.asarray(dataset[()])
    scale = factor(_unit(dataset, key), _UNITS[key], f"{path}: {key}")
    # a factor of 1 keeps whole numbers whole; a Python float keeps float32
    return array if scale == 1.0 else array * scale


def _unit(dataset: Any, key: str) -> str:
    unit = dataset.attrs.get("unit")
    if unit is None:
        return next(iter(_UNITS[key]))  # bulgefit's own stands first
    return unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
