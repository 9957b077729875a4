"""Where does the gap lie, and how does it grow with pressure?"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.residual.locate import Growth, Mode, azimuthal_modes
from bulgefit.gap.residual.structure import RINGS, SECTORS, Cell, cells_of
from bulgefit.report import _figure
from bulgefit.report._diagnosis_parts import (
    COMPONENTS,
    SIGNED,
    colour_bar,
    data_of,
    residual_of,
    with_causes,
)
from bulgefit.report.profiles import MARKERS
from bulgefit.report.record import SIGNIFICANT
from bulgefit.report.words.names import mode_label

__all__ = ["plot_modes", "plot_where"]


def plot_where(
    diagnosis: Diagnosis,
    index: int,
    path: str | os.PathLike[str] | None = None,
    *,
    after: bool,
    force: bool = False,
) -> Any:
    """The map of the gap: component times region times pressure band, with significance."""
    from matplotlib.figure import Figure

    data, found = data_of(diagnosis)[index], diagnosis.explanation
    name = data.specimen.test.name
    fit = found.final if after else found.baseline
    cells = cells_of(data, residual_of(data, fit, index) / data.sigma)
    whole = "what is left" if after else "the gap"
    bands = sorted({c.band for c in cells})
    figure = Figure(figsize=(2.9 * max(len(bands), 2) + 1.3, 10.2), layout="constrained")
    panels = figure.subplots(3, max(len(bands), 1), squeeze=False)
    for component, row in zip(COMPONENTS, panels, strict=True):
        ours = [c for c in cells if c.component == component]
        colours = _colours(_limit(ours))
        for panel, band in zip(row, bands, strict=False):
            inside = [c for c in ours if c.band == band]
            _draw_disc(panel, {c.region: c for c in inside}, colours, data.specimen.test.stretch)
            panel.set_title(
                f"{component}, {band[0]:.3g} to {band[1]:.3g} bar\n"
                f"{sum(c.share for c in inside):.1%} of {whole}",
                fontsize=_figure.FONT,
            )
        colour_bar(
            figure, colours, row, f"mean of {component},\nmeasured - modelled (mm)", "neither",
            aspect=18,
        )  # fmt: skip
    model = with_causes(diagnosis, index) if after else "moduli alone"
    figure.suptitle(
        f"{name}: where the gap lies, {model}\n"
        f"numbers: mean over its standard error, bold from {SIGNIFICANT:g} on; "
        "x to the right, y upwards; hatched: no points",
        fontsize=_figure.FONT + 1,
    )
    return _figure.finished(figure, path, force)


def _limit(cells: list[Cell]) -> float:
    """Where colours end, mm: far enough out that noise stays pale."""
    errors = [c.mean / c.significance for c in cells if c.significance]
    noise = 2.0 * SIGNIFICANT * float(np.median(errors)) if errors else 0.0
    return max(noise, *(abs(c.mean) for c in cells), 1e-9)


def _colours(limit: float) -> Any:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(-limit, limit), colormaps[SIGNED])


def _draw_disc(
    panel: Any, cells: dict[str, Cell], colours: Any, stretch: NDArray[np.float64]
) -> None:
    """Rings and sectors of the specimen, coloured by mean, numbered by significance."""
    from matplotlib.patches import Wedge
    from matplotlib.transforms import Affine2D

    # regions are those of a circle, and are stretched with it
    onto = Affine2D().scale(*stretch) + panel.transData
    for low, high, ring in RINGS:
        high = min(high, 1.0)
        sectors = [None] if ring == "apex" else range(SECTORS)
        for sector in sectors:
            width = 360.0 / SECTORS
            middle = 0.0 if sector is None else sector * width
            region = ring if sector is None else f"{ring} {360 * sector // SECTORS}°"
            ends = (0.0, 360.0) if sector is None else (middle - width / 2, middle + width / 2)
            cell = cells.get(region)
            fill = "none" if cell is None else colours.to_rgba(cell.mean)
            panel.add_patch(
                Wedge((0, 0), high, *ends, width=high - low, facecolor=fill, edgecolor="0.5",
                      linewidth=0.6, hatch="////" if cell is None else None, transform=onto)
            )  # fmt: skip
            if cell is None:
                continue
            reach = 0.0 if sector is None else 0.5 * (low + high)
            strong = abs(cell.significance) >= SIGNIFICANT
            dark = float(np.dot(fill[:3], (0.299, 0.587, 0.114))) < 0.5
            ink = "white" if dark else "black" if strong else "0.35"
            panel.text(
                reach * np.cos(np.deg2rad(middle)), reach * np.sin(np.deg2rad(middle)),
                _short(cell.significance), ha="center", va="center", color=ink, transform=onto,
                fontsize=_figure.FONT - 2, fontweight="bold" if strong else "normal",
            )  # fmt: skip
    wide, high = 1.04 * stretch
    panel.set_xlim(-wide, wide)
    panel.set_ylim(-high, high)
    panel.set_aspect("equal")
    panel.set_axis_off()


def _short(value: float) -> str:
    if abs(value) >= 9999.5:
        return f"{value / 1000:.0f}k"
    text = f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.1f}"
    return "0" if text in ("0.0", "-0.0") else text


def plot_modes(
    diagnosis: Diagnosis,
    index: int,
    path: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
) -> Any:
    """Azimuthal modes of the residual against pressure, before and after, with growth laws."""
    from matplotlib.figure import Figure

    data = data_of(diagnosis)[index]
    rows = [("moduli alone", azimuthal_modes([data], _only(diagnosis, index, final=False)))]
    if diagnosis.explanation.groups:
        left = azimuthal_modes([data], _only(diagnosis, index, final=True))
        rows.append((with_causes(diagnosis, index), left))
    figure = Figure(figsize=(14, 4.4 * len(rows) + 1.0), layout="constrained")
    panels = figure.subplots(len(rows), 3, squeeze=False)
    for row, (label, modes) in zip(panels, rows, strict=True):
        for panel, component in zip(row, ("radial", "hoop", "dz"), strict=True):
            _draw_modes(panel, [m for m in modes if m.component == component])
            panel.set_title(f"{component},\n{label}", fontsize=_figure.FONT)
            panel.set_ylabel("amplitude (mm)", fontsize=_figure.FONT)
            panel.set_xlabel("pressure (bar)", fontsize=_figure.FONT)
    figure.suptitle(
        f"{data.specimen.test.name}: azimuthal modes of measured - modelled, cos/sin(m angle) over "
        "0.3 to 0.9 of the radius\nin the legend the growth law that follows; grey: within three "
        "standard errors of zero",
        fontsize=_figure.FONT + 1,
    )
    return _figure.finished(figure, path, force)


def _only(diagnosis: Diagnosis, index: int, *, final: bool) -> Any:
    """A fit with the predictions of one specimen alone."""
    from dataclasses import replace

    found = diagnosis.explanation
    fit = found.final if final else found.baseline
    return replace(fit, predictions=[fit.predictions[index]])


def _draw_modes(panel: Any, modes: list[Mode]) -> None:
    panel.tick_params(labelsize=_figure.FONT - 1)
    panel.grid(visible=True, color="0.92")
    panel.set_axisbelow(True)
    if modes:
        limit = SIGNIFICANT * modes[0].noise
        panel.axhspan(-limit, limit, color="0.85", zorder=0)
    for mode, (colour, marker) in zip(modes, MARKERS, strict=False):
        quiet = mode.growth is Growth.NONE
        panel.plot(
            mode.pressure, mode.amplitude, marker, color=colour, markersize=4, linewidth=1.0,
            markerfacecolor="none" if quiet else colour, linestyle="none" if quiet else "-",
            label=mode_label(mode.order, mode.growth),
        )  # fmt: skip
    panel.legend(
        fontsize=_figure.FONT - 1, loc="upper center", bbox_to_anchor=(0.5, -0.13), frameon=False,
        handletextpad=0.1, columnspacing=1.0, ncol=2,
    )  # fmt: skip
