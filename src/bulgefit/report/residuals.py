"""Where does the model miss? Maps of the residual by component and pressure."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import needed
from bulgefit.report import _figure

__all__ = ["plot_residuals"]

#: Rows of maps.
PRESSURES = 4

#: Points above which a map shows means over square bins.
POINTS_DRAWN = 4000

_BINS = 80
_SHARE = 98.0  # percentile of |residual| at which the colours end


def plot_residuals(
    test: BulgeTest,
    prediction: tuple[NDArray[np.floating], ...],
    path: str | os.PathLike[str] | None = None,
    *,
    label: str = "model",
    force: bool = False,
) -> Any:
    """Draw maps of measured minus modelled displacement, for up to four pressures.

    Each component has its own colours, the same at every pressure, ending at the 98th percentile
    of the residuals that are drawn. Where a frame has more than 4000 points, means over square
    bins are drawn. The root mean square over all points of the frame stands on each map.

    Parameters
    ----------
    test : BulgeTest
    prediction : tuple of (k, n, 3) arrays, mm
        Modelled displacements, one array for every block of the test.
    path : path, optional
        A .png, .pdf or .svg; by default nothing is written.
    label : str
        What the model is, for the title.
    force : bool
        Whether a file that exists may be replaced.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        The prediction does not match the test, or the file cannot be written.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    if path is not None:
        _figure.figure_target(path, force)
    needed(test, BulgeTest, "a bulge test")
    _figure.check_prediction(test, prediction)
    frames = _frames(test, prediction)
    figure = Figure(figsize=(11, 3.4 * len(frames) + 1.4), layout="constrained")
    panels = figure.subplots(len(frames), 3, squeeze=False, sharex=True, sharey=True)
    for component, name in enumerate(("dx", "dy", "dz")):
        values = np.concatenate([residual[:, component] for _, _, residual in frames])
        values = np.abs(values[np.isfinite(values)])
        limit = max(float(np.percentile(values, _SHARE)) if len(values) else 0.0, 1e-12)
        column = panels[:, component]
        for panel, (frame, reference, residual) in zip(column, frames, strict=True):
            drawn = _map(panel, reference, residual[:, component], limit, test.semi_axes)
            panel.set_title(
                f"{name} at {10 * test.pressure[frame]:.3g} bar, {_rms(residual[:, component])}",
                fontsize=_figure.FONT,
            )
            panel.tick_params(labelsize=_figure.FONT - 1)
        bar = figure.colorbar(
            drawn, ax=list(column), location="bottom", extend="both", shrink=0.85, pad=0.02,
            aspect=30, ticks=MaxNLocator(5, symmetric=True),
        )  # fmt: skip
        bar.set_label(f"{name}, measured - {label} (mm)", fontsize=_figure.FONT)
        bar.ax.tick_params(labelsize=_figure.FONT - 1)
        column[-1].set_xlabel("x (mm)", fontsize=_figure.FONT)
    for panel in panels[:, 0]:
        panel.set_ylabel("y (mm)", fontsize=_figure.FONT)
    figure.suptitle(f"{test.name}: measured minus {label}", fontsize=_figure.FONT + 2)
    return _figure.finished(figure, path, force)


Frame = tuple[int, NDArray[np.floating], NDArray[np.floating]]


def _frames(test: BulgeTest, prediction: tuple[NDArray[np.floating], ...]) -> list[Frame]:
    """Index, reference and residual of the frames to draw."""
    at = {
        int(frame): (b, row)
        for b, block in enumerate(test.blocks)
        for row, frame in enumerate(block.frames)
        if block.measured[row].any()
    }
    candidates = np.array(sorted(at), dtype=np.intp)
    frames = []
    for frame in _figure.spread(candidates, test.pressure, PRESSURES):
        b, row = at[frame]
        block = test.blocks[b]
        frames.append((frame, block.reference, block.displacement[row] - prediction[b][row]))
    return frames


def _map(
    panel: Any,
    reference: NDArray[np.floating],
    residual: NDArray[np.floating],
    limit: float,
    semi_axes: NDArray[np.floating],
) -> Any:
    shown = np.isfinite(residual)
    x, y, value = reference[shown, 0], reference[shown, 1], residual[shown]
    style = {"cmap": "PuOr_r", "vmin": -limit, "vmax": limit, "rasterized": True}
    if len(value) > POINTS_DRAWN:
        edges = [np.linspace(-axis, axis, _BINS + 1) for axis in semi_axes]
        count = np.histogram2d(x, y, bins=edges)[0]
        total = np.histogram2d(x, y, bins=edges, weights=value)[0]
        mean = np.ma.masked_where(count == 0, total / np.maximum(count, 1))
        drawn = panel.pcolormesh(*edges, mean.T, **style)
    else:
        # squares that touch: a panel is about 2.8 inches wide and shows 2.1 semi-axes
        wide = float(semi_axes[0])
        spacing = _figure.point_spacing(reference) if len(reference) > 1 else wide
        side = np.clip(2.8 * 72 * spacing / (2.1 * wide), 3.0, 14.0)
        drawn = panel.scatter(x, y, c=value, marker="s", s=side**2, linewidths=0, **style)
    _figure.outlined(panel, semi_axes)
    return drawn


def _rms(residual: NDArray[np.floating]) -> str:
    known = residual[np.isfinite(residual)]
    return f"rms {np.sqrt(np.mean(known**2)):.3g} mm" if len(known) else "not measured"
