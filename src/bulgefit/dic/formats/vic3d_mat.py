"""How are VIC-3D's MATLAB exports read, one file a frame?"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, measured_rows
from bulgefit.dic.formats.matlab import arrays_of, is_matlab, variables_of
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.errors import InputError

__all__: list[str] = []

_POSITION, _DISPLACEMENT = ("X", "Y", "Z"), ("U", "V", "W")


def _recognises(head: Head) -> bool:
    return is_matlab(head) and variables_of(head.path) >= {*_POSITION, *_DISPLACEMENT}


def _read(path: Path, ask: Ask) -> list[Frame]:
    arrays = arrays_of(path, [*_POSITION, *_DISPLACEMENT, "sigma", "x", "y"])
    missing = [name for name in (*_POSITION, *_DISPLACEMENT) if name not in arrays]
    if missing:
        raise InputError(f"{path}: has no matrix {missing[0]}; export X, Y, Z, U, V, W and sigma")
    if len({array.shape for array in arrays.values()}) > 1:
        raise InputError(f"{path}: its matrices differ in shape; export it anew")
    position, displacement = (
        np.column_stack([arrays[name].ravel() for name in names]) * ask.length
        for names in (_POSITION, _DISPLACEMENT)
    )
    lost = np.asarray(~np.hstack([position, displacement]).any(axis=1))
    if "sigma" in arrays:
        lost |= arrays["sigma"].ravel() == -1
    frame = Frame(
        path=path,
        name=frame_name(path.name),
        position=position,
        displacement=displacement,
        ids=np.arange(len(position))[:, None],
        pixels=arrays["y"].ravel() if "y" in arrays else None,
        has_units=False,
    )
    return [measured_rows(frame, lost)]


register(
    Format(
        name="vic3d-mat",
        system="VIC-3D (MATLAB .mat)",
        example="matrices X, Y, Z, U, V, W, sigma",
        recognises=_recognises,
        read=_read,
        lost="sigma -1, or all zero",
        positions="reference",
    )
)
