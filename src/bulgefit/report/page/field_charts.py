"""How is a field without a name drawn? As a disc over the cloth, or a curve with its band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bulgefit.report.numbers import INTERVAL, value_text
from bulgefit.report.page.charts import ticks
from bulgefit.shown import with_unit

__all__ = ["field_chart"]

Floats = NDArray[np.float64]

#: Of a chart of curves, in the units of its drawing.
_WIDTH, _HEIGHT = 300.0, 170.0
#: Cells across a disc of radius 50, and steps of colour up to the largest value, on either side.
_CELLS, _STEPS = 40, 4
#: Standard errors within which a value is not told from zero.
_TOLD = 2.0
#: Places that make a curve; what is drawn of no size at all, against division by zero.
_FEWEST, _NOTHING = 3, 1e-12
#: Degrees at which an angle's axis has numbers.
_ROUND = (0.0, 90.0, 180.0, 270.0)
_AXES = {
    "angle_degree": ("angle from x (°)", 1.0),
    "pressure_bar": ("pressure (bar)", 1.0),
    "time_share": ("share of the test's time (%)", 100.0),
    "strain": ("logarithmic strain (%)", 100.0),
}


def field_chart(found: Mapping[str, Any], semi_axes: Sequence[float]) -> dict[str, Any] | None:
    """A drawing of a field; None of one that has too few places, or whose map was not written.

    Parameters
    ----------
    found : mapping
        As the JSON has it.
    semi_axes : sequence of float, mm
        Of the clamp.
    """
    told = found.get("map")
    if told is None:
        return None
    value, stderr = np.array(told["value"]), np.array(told["stderr"])
    title = with_unit(f"{found['field']}: {found['quantity']}", found["unit"])
    if "x_mm" in told:
        return {"title": title, "disc": _disc(found, value, stderr, np.array(semi_axes))}
    axis = next((name for name in _AXES if name in told), None)
    if axis is None or len({*told[axis]}) < _FEWEST:  # a test may hold one pressure
        return None
    return {"title": title, "curve": _curve(axis, told, value, stderr)}


def _disc(
    found: Mapping[str, Any], value: Floats, stderr: Floats, semi_axes: Floats
) -> dict[str, Any]:
    """Outlines of cells by their colour, on a disc whose larger half axis is 50; y downwards."""
    scale, size = 50.0 / max(semi_axes), 100.0 / _CELLS
    points = scale * np.column_stack([found["map"]["x_mm"], found["map"]["y_mm"]])
    line = -50.0 + size * (0.5 + np.arange(_CELLS))
    cells = np.stack(np.meshgrid(line, -line), axis=-1)
    tree = cKDTree(points)
    near, which = tree.query(cells)
    apart = float(np.median(tree.query(points, k=2)[0][:, 1]))
    inside = np.hypot(*(cells / (scale * semi_axes)).transpose(2, 0, 1)) <= 1.0
    shown = inside & (near <= max(apart, size))
    top = max(abs(float(found["largest"])), _NOTHING)  # which thinned places may not have
    steps = np.ceil(_STEPS * np.minimum(np.abs(value) / top, 1.0)).astype(int)
    steps *= np.where(value > 0.0, 1, -1)
    steps[np.abs(value) < _TOLD * stderr] = 0
    where = [scale * found["where"][name] for name in ("x_mm", "y_mm")]
    return {
        "paths": _paths(np.where(shown, steps[which], _STEPS + 1), size),
        "semi_axes": (scale * semi_axes).tolist(),
        "peak": {"x": round(where[0], 2), "y": round(-where[1], 2)},
        "largest": value_text(found["largest"], found["stderr"]),
        "steps": [f"{top * step / _STEPS:.2g}" for step in range(_STEPS + 1)],
    }


def _paths(steps: NDArray[np.int_], size: float) -> dict[str, str]:
    """The outline of the cells of each step, those of a row that stand together as one."""
    paths: dict[str, str] = {}
    for row, kinds in enumerate(steps):
        ends = np.flatnonzero(np.diff(kinds, prepend=kinds[0] - 1, append=kinds[-1] - 1))
        for start, end in pairwise(ends):
            kind = int(kinds[start])
            if kind <= _STEPS:
                name = "z" if kind == 0 else f"{'p' if kind > 0 else 'n'}{abs(kind)}"
                x, y, width = -50.0 + size * start, -50.0 + size * row, size * (end - start)
                outline = f"M{x:g} {y:g}h{width:g}v{size:g}h{-width:g}z"
                paths[name] = paths.get(name, "") + outline
    return paths


def _curve(axis: str, told: Mapping[str, Any], value: Floats, stderr: Floats) -> dict[str, Any]:
    """Lines with the bands that hold 95 %; one for each of warp and fill where they differ."""
    label, scale = _AXES[axis]
    at, reach = scale * np.array(told[axis]), INTERVAL * stderr
    left, right = float(at.min()), float(at.max())
    low, high = (float(v) for v in (min(0.0, (value - reach).min()), (value + reach).max()))
    high = max(high, low + _NOTHING, 0.0)

    def points(x: Floats, y: Floats) -> list[str]:
        across = _WIDTH * (x - left) / (right - left)
        down = _HEIGHT * (high - y) / (high - low)
        return [f"{a:.1f},{d:.1f}" for a, d in zip(across, down, strict=True)]

    turned = np.array(told.get("from_warp_degree", np.zeros_like(value)))
    lines = []
    for angle in np.unique(turned):
        own = np.flatnonzero(turned == angle)
        own = own[np.argsort(at[own], kind="stable")]
        band = points(at[own], (value + reach)[own])
        lines.append(
            {
                "label": "fill" if angle > 45.0 else "warp",
                "points": points(at[own], value[own]),
                "band": band + points(at[own], (value - reach)[own])[::-1],
            }
        )
    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "label": label,
        "lines": lines,
        "named": len(lines) > 1,
        "ticks_x": [
            {"at": _WIDTH * (t - left) / (right - left), "text": f"{t:g}"}
            for t in (_ROUND if axis == "angle_degree" else ticks(left, right))
        ],
        "ticks_y": [
            {"at": _HEIGHT * (high - t) / (high - low), "text": f"{t:g}"} for t in ticks(low, high)
        ],
    }
