"""What do the diagnosis's figures share? The steps of the explanation, maps of points."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.gap.data import Data
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.regress import Regression
from bulgefit.report import _figure

__all__ = [
    "COMPONENTS",
    "SIGNED",
    "acting_on",
    "colour_bar",
    "data_of",
    "draw_points",
    "frames_of",
    "limit_of",
    "outer_ticks",
    "residual_of",
    "rms",
    "with_causes",
]

Floats = NDArray[np.float64]

COMPONENTS = ("dx", "dy", "dz")
#: Colours of signed fields, told apart by colour-blind readers.
SIGNED = "PuOr_r"

_PIXELS = 160  # of a map, each way
_SHARE = 98.0  # percentile of |value| at which colours end


def data_of(diagnosis: Diagnosis) -> list[Data]:
    """Specimens with their noise."""
    return [p.data for p in diagnosis.prepared]


def acting_on(groups: Iterable[Owned], index: int) -> list[str]:
    """Effects of a test among groups: the cloth's, and its own."""
    return [group.effect for group in groups if group.specimen in (None, index)]


def with_causes(diagnosis: Diagnosis, index: int, most: int = 2) -> str:
    """What the final model of a test holds, for titles."""
    effects = acting_on(diagnosis.explanation.groups, index)
    if not effects:
        return "moduli alone"
    more = f" and {len(effects) - most} more" if len(effects) > most else ""
    return f"with {' + '.join(effects[:most])}{more}"


def residual_of(data: Data, fit: Regression, index: int) -> Floats:
    """Measured minus modelled, mm; NaN where unused."""
    modelled = fit.predictions[index].displacement
    return np.where(data.used, data.specimen.measured - modelled, np.nan)


def frames_of(data: Data, count: int) -> list[int]:
    """Frames with used values at pressures spread up to the highest."""
    seen = np.flatnonzero(data.used.any(axis=(1, 2)))
    return _figure.spread(seen, data.specimen.recorded, count)


def limit_of(*fields: Floats) -> float:
    """Where the colours of signed fields end, mm."""
    values = np.abs(np.concatenate([np.ravel(f) for f in fields]))
    values = values[np.isfinite(values)]
    return max(float(np.percentile(values, _SHARE)) if len(values) else 0.0, 1e-9)


def rms(values: Floats) -> str:
    """Root mean square of what is known, as text."""
    known = values[np.isfinite(values)]
    return f"rms {np.sqrt(np.mean(known**2)):.3g} mm" if len(known) else "not measured"


def draw_points(panel: Any, data: Data, values: Floats, low: float, high: float, cmap: str) -> Any:
    """A map: everywhere the value of the nearest point, nothing where that one is far or unknown.

    The panel has ticks only after `outer_ticks`.
    """
    from scipy.spatial import KDTree

    test, points = data.specimen.test, data.specimen.reference[:, :2]
    reach = 0.9 * min(_figure.point_spacing(data.specimen.reference), 0.3 * test.radius)
    a, b = test.semi_axes
    pixels = (np.arange(_PIXELS) + 0.5 - 0.5 * _PIXELS) / (0.5 * _PIXELS)
    away, nearest = KDTree(points).query(np.stack(np.meshgrid(a * pixels, b * pixels), axis=-1))
    drawn = panel.imshow(
        np.where(away < reach, values[nearest], np.nan), cmap=cmap, vmin=low, vmax=high,
        origin="lower", extent=(-a, a, -b, b), interpolation="nearest",
    )  # fmt: skip
    _figure.outlined(panel, test.semi_axes)
    panel.set_xticks([])
    panel.set_yticks([])
    return drawn


def outer_ticks(panels: NDArray[Any], semi_axes: Floats) -> None:
    """Ticks and labels for the first column and the last row of maps; semi-axes in mm."""
    along_x, along_y = ([-a, -0.5 * a, 0.0, 0.5 * a, a] for a in semi_axes.tolist())
    for panel in panels[:, 0]:
        panel.set_yticks(along_y, [f"{t:g}" for t in along_y])
        panel.set_ylabel("y (mm)", fontsize=_figure.FONT)
    for panel in panels[-1]:
        panel.set_xticks(along_x, [f"{t:g}" for t in along_x])
        panel.set_xlabel("x (mm)", fontsize=_figure.FONT)
    for panel in (*panels[:, 0], *panels[-1]):
        panel.tick_params(labelsize=_figure.FONT - 2)


def colour_bar(
    figure: Any,
    drawn: Any,
    panels: Iterable[Any],
    label: str,
    extend: str = "both",
    *,
    ticks: int = 5,
    **where: Any,
) -> None:
    """A colour bar for some panels, with so many intervals between ticks at most."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(
        drawn, ax=list(panels), extend=extend, ticks=MaxNLocator(ticks), **{"pad": 0.02, **where}
    )
    bar.set_label(label, fontsize=_figure.FONT)
    bar.ax.tick_params(labelsize=_figure.FONT - 1)
