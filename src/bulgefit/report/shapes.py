"""How does a simulated membrane rise? Its apex by pressure, and its profile along x."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from bulgefit.model.simulation import Simulation
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS, PRESSURES

__all__ = ["plot_shapes"]


def plot_shapes(
    simulation: Simulation, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw dz of the apex against pressure, and dz along y = 0 for up to five pressures.

    Parameters
    ----------
    simulation : Simulation
    path, force
        As of `bulgefit.plot`, as are what is returned and raised.
    """
    figure, ((left, right),) = _figure.panels(path, force, (9.5, 4.0), 1, 2)
    order = np.argsort(simulation.pressure, kind="stable")
    bar = 10.0 * simulation.pressure
    left.plot(bar[order], simulation.apex[order], MARKERS[0][1] + "-", color=MARKERS[0][0])
    _figure.label(left, "pressure (bar)", "dz of the apex (mm)")
    nodes = simulation.membrane.reference
    on = np.flatnonzero(np.abs(nodes[:, 1]) <= 1e-9 * np.abs(nodes).max())
    on = on[np.argsort(nodes[on, 0], kind="stable")]
    shown = _figure.spread(order, simulation.pressure, PRESSURES)
    for frame, (colour, marker) in zip(shown, MARKERS, strict=False):
        moved = simulation.displacement[frame, on, 2]
        right.plot(nodes[on, 0], moved, marker + "-", color=colour, label=f"{bar[frame]:.3g} bar")
    right.legend(fontsize=_figure.FONT)
    _figure.label(right, "x before inflation (mm)", "dz along y = 0 (mm)")
    return _figure.finished(figure, path, force)
