"""How are VIC-3D's MATLAB exports read, one file a frame?"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, measured_rows
from bulgefit.dic.formats.matlab import arrays_of, is_matlab, variables_of
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.errors import InputError

__all__: list[str] = []

Floats = NDArray[np.floating]

_POSITION, _DISPLACEMENT = ("X", "Y", "Z"), ("U", "V", "W")
_NEEDED = (*_POSITION, *_DISPLACEMENT)
_OTHERS = ("sigma", "x", "y")
# Each area of interest has matrices of its own, told apart by a number behind their names.
_AREA = re.compile(r"X(_?\d*)")


def _recognises(head: Head) -> bool:
    return is_matlab(head) and bool(_areas(variables_of(head.path)))


def _areas(names: Iterable[str]) -> list[str]:
    """What stands behind the names of each area's matrices."""
    known = {*names}
    ends = sorted(found[1] for name in known if (found := _AREA.fullmatch(name)))
    return [end for end in ends if known >= {f"{name}{end}" for name in _NEEDED}]


def _read(path: Path, ask: Ask) -> list[Frame]:
    areas = _areas(variables_of(path))
    arrays = arrays_of(path, [f"{name}{end}" for end in areas for name in (*_NEEDED, *_OTHERS)])
    parts = [_area(arrays, end, path) for end in areas]
    if not parts:
        raise InputError(f"{path}: lacks one of the matrices {', '.join(_NEEDED)}; export them all")
    columns = {
        name: np.concatenate([part[name] for part in parts])
        for name in parts[0]
        if all(name in part for part in parts)
    }
    position, displacement = (
        np.column_stack([columns[name] for name in names]) * ask.length
        for names in (_POSITION, _DISPLACEMENT)
    )
    lost = np.asarray(~np.hstack([position, displacement]).any(axis=1))
    if "sigma" in columns:
        lost |= columns["sigma"] == -1
    frame = Frame(
        path=path,
        name=frame_name(path.name),
        position=position,
        displacement=displacement,
        ids=np.arange(len(position))[:, None],
        pixels=columns.get("y"),
        has_units=False,
    )
    return [measured_rows(frame, lost)]


def _area(arrays: dict[str, Floats], end: str, path: Path) -> dict[str, Floats]:
    """The matrices of one area, each in one row, by their names without its number."""
    found = {
        name: arrays[f"{name}{end}"] for name in (*_NEEDED, *_OTHERS) if f"{name}{end}" in arrays
    }
    if len({matrix.shape for matrix in found.values()}) > 1:
        raise InputError(f"{path}: its matrices differ in shape; export it anew")
    return {name: matrix.ravel() for name, matrix in found.items()}


register(
    Format(
        name="vic3d-mat",
        system="VIC-3D (MATLAB .mat)",
        example="matrices X, Y, Z, U, V, W, sigma; with several areas X_0, X_1, ...",
        recognises=_recognises,
        read=_read,
        lost="sigma -1, or all zero",
        positions="reference",
    )
)
