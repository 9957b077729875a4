"""How are the HDF5 exports of Istra4D read, one file a step?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, Signal, measured_rows
from bulgefit.dic.formats.hdf5 import SIGNATURE, child, numbers
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.registry import one_line
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError

__all__: list[str] = []

_GROUPS = {"coordinates": "coordinate", "displacements": "displacement"}


def _recognises(head: Head) -> bool:
    import h5py

    if not head.data.startswith(SIGNATURE):
        return False
    try:
        with h5py.File(head.path, "r") as file:
            # a link into another file is not looked behind
            links = [file.get(name, getlink=True) for name in _GROUPS]
            return all(isinstance(link, h5py.HardLink) for link in links)
    except (OSError, RuntimeError, ValueError):
        return False


def _read(path: Path, ask: Ask) -> list[Frame]:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            position, without = _vectors(file, "coordinates", path, ask)
            displacement, still = _vectors(file, "displacements", path, ask)
            signals = _signals(file, path)
    except InputError:
        raise
    except (KeyError, RuntimeError, ValueError) as error:
        raise InputError(f"{path}: damaged HDF5 file ({one_line(error)}); copy it again") from None
    if position.shape != displacement.shape:
        raise InputError(
            f"{path}: has {len(position)} coordinates and {len(displacement)} displacements; "
            "export it anew"
        )
    frame = Frame(
        path=path,
        name=frame_name(path.name),
        position=position,
        displacement=displacement,
        ids=np.arange(len(position))[:, None],
        signals=signals,
    )
    return [measured_rows(frame, without | still)]


def _vectors(
    file: Any, group: str, path: Path, ask: Ask
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Vectors (n, 3) in mm of the grid's cells, NaN where masked, and where that is."""
    inside = child(file, group, path)
    columns, masked = [], None
    mask = child(inside, "mask", path)
    if mask is not None:
        masked = numbers(mask, f"{group}/mask", path).ravel() == 0
    for axis in "xyz":
        name = f"{_GROUPS[group]}_{axis}"
        dataset = child(inside, name, path)
        if dataset is None:
            raise InputError(f"{path}: {group} has no {name}; export it from a stereo evaluation")
        values = numbers(dataset, f"{group}/{name}", path).astype(np.float64).ravel()
        if masked is not None:
            if masked.shape != values.shape:
                raise InputError(f"{path}: {group}/mask is not of the shape of {name}")
            # masked cells hold whatever stood in the memory: they take part in no arithmetic
            values[masked] = np.nan
        unit = _text(dataset.attrs.get("unit"))
        where = f"{path}: {group}/{name}"
        columns.append(values * (ask.length if unit is None else factor(unit, LENGTH, where)))
    if len({len(values) for values in columns}) > 1:
        raise InputError(f"{path}: the data sets of {group} differ in shape; export it anew")
    vectors = np.column_stack(columns)
    return vectors, np.zeros(len(vectors), dtype=bool) if masked is None else masked


def _signals(file: Any, path: Path) -> dict[str, Signal]:
    """The analog channels, each as recorded × factor + offset in its unit."""
    added = child(file, "add_data", path)
    dataset = None if added is None else child(added, "analog_channels", path)
    if dataset is None:
        return {}
    values = numbers(dataset, "analog_channels", path).astype(np.float64).ravel()
    shown = {key: _each(dataset, key, len(values)) for key in ("name", "unit", "factor", "offset")}
    signals = {}
    for i, value in enumerate(values):
        name = _text(shown["name"][i]) or f"analog channel {i + 1}"
        scale, offset = shown["factor"][i], shown["offset"][i]
        physical = value * (1.0 if scale is None else float(scale))
        physical += 0.0 if offset is None else float(offset)
        unit = _text(shown["unit"][i])
        signals[name] = Signal(name, name, unit, np.array([physical]), str(path))
    return signals


def _each(dataset: Any, key: str, count: int) -> list[Any]:
    """An attribute for each channel; None where there is none."""
    found = dataset.attrs.get(key)
    if found is None:
        return [None] * count
    values = np.atleast_1d(found).ravel().tolist()
    return values * count if len(values) == 1 else [*values, *[None] * count][:count]


def _text(value: Any) -> str | None:
    if value is None:
        return None
    text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
    return text.strip(" []") or None


register(
    Format(
        name="istra4d",
        system="Istra4D (HDF5, one file a step)",
        example="groups coordinates/, displacements/ with mask, add_data/analog_channels",
        recognises=_recognises,
        read=_read,
        lost="mask 0",
        positions="reference",
    )
)
