"""How do the figures look, and how do they reach the disk? Matplotlib without global state."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError, needed
from bulgefit.files import as_path, atomic_write_bytes, check_output

__all__ = [
    "FONT",
    "check_prediction",
    "figure_target",
    "finished",
    "frame_index",
    "label",
    "outlined",
    "panels",
    "point_spacing",
    "save",
    "spread",
]

#: Font size of text, points.
FONT = 10

_FORMATS = {".png": {"Software": None}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None}}


def figure_target(path: str | os.PathLike[str], force: bool) -> Path:
    """Refuse a figure that cannot be written, before it is drawn."""
    suffix = as_path(path).suffix.lower()
    if suffix not in _FORMATS:
        raise InputError(f"{path}: a figure ends in {', '.join(_FORMATS)}")
    return check_output(path, force)


def save(figure: Any, path: str | os.PathLike[str], force: bool) -> None:
    """Write a figure; it appears whole or not at all, and the same figure gives the same file."""
    suffix = Path(path).suffix.lower()
    _as_written(figure)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=suffix[1:], dpi=150, metadata=_FORMATS[suffix])
    atomic_write_bytes(path, buffer.getvalue(), force)


def panels(
    path: str | os.PathLike[str] | None, force: bool, size: tuple[float, float], *shape: int
) -> tuple[Any, Any]:
    """A figure of a size (inches) and its panels, unless the file cannot be written."""
    from matplotlib.figure import Figure

    if path is not None:
        figure_target(path, force)
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(*shape, squeeze=False)


def finished(figure: Any, path: str | os.PathLike[str] | None, force: bool) -> Any:
    """The figure, written where a path is given."""
    if path is not None:
        save(figure, path, force)
    return figure


def label(panel: Any, x: str, y: str) -> None:
    """What the axes show, in the size of all figures, over a pale grid."""
    panel.set_xlabel(x, fontsize=FONT)
    panel.set_ylabel(y, fontsize=FONT)
    panel.tick_params(labelsize=FONT - 1)
    panel.grid(visible=True, color="0.9")
    panel.set_axisbelow(True)


def outlined(panel: Any, semi_axes: NDArray[np.floating]) -> None:
    """The clamp about a map, with the limits of the map a little beyond it; semi-axes in mm."""
    from matplotlib.patches import Ellipse

    a, b = (float(axis) for axis in semi_axes)
    panel.add_patch(Ellipse((0, 0), 2.0 * a, 2.0 * b, fill=False, color="0.4", linewidth=0.8))
    panel.set_aspect("equal")
    panel.set_facecolor("0.93")
    panel.set_xlim(-1.05 * a, 1.05 * a)
    panel.set_ylim(-1.05 * b, 1.05 * b)


def frame_index(frame: int, count: int) -> int:
    """A frame counted from 0, where it may be counted from the end; InputError where none is."""
    try:
        return range(count)[frame]
    except (IndexError, TypeError):
        raise InputError(
            f"frame {frame!r}: the test has frames 0 to {count - 1} (-1 is the last)"
        ) from None


def _as_written(figure: Any) -> None:
    """Let no name of a test be taken for a formula, nor stop a font by what is no letter."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        written = text.get_text()
        if "$" in written:  # not where there is nothing yet: ticks may be formulas
            text.set_parse_math(False)
        text.set_text(written.encode(errors="backslashreplace").decode())


def check_prediction(test: BulgeTest, prediction: tuple[NDArray[np.floating], ...]) -> None:
    """Refuse a prediction whose arrays do not match the blocks of the test."""
    ours = [block.displacement.shape for block in test.blocks]
    given = needed(prediction, Iterable, "what bulgefit.predict(...).blocks has")
    theirs = [np.shape(array) for array in given]
    if ours != theirs:
        raise InputError(
            f"prediction: its arrays {theirs} must match the blocks of {test.name}, {ours}"
        )


def point_spacing(reference: NDArray[np.floating]) -> float:
    """Median distance of a point to its nearest neighbour in the plane, mm; inf for one point."""
    from scipy.spatial import KDTree

    if len(reference) < 2:
        return np.inf
    plane = reference[:, :2]
    return float(np.median(KDTree(plane).query(plane, k=2)[0][:, 1]))


def spread(candidates: NDArray[np.intp], pressure: NDArray[np.floating], count: int) -> list[int]:
    """At most `count` of the candidate frames, at pressures spread evenly up to the highest."""
    if len(candidates) == 0:
        return []
    loads = pressure[candidates]
    wanted = np.linspace(0, loads.max(), count + 1)[1:]
    chosen = {int(candidates[np.abs(loads - p).argmin()]) for p in wanted}
    return sorted(chosen, key=lambda frame: float(pressure[frame]))
