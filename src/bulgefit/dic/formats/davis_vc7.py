"""How are DaVis' own .vc7 files read? By LaVision's package lvpyio, which is an extra."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats import vc7_worker
from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, measured_rows
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError

__all__: list[str] = []

# Seconds to start and to read, and bytes a second: files are read in milliseconds, but lvpyio goes
# on for ever with some that are damaged.
_PATIENCE, _SPEED = 10.0, 2e6


def _recognises(head: Head) -> bool:
    return head.path.suffix.lower() == ".vc7"


def _read(path: Path, ask: Ask) -> list[Frame]:
    field = _field(path)
    lengths = {key: _factor(str(field[f"unit_{key}"]), key, path, ask) for key in "xyzi"}
    displacement = field["displacement"].reshape(-1, 3) * lengths["i"]
    frame = Frame(
        path=path,
        name=frame_name(path.name),
        position=_positions(field, lengths),
        displacement=displacement,
        ids=np.arange(len(displacement))[:, None],
    )
    return [measured_rows(frame, field["mask"].ravel())]


def _field(path: Path) -> dict[str, NDArray[Any]]:
    damaged = InputError(f"{path}: not a .vc7 file, or damaged; copy it again, or export CSV")
    seconds = _PATIENCE + path.stat().st_size / _SPEED
    try:
        answer = subprocess.run(
            [sys.executable, vc7_worker.__file__, str(path.resolve())],
            capture_output=True,
            check=True,
            timeout=seconds,
        ).stdout
    except subprocess.CalledProcessError:
        raise damaged from None
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{path}: was not read within {seconds:.0f} s; it is damaged, or the disk or the "
            "machine is slow: try again, copy it again, or export CSV"
        ) from None
    if answer == b"!lvpyio":
        raise InputError(
            f"{path}: .vc7 is read by lvpyio; install bulgefit[davis], or export CSV from DaVis"
        )
    if answer.startswith(b"!"):
        raise InputError(f"{path}: {' '.join(answer[1:].decode(errors='replace').split())}")
    try:
        with np.load(io.BytesIO(answer), allow_pickle=False) as found:
            return dict(found)
    except Exception:  # whatever the other process left
        raise damaged from None


def _positions(field: dict[str, NDArray[Any]], lengths: dict[str, float]) -> NDArray[np.float64]:
    """Where the vectors (rows, columns) stand, (n, 3) in mm: in the middle of their cells."""
    rows, columns = field["height"].shape
    axes = []
    for key, count, grid in zip("xy", (columns, rows), field["grid"], strict=True):
        slope, offset = field[f"line_{key}"]
        axes.append(((np.arange(count) + 0.5) * grid * slope + offset) * lengths[key])
    slope, offset = field["line_z"]
    x, y = np.meshgrid(*axes)
    z = (field["height"] * slope + offset) * lengths["z"]
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def _factor(unit: str, axis: str, path: Path, ask: Ask) -> float:
    what = {"i": "the displacement", "z": "the height"}.get(axis, f"the {axis} axis")
    return factor(unit, LENGTH, f"{path}: {what}") if unit else ask.length


register(
    Format(
        name="davis-vc7",
        system="DaVis / StrainMaster (.vc7, with bulgefit[davis])",
        example="components U0, V0, W0, TS:Height, MASK",
        recognises=_recognises,
        read=_read,
        lost="masked",
        positions="reference",
    )
)
