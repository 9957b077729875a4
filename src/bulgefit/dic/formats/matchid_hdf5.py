"""How are MatchID's HDF5 exports read, one file a test?"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, Signal, measured_rows
from bulgefit.dic.formats.matchid import DISPLACEMENT
from bulgefit.dic.formats.names import column
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.hdf5_apart import HDF5_SIGNATURE, Dataset, read_apart
from bulgefit.errors import InputError
from bulgefit.files import open_regular

__all__: list[str] = []

Floats = NDArray[np.floating]

_ROOT = "DIC Data"
# Each is (steps, points), in the order of x, y, z.
_POINTS = f"{_ROOT}/Point Data"
_POSITION = tuple(f"{_POINTS}/{name}" for name in "XYZ")
_DISPLACEMENT = tuple(f"{_POINTS}/{name}" for name in DISPLACEMENT)
# Column and row (points, 2) in the reference image.
_PIXELS = f"{_ROOT}/Mapping Data/Spatial - Point Locations"
# What was recorded at each step.
_STEPS = f"{_ROOT}/Temporal Data"
_RECORDED = ("Force", "Time", "Pressure")


def _recognises(head: Head) -> bool:
    if not head.data.startswith(HDF5_SIGNATURE):
        return False
    try:
        with open_regular(head.path) as file:
            return _ROOT in read_apart(file, (), str(head.path)).names
    except (InputError, OSError):
        return False


def _read(path: Path, ask: Ask) -> list[Frame]:
    recorded = dict.fromkeys((*_RECORDED, *([ask.signal] if ask.signal else [])))
    keys = [*_POSITION, *_DISPLACEMENT, _PIXELS, *(f"{_STEPS}/{name}" for name in recorded)]
    with open_regular(path) as file:
        found = read_apart(file, keys, str(path)).datasets
    position, displacement = (
        np.stack([_steps(found, key, path) for key in keys], axis=-1) * ask.length
        for keys in (_POSITION, _DISPLACEMENT)
    )
    steps, points = position.shape[:2]
    pixels = _pixels(found, points, path)
    frames = []
    for i in range(steps):
        frame = Frame(
            path=path,
            name=f"{frame_name(path.name)}_{i + 1}",
            position=position[i],
            displacement=displacement[i],
            ids=np.arange(points)[:, None],
            pixels=pixels,
            signals=_signals(found, [*recorded], i, steps, path),
            has_units=False,
        )
        zero = np.asarray(~np.hstack([position[i], displacement[i]]).any(axis=1))
        frames.append(measured_rows(frame, zero))
    return frames


def _steps(found: dict[str, Dataset], key: str, path: Path) -> Floats:
    """One component at every step, (steps, points)."""
    if key not in found:
        raise InputError(f"{path}: has no {key!r}; export it from a stereo evaluation")
    values = found[key].numbers.astype(np.float64)
    if values.ndim != 2 or values.shape != found[_POSITION[0]].numbers.shape:
        raise InputError(
            f"{path}: {key!r} is {values.shape}; each must be (steps, points), of one shape"
        )
    return values


def _pixels(found: dict[str, Dataset], points: int, path: Path) -> Floats | None:
    """Rows of the points in the reference image."""
    if _PIXELS not in found:
        return None
    values = found[_PIXELS].numbers
    if values.ndim != 2 or len(values) != points or values.shape[1] < 2:
        raise InputError(f"{path}: {_PIXELS!r} is {values.shape}, not two numbers a point")
    return values[:, 1].astype(np.float64)


def _signals(
    found: dict[str, Dataset], names: list[str], step: int, steps: int, path: Path
) -> dict[str, Signal]:
    signals = {}
    for name in names:
        dataset = found.get(f"{_STEPS}/{name}")
        if dataset is not None and dataset.numbers.size == steps:
            known = column(name, dataset.unit)
            value = dataset.numbers.astype(np.float64).ravel()[step : step + 1]
            signals[name] = Signal(name, known.quantity, known.unit, value, str(path))
    return signals


register(
    Format(
        name="matchid-hdf5",
        system="MatchID (HDF5, one file a test)",
        example="DIC Data/Point Data/X, ..., Out-Of-Plane: W; DIC Data/Temporal Data/Force",
        recognises=_recognises,
        read=_read,
        lost="NaN, or all zero",
        positions="current",
        y_down=True,
    )
)
