"""How is a bulge test written? As npz or HDF5, by the suffix."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError, needed
from bulgefit.files import as_path, atomic_write_bytes, check_output

__all__ = ["check_written", "write_test"]

_SUFFIXES = (".npz", ".h5", ".hdf5")
_UNITS = {
    "reference": "mm",
    "displacement": "mm",
    "static_displacement": "mm",
    "radius": "mm",
    "thickness": "mm",
    "pressure": "MPa",
    "time": "s",
    "schedule": "s",
    "ellipticity": "1",
    "poisson_ratio": "1",
    "warp_angle": "degree",
    "frame": "1",
    "history": "1",
}


def write_test(test: BulgeTest, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a test so that `read_test` gives it back; the file appears whole or not at all.

    Parameters
    ----------
    test : BulgeTest
    path : path
        Ends in .npz, .h5 or .hdf5. The same test always gives the same bytes.
    force : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    InputError
        The suffix is unknown, the file exists, or it cannot be written.
    """
    suffix = _suffix(path)
    needed(test, BulgeTest, "a bulge test")
    check_output(path, force)
    # encoded in memory first: a full disk is then one plain error, not one inside an archive
    content = (_npz if suffix == ".npz" else _hdf5)(_arrays(test))
    atomic_write_bytes(path, content, force)


def check_written(path: str | os.PathLike[str], force: bool = False) -> Path:
    """Refuse the file of a test that cannot be written, before the work for it.

    Parameters
    ----------
    path, force
        As of `write_test`, as is what is raised.

    Returns
    -------
    Path
        See `check_output`.
    """
    _suffix(path)
    return check_output(path, force)


def _suffix(path: str | os.PathLike[str]) -> str:
    """The suffix of a file of a test; InputError where it is none."""
    suffix = as_path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(f"{path}: a test is written as {', '.join(_SUFFIXES)}; choose one of them")
    return suffix


def _arrays(test: BulgeTest) -> dict[str, NDArray[Any]]:
    arrays: dict[str, Any] = {
        "pressure": test.pressure,
        "radius": np.float64(test.radius),
        "thickness": np.float64(test.thickness),
        "poisson_ratio": np.float64(test.poisson_ratio),
    }
    if len(test.blocks) == 1 and len(test.blocks[0].frames) == test.n_frames:
        arrays["reference"] = test.blocks[0].reference
        arrays["displacement"] = test.blocks[0].displacement
    else:
        frames = [test.frame(i) for i in range(test.n_frames)]
        arrays["reference"] = np.concatenate([reference for reference, _ in frames])
        arrays["displacement"] = np.concatenate([moved for _, moved in frames])
        arrays["frame"] = np.repeat(np.arange(len(frames)), [len(moved) for _, moved in frames])
    if test.ellipticity:
        arrays["ellipticity"] = np.float64(test.ellipticity)
    if test.warp_angle is not None:
        arrays["warp_angle"] = np.float64(test.warp_angle)
    if test.static_displacement is not None:
        arrays["static_displacement"] = test.static_displacement
    if test.time is not None:
        arrays["time"] = test.time
        if test.schedule is not None and not np.array_equal(test.schedule, test.time):
            arrays["schedule"] = test.schedule
    if test.history:
        arrays["history"] = np.frombuffer("\n".join(test.history).encode(), dtype=np.uint8)
    return arrays


def _npz(arrays: dict[str, NDArray[Any]]) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _hdf5(arrays: dict[str, NDArray[Any]]) -> bytes:
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        for key, array in arrays.items():
            file.create_dataset(key, data=array).attrs["unit"] = _UNITS[key]
    return buffer.getvalue()
