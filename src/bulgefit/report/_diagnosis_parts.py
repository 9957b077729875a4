"""What do the diagnosis's figures share? Names, the steps of the explanation, maps of points."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.regress import Data, Regression
from bulgefit.report import _figure

__all__ = [
    "COMPONENTS",
    "SIGNED",
    "Step",
    "colour_bar",
    "data_of",
    "draw_points",
    "file_stems",
    "frames_of",
    "limit_of",
    "residual_of",
    "rms",
    "steps_of",
    "with_causes",
]

Floats = NDArray[np.float64]

COMPONENTS = ("dx", "dy", "dz")
#: Colours of signed fields, told apart by colour-blind readers.
SIGNED = "PuOr_r"

_SHARE = 98.0  # percentile of |value| at which colours end


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added to the model.

    Attributes
    ----------
    effect : str
    before, after : Regression
        Fits without and with it.
    taken : bool
        False where held-out data did not pay for it.
    """

    effect: str
    before: Regression
    after: Regression
    taken: bool = True


def steps_of(diagnosis: Diagnosis) -> list[Step]:
    """The effects that stayed in the model, in the order in which they were added.

    What an effect brought that a later one made superfluous counts with its successor.
    """
    found = diagnosis.explanation
    kept = [r.taken for r in found.rounds if r.taken and r.taken.effect in found.groups]
    fits = [found.baseline, *(taken.fit for taken in kept[:-1]), found.final]
    return [Step(t.effect, fits[i], fits[i + 1]) for i, t in enumerate(kept)]


def data_of(diagnosis: Diagnosis) -> list[Data]:
    """Specimens with their noise."""
    return [p.data for p in diagnosis.prepared]


def file_stems(names: Sequence[str]) -> list[str]:
    """What the files of each test begin with: its name without what a path cannot hold."""
    clean = [re.sub(r"[^\w.+-]+", "_", name).strip(".") or "test" for name in names]
    return [n if clean.count(n) == 1 else f"{n}_{i + 1}" for i, n in enumerate(clean)]


def with_causes(diagnosis: Diagnosis, most: int = 2) -> str:
    """What the final model holds, for titles."""
    effects = list(diagnosis.explanation.groups)
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
    """A map: every point a square of the point spacing, in the colour of its value."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Circle

    radius = data.specimen.test.radius
    shown = np.isfinite(values)
    centres = data.specimen.reference[shown, :2]
    # uneven points leave holes between squares of their median distance
    half = 0.7 * min(_figure.point_spacing(data.specimen.reference), 0.5 * radius)
    square = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    drawn = PolyCollection(
        list(centres[:, None] + square), array=values[shown], cmap=cmap, linewidths=0,
        rasterized=True,
    )  # fmt: skip
    drawn.set_clim(low, high)
    panel.add_collection(drawn)
    panel.add_patch(Circle((0, 0), radius, fill=False, color="0.4", linewidth=0.8))
    panel.set_aspect("equal")
    panel.set_facecolor("0.93")
    panel.set_xlim(-1.05 * radius, 1.05 * radius)
    panel.set_ylim(-1.05 * radius, 1.05 * radius)
    panel.tick_params(labelsize=_figure.FONT - 2)
    return drawn


def colour_bar(
    figure: Any, drawn: Any, panels: Iterable[Any], label: str, extend: str = "both", **where: Any
) -> None:
    """A colour bar for some panels."""
    from matplotlib.ticker import MaxNLocator

    bar = figure.colorbar(
        drawn, ax=list(panels), extend=extend, ticks=MaxNLocator(5), **{"pad": 0.02, **where}
    )
    bar.set_label(label, fontsize=_figure.FONT)
    bar.ax.tick_params(labelsize=_figure.FONT - 1)
