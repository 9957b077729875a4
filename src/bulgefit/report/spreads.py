"""How much do specimens differ? Their parameters, a panel each, beside mean and spread."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from bulgefit.errors import needed
from bulgefit.fitting.batch import Batch
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS

__all__ = ["check_plot", "plot_spreads"]


def check_plot(path: str | os.PathLike[str], force: bool = False) -> None:
    """Refuse a figure that cannot be written, before the work for it."""
    _figure.figure_target(path, force)


def plot_spreads(
    batch: Batch, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw each free parameter of all specimens.

    Bars are 95 % intervals, the line is the mean over specimens, the band one standard deviation
    about it. What a specimen does not tell is left out.

    Parameters
    ----------
    batch : Batch
    path, force
        As of `bulgefit.plot`, as are what is returned and raised.
    """
    needed(batch, Batch, "what bulgefit.batch_of gives")
    count = len(batch.spreads)
    size = (1.5 + 3.5 * count, 1.5 + 0.3 * len(batch.fits))
    figure, (panels,) = _figure.panels(path, force, size, 1, count)
    for panel, name in zip(panels, batch.spreads, strict=True):
        _draw(panel, batch, name)
    for panel in panels:
        panel.set_ylim(len(batch.fits) - 0.5, -0.5)
        panel.set_yticks(range(len(batch.fits)), [])
        panel.locator_params(axis="x", nbins=5)  # so that their texts stand apart
    panels[0].set_yticks(range(len(batch.fits)), batch.names)
    return _figure.finished(figure, path, force)


def _draw(panel: Any, batch: Batch, name: str) -> None:
    spread = batch.spreads[name]
    colour, marker = MARKERS[0]
    for place, fit in enumerate(batch.fits):
        ends = fit.uncertainty.interval95[name]
        if ends is None:
            continue
        value = {**fit.material.values, **fit.effects}[name]
        panel.plot(ends, [place, place], color=colour)
        panel.plot(value, place, marker, color=colour)
    if spread.mean is not None:
        panel.axvline(spread.mean, color="#000000", linewidth=1)
    if spread.mean is not None and spread.standard_deviation is not None:
        low, high = spread.mean + spread.standard_deviation * np.array([-1.0, 1.0])
        panel.axvspan(low, high, color="#E69F00", alpha=0.3, linewidth=0)
    panel.set_xlabel(name if spread.unit == "1" else f"{name} ({spread.unit})")
