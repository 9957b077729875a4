"""Where do the curves of a cloth's law stand? Geometry for the templates, which draw it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.report.numbers import INTERVAL
from bulgefit.report.page.charts import ticks

__all__ = ["law_chart"]

Floats = NDArray[np.float64]

#: In the units of the drawing.
_WIDTH, _HEIGHT = 300.0, 190.0
_AXES = ("warp", "fill")


def law_chart(law: Mapping[str, Any]) -> dict[str, Any]:
    """Force (N/mm) along warp and fill against strain (%), with the band that holds 95 %.

    Parameters
    ----------
    law : mapping
        As `bulgefit.gap.law_table.LawTable.to_dict` gives it.
    """
    # from the origin, where there is neither force nor doubt
    strain = np.array([0.0, *law["strain"]])
    curves = [
        (
            np.array([0.0, *law[f"{axis}_N_per_mm"]]),
            INTERVAL * np.array([0.0, *law["stderr"][f"{axis}_N_per_mm"]]),
            float(np.clip(law["reached"][axis], 0.0, strain[-1])),
        )
        for axis in _AXES
    ]
    low, high = _range(strain, curves)
    top = float(strain[-1])

    def points(at: Floats, force: Floats) -> list[str]:
        y = _HEIGHT * (high - np.clip(force, low, high)) / (high - low)
        return [f"{_WIDTH * s / top:.1f},{v:.1f}" for s, v in zip(at, y, strict=True)]

    lines = []
    for axis, (force, reach, reached) in zip(_AXES, curves, strict=True):
        seen = np.append(strain[strain < reached], reached)
        beyond = np.append(reached, strain[strain > reached])
        end = points(seen[-1:], np.interp(seen[-1:], strain, force))[0].split(",")
        lines.append(
            {
                "label": f"{axis}: {100 * law['reached'][axis]:.2g} % reached",
                "points": points(seen, np.interp(seen, strain, force)),
                "beyond": points(beyond, np.interp(beyond, strain, force)),
                "band": points(strain, force + reach) + points(strain, force - reach)[::-1],
                "end": {"x": end[0], "y": end[1]},
            }
        )
    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "lines": lines,
        "ticks_x": [
            {"at": _WIDTH * t / (100.0 * top), "text": f"{t:g}"} for t in ticks(0.0, 100.0 * top)
        ],
        "ticks_y": [
            {"at": _HEIGHT * (high - t) / (high - low), "text": f"{t:g}"} for t in ticks(low, high)
        ],
    }


def _range(strain: Floats, curves: Sequence[tuple[Floats, Floats, float]]) -> tuple[float, float]:
    """Of the forces that are drawn; what only a band beyond the strain reached holds is cut."""
    ends = [0.0]
    for force, reach, reached in curves:
        known = strain <= reached
        ends += [*force, *(force + reach)[known], *(force - reach)[known]]
    return min(ends), max(ends)
