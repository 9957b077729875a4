"""Do the parameters of some tests predict the others? Each fold's parameters and its misfit."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from bulgefit.errors import InputError, needed
from bulgefit.fitting.result import unit_of
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS
from bulgefit.shown import with_unit

__all__ = ["plot_folds"]

_FOLDS = "what bulgefit.crossval gives"


def plot_folds(
    folds: Mapping[str, Any], path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw parameters and objectives of a cross-validation, fold by fold.

    Each parameter has a panel, the line is its mean over folds; the last panel has what the fit
    came to (open) and what it means for the test that was left out (filled), in mm where the fit's
    objective is one of displacements.

    Parameters
    ----------
    folds : mapping
        What `bulgefit.crossval` gives.
    path, force
        As of `bulgefit.plot`, as are what is returned and raised.
    """
    if "folds" not in needed(folds, Mapping, _FOLDS):
        raise InputError(f"{_FOLDS} is needed: this mapping has no folds")
    each = folds["folds"]
    names = list(each[0]["parameters"])
    size = (2.6 + 2.8 * (len(names) + 1), 1.6 + 0.35 * len(each))
    figure, panels = _figure.panels(path, force, size, 1, len(names) + 1)
    rows = range(len(each))
    for panel, name in zip(panels[0], names, strict=False):
        values = [fold["parameters"][name] for fold in each]
        panel.plot(values, rows, MARKERS[0][1], color=MARKERS[0][0])
        panel.axvline(sum(values) / len(values), color="#000000", linewidth=1)
        _figure.label(panel, with_unit(name, unit_of(name)), "")
    _draw_objectives(panels[0, -1], folds)
    for panel in panels[0]:
        panel.set_ylim(len(each) - 0.5, -0.5)
        panel.set_yticks(rows, [])
        panel.locator_params(axis="x", nbins=5)  # so that their texts stand apart
    panels[0, 0].set_yticks(rows, [f"without {fold['left_out']}" for fold in each])
    return _figure.finished(figure, path, force)


def _draw_objectives(panel: Any, folds: Mapping[str, Any]) -> None:
    """Of the objective that judges; a likelihood is on no scale with it and stays away."""
    judged, each = folds["judged_by"], folds["folds"]
    colour, marker = MARKERS[1]
    for row, fold in enumerate(each):
        if folds["objective"] == judged:
            training = fold["training"]["value"]
            panel.plot(training, row, marker, color=colour, markerfacecolor="none")
        left_out = fold["left_out_objectives"][judged]
        if left_out is not None:
            panel.plot(left_out, row, marker, color=colour)
    _figure.label(panel, f"{judged} ({folds['unit']}): left out (filled), fitted (open)", "")
