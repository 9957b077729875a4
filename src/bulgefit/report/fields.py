"""What does the deformed membrane look like? Pictures by PyVista, drawn off screen."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import BulgefitError
from bulgefit.files import atomic_write_bytes, check_output

__all__ = ["plot_fields"]

_SIZE = (1500, 900)
_INK, _PAPER = "black", "white"


def plot_fields(
    nodes: NDArray[np.float64],
    cells: NDArray[np.int64],
    displacement: NDArray[np.float64],
    path: str | os.PathLike[str],
    *,
    title: str = "",
    force: bool = False,
) -> None:
    """Draw the deformed surface coloured by dz, and |dx| and |dy| seen from above.

    Parameters
    ----------
    nodes : (n, 2) array, mm
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
        The file cannot be written.
    """
    check_output(path, force)
    _require_opengl()
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger

    flat = np.column_stack([nodes, np.zeros(len(nodes))])
    surface = pyvista.PolyData.from_regular_faces(flat + displacement, cells)
    # without a display VTK says that it looked for one before it draws off screen
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        plotter = pyvista.Plotter(
            off_screen=True, shape="1|2", window_size=_SIZE, border=False, splitting_position=0.62
        )
        try:
            plotter.set_background(_PAPER)
            plotter.enable_anti_aliasing("ssaa")
            plotter.subplot(0)
            _draw_shape(plotter, surface.copy(), displacement[:, 2], title)
            for place, axis in enumerate("xy"):
                plotter.subplot(place + 1)
                _draw_from_above(plotter, surface.copy(), np.abs(displacement[:, place]), axis)
            image = plotter.screenshot(return_img=True)
        finally:
            plotter.close()
    finally:
        vtkLogger.SetStderrVerbosity(before)
    atomic_write_bytes(path, _png(image), force)


def _draw_shape(plotter: Any, surface: Any, dz: NDArray[np.float64], title: str) -> None:
    surface["dz"] = dz
    plotter.add_mesh(
        surface, scalars="dz", cmap="viridis", smooth_shading=True, show_scalar_bar=False
    )
    _text(plotter, title, (0.03, 0.95))
    _colour_bar(plotter, "dz (mm)", (0.2, 0.05), (0.6, 0.08), vertical=False)
    _text(plotter, "dz (mm)", (0.82, 0.06))
    plotter.show_bounds(
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
        color=_INK,
        grid="back",
    )
    plotter.camera_position = [(1.0, -1.7, 1.15), (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera()
    plotter.camera.zoom(0.86)


def _draw_from_above(plotter: Any, surface: Any, value: NDArray[np.float64], axis: str) -> None:
    # not |dx|: VTK's texts take a bar for the end of a column
    name = f"size of d{axis} (mm)"
    surface[name] = value
    plotter.add_mesh(surface, scalars=name, cmap="cividis", lighting=False, show_scalar_bar=False)
    _text(plotter, f"{name}, seen from above, x to the right", (0.04, 0.92))
    _colour_bar(plotter, name, (0.83, 0.1), (0.14, 0.75), vertical=True)
    plotter.view_xy()
    plotter.enable_parallel_projection()
    plotter.camera.zoom(1.15)


def _text(plotter: Any, text: str, position: tuple[float, float]) -> None:
    plotter.add_text(text, position=position, viewport=True, font_size=11, color=_INK)


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
        color=_INK,
        label_font_size=18,
    )
    bar.SetTitle("")


def _png(image: NDArray[np.uint8]) -> bytes:
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, image, format="png", metadata={"Software": "bulgefit"})
    return buffer.getvalue()


def _require_opengl() -> None:
    """Refuse where VTK would crash: no display, and no OpenGL without one.

    Raises
    ------
    BulgefitError
    """
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY"):
        return
    if _egl_devices() == 0:
        raise BulgefitError(
            "this machine has neither a display nor OpenGL without one (EGL), so no picture can "
            "be drawn; on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
        )


def _egl_devices() -> int:
    import ctypes

    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return 0
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return 0
    kind = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int)
    )
    count = ctypes.c_int(0)
    return count.value if kind(address)(0, None, ctypes.byref(count)) else 0
