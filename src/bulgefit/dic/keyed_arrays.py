"""What do the named arrays of an npz or HDF5 test mean? One layout serves both."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.registry import Recording
from bulgefit.errors import InputError

__all__ = ["OPTIONAL", "REQUIRED", "need_memory", "recording_from"]

REQUIRED = ("reference", "displacement", "pressure")
OPTIONAL = (
    *("frame", "radius", "thickness", "poisson_ratio", "static_displacement", "time"),
    *("history", "ellipticity", "schedule", "warp_angle"),
)

# Of what else a file holds, so many names are told.
_MOST_NAMES = 20
# More frames than this, of which each costs some time, come from no camera.
_MOST_FRAMES = 50_000


def need_memory(shape: tuple[int, ...], dtype: np.dtype[Any], allowed: int, where: str) -> int:
    """What is left of the memory that a file's arrays may take, after one more.

    An array is copied once, as float32 or float64, and checked with another of its size.

    Raises
    ------
    InputError
        Nothing is left.
    """
    kept = 4 if dtype == np.float32 else 8
    # whole numbers of Python: those of a damaged header may exceed any other
    need = math.prod(int(length) for length in shape) * (dtype.itemsize + 2 * kept)
    if need > allowed:
        raise InputError(
            f"{where} has shape {_shown(shape)}, which takes {need / 1e9:.3g} GB of memory and is "
            "out of all proportion to the file; save it uncompressed, or as float32"
        )
    return allowed - need


def _shown(shape: tuple[int, ...]) -> str:
    return "(" + ", ".join(f"{length:.4g}" for length in shape[:4]) + ")"


def recording_from(arrays: Mapping[str, NDArray[Any]], checksum: str, where: str) -> Recording:
    """Recording of named arrays in mm, MPa and s.

    Where `frame` (N,) is given, `reference` (N, 3) and `displacement` (N, 3) are the points of
    all frames one after the other, and `frame` the index of each one's frame.

    Raises
    ------
    InputError
        A key is missing, or is not what it should be.
    """
    missing = [key for key in REQUIRED if key not in arrays]
    if missing:
        found = ", ".join(map(_name, sorted(arrays)[:_MOST_NAMES])) or "nothing"
        raise InputError(
            f"{where}: not a bulge test, it has no {' and no '.join(missing)}; found {found}"
        )
    for key, array in arrays.items():
        if key in REQUIRED + OPTIONAL and array.dtype.kind not in "fiu":
            raise InputError(f"{where}: {key} holds {array.dtype}, not real numbers")
    if arrays["pressure"].size > _MOST_FRAMES:
        raise InputError(
            f"{where}: {arrays['pressure'].size} pressures; a test of more than {_MOST_FRAMES} "
            "frames is not read, leave frames out"
        )
    recording = Recording(
        pressure=arrays["pressure"],
        checksum=checksum,
        radius=_number(arrays, "radius", where),
        thickness=_number(arrays, "thickness", where),
        ellipticity=_number(arrays, "ellipticity", where),
        poisson_ratio=_number(arrays, "poisson_ratio", where),
        warp_angle=_number(arrays, "warp_angle", where),
        static_displacement=arrays.get("static_displacement"),
        time=arrays.get("time"),
        schedule=arrays.get("schedule"),
        history=_lines(arrays.get("history"), where),
    )
    if "frame" in arrays:
        recording.frames = _split(arrays, where)
        if recording.static_displacement is not None:
            raise InputError(
                f"{where}: static_displacement needs points common to all frames, and `frame` "
                "gives every frame its own; leave one of them out"
            )
    else:
        recording.reference = arrays["reference"]
        recording.displacement = arrays["displacement"]
    return recording


def _lines(history: NDArray[Any] | None, where: str) -> list[str]:
    """The lines of a text that is kept as the bytes of UTF-8, for want of text in HDF5 and npz."""
    if history is None:
        return []
    if history.dtype != np.uint8 or history.ndim != 1:
        raise InputError(f"{where}: history is not the bytes of a text; leave it out")
    text = history.tobytes().decode(errors="replace")
    return ["".join(filter(str.isprintable, line)) for line in text.splitlines()]


def _name(key: str) -> str:
    """The name of an array, on one line whatever it holds."""
    return key if key.isprintable() and len(key) <= 40 else reprlib.repr(key)


def _number(arrays: Mapping[str, NDArray[Any]], key: str, where: str) -> float | None:
    if key not in arrays:
        return None
    if arrays[key].size != 1:
        raise InputError(f"{where}: {key} has shape {arrays[key].shape}; it must be one number")
    return float(arrays[key].reshape(()))


def _split(
    arrays: Mapping[str, NDArray[Any]], where: str
) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    frame, count = arrays["frame"], arrays["pressure"].size
    reference, displacement = arrays["reference"], arrays["displacement"]
    if frame.ndim != 1 or frame.dtype.kind not in "iu":
        raise InputError(f"{where}: frame is {frame.dtype} {frame.shape}; it must be int (points,)")
    if reference.shape != (len(frame), 3) or displacement.shape != (len(frame), 3):
        raise InputError(
            f"{where}: reference {reference.shape} and displacement {displacement.shape} must "
            f"both be ({len(frame)}, 3), one row for each of `frame`"
        )
    if len(frame) and (frame.min() < 0 or frame.max() >= count):
        raise InputError(
            f"{where}: frame runs from {frame.min()} to {frame.max()}, but there are {count} "
            f"pressures; it must lie in 0 to {count - 1}"
        )
    order = np.argsort(frame, kind="stable")
    ends = np.searchsorted(frame[order], np.arange(count), side="right")
    rows = np.split(order, ends)[:count]
    return [(reference[row], displacement[row]) for row in rows]
