"""How much do parameters differ over the refits of a bootstrap? A histogram each."""

from __future__ import annotations

import os
from typing import Any

from bulgefit.fitting.bootstrap import Bootstrap
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS
from bulgefit.shown import with_unit

__all__ = ["plot_refits"]


def plot_refits(
    refits: Bootstrap, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw each free parameter of all refits, its interval as a band.

    Parameters
    ----------
    refits : Bootstrap
    path, force
        As of `bulgefit.plot`, as are what is returned and raised.
    """
    count = len(refits.free)
    figure, (panels,) = _figure.panels(path, force, (1.0 + 3.5 * count, 3.2), 1, count)
    for panel, parameter, values in zip(panels, refits.free, refits.values.T, strict=True):
        # bins by Freedman and Diaconis (1981)
        panel.hist(values, bins="fd", color=MARKERS[0][0])
        low, high = refits.intervals[parameter.name]
        panel.axvspan(low, high, color=MARKERS[1][0], alpha=0.3, linewidth=0)
        _figure.label(panel, with_unit(parameter.name, parameter.unit), "")
    panels[0].set_ylabel("refits", fontsize=_figure.FONT)
    figure.suptitle(f"band: {100 * refits.level:g} % interval", fontsize=_figure.FONT + 1)
    return _figure.finished(figure, path, force)
