"""How are DaVis' own .vc7 files read? By LaVision's package lvpyio, which is an extra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.base import Ask, Format, register
from bulgefit.dic.formats.frames import Frame, measured_rows
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.registry import one_line
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError

__all__: list[str] = []

_HEIGHT = "TS:Height"


def _recognises(head: Head) -> bool:
    return head.path.suffix.lower() == ".vc7"


def _read(path: Path, ask: Ask) -> list[Frame]:
    field = _field(path)
    if not getattr(field, "is_3c", False) or _HEIGHT not in field.components:
        raise InputError(
            f"{path}: holds no displacement in space with its height ({_HEIGHT}); a bulge needs "
            "the result of a stereo evaluation"
        )
    vectors = field.as_masked_array()
    mask = np.ma.getmaskarray(vectors["u"])
    displacement = np.column_stack([np.ma.getdata(vectors[key]).ravel() for key in "uvw"])
    displacement = displacement * _factor(field.scales.i.unit, "displacement", path, ask)
    frame = Frame(
        path=path,
        name=frame_name(path.name),
        position=_positions(field, path, ask),
        displacement=displacement,
        ids=np.arange(len(displacement))[:, None],
    )
    return [measured_rows(frame, mask.ravel())]


def _field(path: Path) -> Any:
    try:
        import lvpyio
    except ImportError:
        raise InputError(
            f"{path}: .vc7 is read by lvpyio; install bulgefit[davis], or export CSV from DaVis"
        ) from None
    try:
        return lvpyio.read_buffer(str(path))[0]
    except Exception as error:  # a damaged file can raise nearly anything
        raise InputError(f"{path}: not a .vc7 file, or damaged ({one_line(error)})") from None


def _positions(field: Any, path: Path, ask: Ask) -> NDArray[np.float64]:
    """Where the vectors (rows, columns) stand, (n, 3) in mm: in the middle of their cells."""
    rows, columns = field.shape
    axes = []
    for count, grid, scale in (
        (columns, field.grid.x, field.scales.x),
        (rows, field.grid.y, field.scales.y),
    ):
        pixels = (np.arange(count) + 0.5) * grid
        length = _factor(scale.unit, "position", path, ask)
        axes.append((pixels * scale.slope + scale.offset) * length)
    height = field.components[_HEIGHT]
    z = height.planes[0].astype(np.float64) * height.scale.slope + height.scale.offset
    x, y = np.meshgrid(*axes)
    z = z * _factor(height.scale.unit, "height", path, ask)
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def _factor(unit: str, what: str, path: Path, ask: Ask) -> float:
    return factor(unit, LENGTH, f"{path}: the {what}") if unit else ask.length


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
