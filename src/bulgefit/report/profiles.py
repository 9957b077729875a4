"""How does the model follow the measured profiles? Along y = 0 and x = 0, as in the study."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import needed
from bulgefit.report import _figure

__all__ = ["MARKERS", "plot_profiles"]

#: Curves a panel.
PRESSURES = 5

#: Okabe and Ito's colours, told apart by colour-blind readers, with a marker each.
MARKERS = (("#0072B2", "o"), ("#E69F00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#000000", "v"))

_NAMES = ("dx", "dy", "dz")


def plot_profiles(
    test: BulgeTest,
    prediction: tuple[NDArray[np.floating], ...] | None = None,
    path: str | os.PathLike[str] | None = None,
    *,
    label: str = "model",
    force: bool = False,
) -> Any:
    """Draw measured profiles for up to five pressures, against modelled ones where there are any.

    The upper row is the line y = 0 with dz and dx, the lower one x = 0 with dz and dy. Points
    count as on the line within half the point spacing (the median distance between neighbours);
    the figure says how far that is. The legends give the mean squared error over the points of
    the curve in mm².

    Parameters
    ----------
    test : BulgeTest
    prediction : tuple of (k, n, 3) arrays, mm, optional
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
    needed(test, BulgeTest, "a bulge test")
    if prediction is not None:
        _figure.check_prediction(test, prediction)
    figure, panels = _figure.panels(path, force, (13.0, 8.0), 2, 2)
    reaches = []
    for row, (along, across) in enumerate(((0, 1), (1, 0))):
        curves, reach = _curves(test, prediction, along, across)
        reaches.append(reach)
        for panel, component in zip(panels[row], (2, along), strict=True):
            _draw(panel, curves, component, along, "yx"[row], test.pressure)
    figure.suptitle(
        f"{test.name}: measured{'' if prediction is None else f' (markers) and {label} (lines)'}\n"
        f"points within {_span(reaches)} of the line",
        fontsize=_figure.FONT + 2,
    )
    return _figure.finished(figure, path, force)


Curve = tuple[int, NDArray[np.floating], NDArray[np.floating], NDArray[np.floating] | None]


def _curves(
    test: BulgeTest, prediction: tuple[NDArray[np.floating], ...] | None, along: int, across: int
) -> tuple[list[Curve], float]:
    """Frame, position, measured and modelled displacement on one line; how near its points are."""
    modelled = (None,) * len(test.blocks) if prediction is None else prediction
    found: dict[int, Curve] = {}
    reach = 0.0
    for block, model in zip(test.blocks, modelled, strict=True):
        near = 0.5 * _figure.point_spacing(block.reference)
        on = np.flatnonzero(np.abs(block.reference[:, across]) <= near)
        on = on[np.argsort(block.reference[on, along], kind="stable")]
        if len(on) == 0:
            continue
        reach = max(reach, near)
        for row, frame in enumerate(block.frames):
            moved = block.displacement[row, on]
            if np.isfinite(moved).any():
                found[int(frame)] = (
                    int(frame), block.reference[on, along], moved,
                    None if model is None else model[row, on],
                )  # fmt: skip
    frames = np.array(sorted(found), dtype=np.intp)
    return [found[i] for i in _figure.spread(frames, test.pressure, PRESSURES)], reach


def _draw(
    panel: Any,
    curves: list[Curve],
    component: int,
    along: int,
    zero: str,
    pressure: NDArray[np.floating],
) -> None:
    name = _NAMES[component]
    panel.set_title(f"{name} along {zero} = 0", fontsize=_figure.FONT + 1)
    panel.set_xlabel(f"{'xy'[along]} before inflation (mm)", fontsize=_figure.FONT)
    panel.set_ylabel(f"{name} (mm)", fontsize=_figure.FONT)
    panel.tick_params(labelsize=_figure.FONT - 1)
    panel.grid(visible=True, color="0.9")
    panel.set_axisbelow(True)
    drawn = False
    # the highest pressure first, so that the legend stands in the order of the curves
    for (frame, position, measured, modelled), (colour, marker) in reversed(
        list(zip(curves, MARKERS, strict=False))
    ):
        seen = measured[:, component]
        line = None if modelled is None else modelled[:, component]
        both = np.isfinite(seen) if line is None else np.isfinite(seen) & np.isfinite(line)
        if not both.any():
            continue
        told = f"{10 * pressure[frame]:.3g} bar"
        if line is not None:
            told += f", MSE {float(np.mean((line[both] - seen[both]) ** 2)):.3g} mm²"
            panel.plot(position[both], line[both], color=colour, linewidth=1.3, zorder=3)
        every = max(1, int(both.sum()) // 60)
        panel.plot(
            position[both][::every],
            seen[both][::every],
            marker,
            color=colour,
            markersize=4,
            markerfacecolor="none",
            linestyle="none",
            label=told,
        )
        drawn = True
    if drawn:
        # below a dome, and above what moves towards the rim on the other side
        panel.legend(
            fontsize=_figure.FONT - 1, loc="lower center" if name == "dz" else "upper left",
            framealpha=0.85, edgecolor="none",
        )  # fmt: skip
    else:
        panel.text(
            0.5, 0.5, f"no measured {name} on this line", ha="center", va="center",
            transform=panel.transAxes, fontsize=_figure.FONT,
        )  # fmt: skip


def _span(reaches: list[float]) -> str:
    low, high = f"{min(reaches):.2g}", f"{max(reaches):.2g}"
    return f"{high} mm" if low == high else f"{low} to {high} mm"
