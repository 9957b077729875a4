"""How are the results of DuoDIC and MultiDIC read, one MATLAB file a test?"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, measured_rows
from bulgefit.dic.formats.matlab import cells_of, is_matlab, variables_of
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.errors import InputError

__all__: list[str] = []

# How the toolboxes call the struct, by step and by version: DIC3D, DIC3DPPresults, ...
_START = "DIC3D"


def _recognises(head: Head) -> bool:
    return is_matlab(head) and _struct(head.path) is not None


def _struct(path: Path) -> str | None:
    return next((name for name in sorted(variables_of(path)) if name.startswith(_START)), None)


def _read(path: Path, ask: Ask) -> list[Frame]:
    struct = _struct(path) or _START
    points = cells_of(path, struct, "Points3D")
    vectors = cells_of(path, struct, "Disp", "DispVec")
    if points is None or vectors is None:
        raise InputError(
            f"{path}: {struct} has no Points3D and Disp.DispVec; save the result of the 3D "
            "reconstruction"
        )
    if len(points) != len(vectors):
        raise InputError(
            f"{path}: {struct} has {len(points)} Points3D and {len(vectors)} Disp.DispVec"
        )
    frames = []
    for i, (position, displacement) in enumerate(zip(points, vectors, strict=True), 1):
        if position.ndim != 2 or position.shape[1] != 3 or position.shape != displacement.shape:
            raise InputError(
                f"{path}: {struct}.Points3D{{{i}}} is {position.shape} and Disp.DispVec{{{i}}} "
                f"{displacement.shape}; both must be (points, 3)"
            )
        frame = Frame(
            path=path,
            name=f"{frame_name(path.name)}_{i}",
            position=position * ask.length,
            displacement=displacement * ask.length,
            ids=np.arange(len(position))[:, None],
            has_units=False,
        )
        frames.append(measured_rows(frame, np.zeros(len(position), dtype=bool)))
    return frames


register(
    Format(
        name="duodic",
        system="DuoDIC, MultiDIC (MATLAB .mat)",
        example="struct DIC3D with Points3D{i} and Disp.DispVec{i}",
        recognises=_recognises,
        read=_read,
        lost="NaN",
        positions="current",
        y_down=True,
    )
)
