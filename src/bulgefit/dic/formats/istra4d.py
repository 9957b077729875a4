"""How are the HDF5 exports of Istra4D read, one file a step?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, Signal, measured_rows
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.hdf5_apart import HDF5_SIGNATURE, Dataset, read_apart
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError
from bulgefit.files import open_regular

__all__: list[str] = []

_GROUPS = {"coordinates": "coordinate", "displacements": "displacement"}
_CHANNELS = "add_data/analog_channels"
_KEYS = (
    *(f"{group}/{name}_{axis}" for group, name in _GROUPS.items() for axis in "xyz"),
    *(f"{group}/mask" for group in _GROUPS),
    _CHANNELS,
)


def _recognises(head: Head) -> bool:
    if not head.data.startswith(HDF5_SIGNATURE):
        return False
    try:
        with open_regular(head.path) as file:
            return _GROUPS.keys() <= {*read_apart(file, (), str(head.path)).names}
    except (InputError, OSError):
        return False


def _read(path: Path, ask: Ask) -> list[Frame]:
    with open_regular(path) as file:
        found = read_apart(file, _KEYS, str(path)).datasets
    position, without = _vectors(found, "coordinates", path, ask)
    displacement, still = _vectors(found, "displacements", path, ask)
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
        signals=_signals(found.get(_CHANNELS), path),
    )
    return [measured_rows(frame, without | still)]


def _vectors(
    found: dict[str, Dataset], group: str, path: Path, ask: Ask
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Vectors (n, 3) in mm of the grid's cells, NaN where masked, and where that is."""
    columns, masked = [], None
    if f"{group}/mask" in found:
        masked = found[f"{group}/mask"].numbers.ravel() == 0
    for axis in "xyz":
        name = f"{_GROUPS[group]}_{axis}"
        if f"{group}/{name}" not in found:
            raise InputError(f"{path}: {group} has no {name}; export it from a stereo evaluation")
        dataset = found[f"{group}/{name}"]
        values = dataset.numbers.astype(np.float64).ravel()
        if masked is not None:
            if masked.shape != values.shape:
                raise InputError(f"{path}: {group}/mask is not of the shape of {name}")
            # masked cells hold whatever stood in the memory: they take part in no arithmetic
            values[masked] = np.nan
        unit = _text(dataset.unit)
        where = f"{path}: {group}/{name}"
        columns.append(values * (ask.length if unit is None else factor(unit, LENGTH, where)))
    if len({len(values) for values in columns}) > 1:
        raise InputError(f"{path}: the data sets of {group} differ in shape; export it anew")
    vectors = np.column_stack(columns)
    return vectors, np.zeros(len(vectors), dtype=bool) if masked is None else masked


def _signals(channels: Dataset | None, path: Path) -> dict[str, Signal]:
    """The analog channels, each as recorded × factor + offset in its unit."""
    if channels is None:
        return {}
    values = channels.numbers.astype(np.float64).ravel()
    shown = {key: _each(channels, key, len(values)) for key in ("name", "unit", "factor", "offset")}
    signals = {}
    for i, value in enumerate(values):
        name = _text(shown["name"][i]) or f"analog channel {i + 1}"
        scale, offset = shown["factor"][i], shown["offset"][i]
        physical = value * (1.0 if scale is None else _number(scale, path))
        physical += 0.0 if offset is None else _number(offset, path)
        unit = _text(shown["unit"][i])
        signals[name] = Signal(name, name, unit, np.array([physical]), str(path))
    return signals


def _each(dataset: Dataset, key: str, count: int) -> list[Any]:
    """An attribute for each channel; None where there is none."""
    values = dataset.attributes.get(key)
    if values is None:
        return [None] * count
    return values * count if len(values) == 1 else [*values, *[None] * count][:count]


def _number(value: str | float, path: Path) -> float:
    try:
        return float(value)
    except ValueError:
        raise InputError(
            f"{path}: a factor or offset of {_CHANNELS} is no number; export it anew"
        ) from None


def _text(value: Any) -> str | None:
    return None if value is None else str(value).strip(" []") or None


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
