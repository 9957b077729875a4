"""What does a measurement look like without any model? Stress against strain, rings and maps."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.surface.local import Surface
from bulgefit.dic.surface.measured import Measured
from bulgefit.errors import InputError, needed
from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS, PRESSURES

__all__ = ["plot_apex", "plot_measured", "plot_rings"]

Floats = NDArray[np.floating]

#: Standard errors that bars show.
_BARS = 2.0
_MEASURED = "what bulgefit.measure gives"
_BARRED = "bars: two standard errors"


def plot_apex(
    measured: Measured,
    path: str | os.PathLike[str] | None = None,
    *,
    model: Measured | None = None,
    force: bool = False,
) -> Any:
    """Draw stress at the apex against strain along warp and fill, and curvature over pressure.

    Parameters
    ----------
    measured : Measured
    path : path, optional
        A .png, .pdf or .svg; by default nothing is written.
    model : Measured, optional
        The same of a model, by the same windows, as lines: `measure(predict(...).as_test(),
        window=measured.window)`.
    force : bool
        Whether a file that exists may be replaced.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        The model is of another test or window, or the file cannot be written.
    """
    _check_model(measured, model)
    figure, panels = _figure.panels(path, force, (9.5, 4.0), 1, 2)
    apex = measured.apex
    left, right = panels[0]
    for index, (name, (colour, marker)) in enumerate(zip(("x", "y"), MARKERS, strict=False)):
        look = _look(colour, marker, model)
        left.errorbar(
            100 * apex.strain[:, 0, index], apex.stress[:, 0],
            xerr=100 * _BARS * apex.strain_noise[:, 0, index],
            yerr=_BARS * apex.stress_noise[:, 0], label=f"strain along {name}", **look,
        )  # fmt: skip
        right.errorbar(
            10 * measured.pressure, 1e3 * apex.curvature[:, 0, index],
            yerr=1e3 * _BARS * apex.curvature_noise[:, 0, index], label=f"along {name}", **look,
        )  # fmt: skip
        if model is not None:
            order, told = np.argsort(model.pressure, kind="stable"), model.apex
            left.plot(100 * told.strain[order, 0, index], told.stress[order, 0], color=colour)
            bent = 1e3 * told.curvature[order, 0, index]
            right.plot(10 * model.pressure[order], bent, color=colour)
    _figure.label(left, "Hencky strain at the apex (%)", "mean true stress at the apex (MPa)")
    _figure.label(right, "pressure (bar)", "curvature at the apex (1/m)")
    for panel in (left, right):
        panel.legend(fontsize=_figure.FONT - 1, frameon=False)
    figure.suptitle(f"{_title(measured, _beside(model))}; {_BARRED}", fontsize=_figure.FONT + 1)
    return _figure.finished(figure, path, force)


def plot_rings(
    measured: Measured,
    path: str | os.PathLike[str] | None = None,
    *,
    model: Measured | None = None,
    force: bool = False,
) -> Any:
    """Draw strain and tension of rings against their radius, for up to five pressures.

    Parameters
    ----------
    measured, path, model, force
        As of `plot_apex`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        The model is of another test or window, or the file cannot be written.
    """
    _check_model(measured, model)
    figure, panels = _figure.panels(path, force, (10.5, 7.0), 2, 2)
    rings = measured.rings
    frames = _figure.spread(np.arange(len(measured.pressure)), measured.pressure, PRESSURES)
    beside = None if model is None else model.rings
    rows = (
        ("Hencky strain (%)", 100 * rings.strain, 100 * rings.strain_noise,
         None if beside is None else 100 * beside.strain),
        ("tension (N/mm)", rings.tension, rings.tension_noise,
         None if beside is None else beside.tension),
    )  # fmt: skip
    for row, (name, values, noise, modelled) in zip(panels, rows, strict=True):
        for index, (panel, part) in enumerate(zip(row, ("meridian", "hoop"), strict=True)):
            for frame, (colour, marker) in reversed(list(zip(frames, MARKERS, strict=False))):
                look = _look(colour, marker, model)
                panel.errorbar(
                    rings.radius, values[frame, :, index], yerr=_BARS * noise[frame, :, index],
                    label=f"{10 * measured.pressure[frame]:.3g} bar", **look,
                )  # fmt: skip
                if modelled is not None:
                    panel.plot(rings.radius, modelled[frame, :, index], color=colour)
            _figure.label(panel, "radius before inflation (mm)", f"{part} {name}")
    panels[0, 1].legend(
        fontsize=_figure.FONT - 1, frameon=False, loc="upper left", bbox_to_anchor=(1.01, 1.0)
    )
    title = f"{_title(measured, _beside(model))}; means around rings, {_BARRED}"
    figure.suptitle(title, fontsize=_figure.FONT + 1)
    return _figure.finished(figure, path, force)


def plot_measured(
    measured: Measured,
    path: str | os.PathLike[str] | None = None,
    *,
    frame: int = -1,
    label: str = "measured, without a model",
    force: bool = False,
) -> Any:
    """Draw maps of strain, curvature, tension and stress in a frame.

    Parameters
    ----------
    measured, path, force
        As of `plot_apex`.
    frame : int
        Of the test, counted from 0 (from the end where negative).
    label : str
        What is drawn, for the title.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        There is no such frame, or the file cannot be written.
    """
    needed(measured, Measured, _MEASURED)
    at = _figure.frame_index(frame, len(measured.pressure))
    figure, panels = _figure.panels(path, force, (12.5, 7.2), 2, 4)
    for panel, (name, values) in zip(panels.ravel(), _maps(measured.surface, at), strict=True):
        _map(figure, panel, measured.surface.points, values, name)
    pressure = f"{10 * measured.pressure[at]:.3g} bar"
    figure.suptitle(f"{_title(measured, label)}, {pressure}", fontsize=_figure.FONT + 1)
    return _figure.finished(figure, path, force)


def _maps(surface: Surface, frame: int) -> list[tuple[str, Floats]]:
    strain, bent = 100 * surface.strain[frame], 1e3 * surface.curvature[frame]
    return [
        *((f"strain {name} (%)", strain[:, i]) for i, name in enumerate(("xx", "yy", "xy"))),
        ("mean tension (N/mm)", surface.tension[frame]),
        *((f"curvature {name} (1/m)", bent[:, i]) for i, name in enumerate(("xx", "yy", "xy"))),
        ("mean true stress (MPa)", surface.stress[frame]),
    ]


def _map(figure: Any, panel: Any, points: Floats, values: Floats, name: str) -> None:
    shown = np.isfinite(values)
    signed = " xy " in name
    limit = max(float(np.abs(values[shown]).max(initial=0.0)), 1e-12)
    style = {"cmap": "PuOr_r", "vmin": -limit, "vmax": limit} if signed else {"cmap": "viridis"}
    side = 2.6 * 72 * _figure.point_spacing(points) / (2.2 * np.hypot(*points.T).max(initial=1.0))
    drawn = panel.scatter(
        *points[shown].T, c=values[shown], marker="s", s=min(side, 25.0) ** 2, linewidths=0,
        rasterized=True, **style,
    )  # fmt: skip
    panel.set_aspect("equal")
    panel.set_facecolor("0.93")
    panel.set_title(name, fontsize=_figure.FONT)
    _figure.label(panel, "x (mm)", "y (mm)")
    panel.grid(visible=False)
    bar = figure.colorbar(drawn, ax=panel, location="bottom", shrink=0.85, aspect=22)
    bar.ax.tick_params(labelsize=_figure.FONT - 2)


def _check_model(measured: Measured, model: Measured | None) -> None:
    """Refuse what was not measured at the same places by the same windows."""
    needed(measured, Measured, _MEASURED)
    if model is None:
        return
    needed(model, Measured, _MEASURED)
    ours, theirs = ((m.window, m.pressure.tolist(), m.rings.radius.tolist())
                    for m in (measured, model))  # fmt: skip
    if ours != theirs:
        raise InputError(
            f"{measured.name}: the model beside it is of other frames or another window; give "
            "measure(predict(...).as_test(), window=measured.window)"
        )


def _look(colour: str, marker: str, model: Measured | None) -> dict[str, Any]:
    """Of what was measured: joined where no model's line stands beside it."""
    return {
        "color": colour, "marker": marker, "markersize": 4, "markerfacecolor": "none",
        "capsize": 2.0, "linewidth": 1.0, "linestyle": "-" if model is None else "none",
    }  # fmt: skip


def _beside(model: Measured | None) -> str:
    return "measured, without a model" if model is None else "measured (markers), model (lines)"


def _title(measured: Measured, what: str) -> str:
    return f"{measured.name}: {what}; windows of radius {measured.window:.3g} mm"
