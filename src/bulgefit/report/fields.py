"""What does the deformed membrane look like? Pictures by PyVista, drawn off screen."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError
from bulgefit.files import as_path, atomic_write_bytes, check_output
from bulgefit.report import _off_screen

__all__ = ["plot_fields"]

Floats = NDArray[np.float64]

_SIZE = (1500, 900)
#: Ends of a scale are written to three digits.
_UNSEEN = 1e-3


def plot_fields(
    nodes: NDArray[np.float64],
    cells: NDArray[np.int64],
    displacement: NDArray[np.float64],
    path: str | os.PathLike[str],
    *,
    title: str = "",
    force: bool = False,
) -> None:
    """Draw the deformed surface coloured by dz, and the sizes of dx and dy from above.

    Parameters
    ----------
    nodes : (n, 2) or (n, 3) array, mm
        Before inflation; without heights they lie flat.
    cells : (m, 4) int array
    displacement : (n, 3) array, mm
    path : path
        A .png.
    title : str
    force : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    BulgefitError
        The machine has no OpenGL to draw with.
    InputError
        The arrays do not match, or the file cannot be written.
    """
    target = as_path(path)
    nodes, cells, displacement = _checked(nodes, cells, displacement)
    check_output(target, force)
    _off_screen.require_opengl()
    import pyvista

    surface = pyvista.PolyData.from_regular_faces(nodes + displacement, cells)
    with _off_screen.plotter(shape="1|2", window_size=_SIZE, splitting_position=0.62) as plotter:
        plotter.subplot(0)
        _draw_shape(plotter, surface.copy(), displacement[:, 2], title)
        for place, axis in enumerate("xy"):
            plotter.subplot(place + 1)
            _draw_from_above(plotter, surface.copy(), np.abs(displacement[:, place]), axis)
        image = _off_screen.picture(plotter)
    atomic_write_bytes(path, _off_screen.png(image), force)


def _checked(nodes: Any, cells: Any, displacement: Any) -> tuple[Floats, Any, Floats]:
    """The three as arrays, nodes with their heights, where they are those of one mesh."""
    try:
        at, moved = (np.asarray(given, dtype=float) for given in (nodes, displacement))
        joined = np.asarray(cells, dtype=np.int64)
    except (TypeError, ValueError):
        raise InputError("nodes, cells and displacement must be arrays of numbers") from None
    shapes = at.shape, joined.shape, moved.shape
    if at.ndim == 2 and at.shape[1] == 2:
        at = np.column_stack([at, np.zeros(len(at))])
    count, cell_count = at.size // 3, joined.size // 4
    if not cell_count or (at.shape, *shapes[1:]) != ((count, 3), (cell_count, 4), (count, 3)):
        raise InputError(
            "nodes (n, 2) or (n, 3), cells (m, 4) and displacement (n, 3) are needed, "
            f"not arrays of {shapes}"
        )
    if joined.min() < 0 or joined.max() >= count:
        raise InputError(f"cells name nodes 0 to {count - 1}; these name {joined.max()}")
    return at, joined, moved


def _draw_shape(plotter: Any, surface: Any, dz: NDArray[np.float64], title: str) -> None:
    surface["dz"] = dz
    plotter.add_mesh(
        surface, scalars="dz", clim=_ends(dz), cmap="viridis", smooth_shading=True,
        show_scalar_bar=False,
    )  # fmt: skip
    _off_screen.add_text(plotter, title, (0.03, 0.95))
    _colour_bar(plotter, "dz (mm)", (0.2, 0.05), (0.6, 0.08), vertical=False)
    _off_screen.add_text(plotter, "dz (mm)", (0.82, 0.06))
    plotter.show_bounds(
        # to a micrometre: a rim that is round to rounding would be written to be at -0
        axes_ranges=[round(end, 3) for at in surface.points.T for end in _ends(at)],
        location="outer",
        ticks="outside",
        xtitle="x (mm)",
        ytitle="y (mm)",
        ztitle="z (mm)",
        n_xlabels=5,
        n_ylabels=5,
        n_zlabels=3,
        fmt="%.0f",
        font_size=11,
        color=_off_screen.INK,
        grid="back",
    )
    plotter.camera_position = [(1.0, -1.7, 1.15), (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera()
    plotter.camera.zoom(0.88)
    # a dome is flat, and its axes are below it: it is in the middle between title and bar
    plotter.camera.SetWindowCenter(0.0, -0.12)


def _ends(values: NDArray[np.float64]) -> tuple[float, float]:
    """Of a scale: least and largest value, 0 where that is not seen beside the other end."""
    ends = np.array([values.min(), values.max()])
    low, high = np.where(np.abs(ends) < _UNSEEN * np.abs(ends).max(), 0.0, ends)
    return float(low), float(high)


def _draw_from_above(plotter: Any, surface: Any, value: NDArray[np.float64], axis: str) -> None:
    # not |dx|: VTK's texts take a bar for the end of a column
    name = f"size of d{axis} (mm)"
    surface[name] = value
    plotter.add_mesh(
        surface, scalars=name, clim=_ends(value), cmap="cividis", lighting=False,
        show_scalar_bar=False,
    )  # fmt: skip
    _off_screen.add_text(plotter, f"{name}, seen from above, x to the right", (0.04, 0.92))
    _colour_bar(plotter, name, (0.83, 0.1), (0.14, 0.75), vertical=True)
    plotter.view_xy()
    plotter.enable_parallel_projection()
    plotter.camera.zoom(1.15)


def _colour_bar(
    plotter: Any,
    key: str,
    position: tuple[float, float],
    size: tuple[float, float],
    *,
    vertical: bool,
) -> None:
    # without VTK's own title, which it sets across the numbers
    bar = plotter.add_scalar_bar(
        title=key,
        position_x=position[0],
        position_y=position[1],
        width=size[0],
        height=size[1],
        vertical=vertical,
        n_labels=5,
        fmt="%.3g",
        color=_off_screen.INK,
        label_font_size=18,
    )
    bar.SetTitle("")
