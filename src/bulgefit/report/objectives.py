"""How far are given parameters from the tests? Deviations and objectives, test by test."""

from __future__ import annotations

import os
from typing import Any

from bulgefit.errors import needed
from bulgefit.fitting.answers import Evaluation
from bulgefit.fitting.objective import OBJECTIVES
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS

__all__ = ["plot_objectives"]

#: Panels: what stands at the axis, and parts of a test.
_PANELS = {
    "mean absolute deviation (mm)": ("dx", "dy", "dz"),
    "objective (mm)": OBJECTIVES,
}


def plot_objectives(
    evaluation: Evaluation, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw deviations of dx, dy, dz and the objectives of each test, and of several their mean.

    What a test does not have, such as dz near the centre for e_z, is left out.

    Parameters
    ----------
    evaluation : Evaluation
    path, force
        As of `bulgefit.plot`, as are what is returned and raised.
    """
    needed(evaluation, Evaluation, "what bulgefit.evaluate gives")
    rows = evaluation.each()
    figure, (panels,) = _figure.panels(path, force, (10.0, 2.0 + 0.35 * len(rows)), 1, 2)
    for panel, (title, parts) in zip(panels, _PANELS.items(), strict=True):
        for name, (colour, marker) in zip(parts, MARKERS, strict=False):
            values = [told.get(name) for _, told in rows]
            known = [at for at, value in enumerate(values) if value is not None]
            panel.plot([values[at] for at in known], known, marker, color=colour, label=name)
        _figure.label(panel, title, "")
        panel.legend(fontsize=_figure.FONT)
        panel.set_xlim(left=0.0)
        panel.set_ylim(len(rows) - 0.5, -0.5)
        panel.set_yticks(range(len(rows)), [])
    panels[0].set_yticks(range(len(rows)), [name for name, _ in rows])
    return _figure.finished(figure, path, force)
