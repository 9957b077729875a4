"""How much do specimens differ? Their parameters, a panel each, beside mean and spread."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from bulgefit.errors import needed
from bulgefit.fitting.batch import Batch
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS
from bulgefit.shown import with_unit

__all__ = ["check_plot", "plot_spreads"]


def check_plot(path: str | os.PathLike[str], force: bool = False) -> None:
    """Refuse a figure that cannot be written, before the work for it."""
    _figure.figure_target(path, force)


def plot_spreads(
    batch: Batch, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw each free parameter of all specimens.

    Bars are 95 % intervals, the line is the mean over specimens, the band one standard deviation
    about it: a legend says so. Of what a specimen does not tell it is said that and why.

    Parameters
    ----------
    batch : Batch
    path, force
        As of `bulgefit.plot`, as are what is returned and raised.
    """
    needed(batch, Batch, "what bulgefit.batch_of gives")
    count = len(batch.spreads)
    size = (1.5 + 3.5 * count, (1.9 if count > 1 else 2.3) + 0.3 * len(batch.fits))
    figure, (panels,) = _figure.panels(path, force, size, 1, count)
    for panel, name in zip(panels, batch.spreads, strict=True):
        _draw(panel, batch, name)
    for panel in panels:
        panel.set_ylim(len(batch.fits) - 0.5, -0.5)
        panel.set_yticks(range(len(batch.fits)), [])
        panel.locator_params(axis="x", nbins=5)  # so that their texts stand apart
    panels[0].set_yticks(range(len(batch.fits)), batch.names)
    legend: dict[str, Any] = {}
    for panel in panels:
        drawn, labels = panel.get_legend_handles_labels()
        legend |= dict(zip(labels, drawn, strict=True))
    if legend:
        figure.legend(
            legend.values(), legend, loc="outside lower center", frameon=False,
            ncol=len(legend) if count > 1 else 1, fontsize=_figure.FONT - 1,
        )  # fmt: skip
    return _figure.finished(figure, path, force)


def _draw(panel: Any, batch: Batch, name: str) -> None:
    spread = batch.spreads[name]
    colour, marker = MARKERS[0]
    for place, fit in enumerate(batch.fits):
        ends = fit.uncertainty.interval95[name]
        if ends is None or fit.uncertainty.stderr[name] is None:
            (free,) = (p for p in fit.free if p.name == name)
            panel.text(
                0.5, place, "at its bound" if fit.at_bound(free) else "not determined",
                transform=panel.get_yaxis_transform(), ha="center", va="center", color="0.3",
                fontsize=_figure.FONT - 1, bbox={"facecolor": "white", "linewidth": 0, "pad": 1.0},
            )  # fmt: skip
            continue
        value = {**fit.material.values, **fit.effects}[name]
        panel.plot(
            [ends[0], value, ends[1]], [place] * 3, marker, linestyle="-", color=colour,
            markevery=[1], label="value and 95 % interval",
        )  # fmt: skip
    if spread.mean is None:
        panel.tick_params(axis="x", bottom=False, labelbottom=False)
    else:
        panel.axvline(spread.mean, color="#000000", linewidth=1, label="mean over specimens")
    if spread.mean is not None and spread.standard_deviation is not None:
        low, high = spread.mean + spread.standard_deviation * np.array([-1.0, 1.0])
        panel.axvspan(
            low, high, color="#E69F00", alpha=0.3, linewidth=0, label="one standard deviation"
        )
    panel.set_xlabel(with_unit(name, spread.unit))
