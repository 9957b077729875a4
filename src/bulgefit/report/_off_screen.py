"""How is anything drawn by OpenGL where there is no display? By PyVista, off screen."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import BulgefitError

__all__ = ["INK", "PAPER", "add_text", "picture", "plotter", "png", "require_opengl"]

INK, PAPER = "black", "white"


@contextmanager
def plotter(**options: Any) -> Iterator[Any]:
    """A pyvista.Plotter off screen, which is closed afterwards.

    Raises
    ------
    BulgefitError
        The machine has no OpenGL to draw with.
    """
    require_opengl()
    import pyvista
    from vtkmodules.vtkCommonCore import vtkLogger

    # without a display VTK says that it looked for one before it draws off screen
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        drawn = pyvista.Plotter(off_screen=True, border=False, **options)
        try:
            drawn.set_background(PAPER)
            drawn.enable_anti_aliasing("ssaa")
            yield drawn
        finally:
            drawn.close()
    finally:
        vtkLogger.SetStderrVerbosity(before)


def add_text(drawn: Any, text: str, position: tuple[float, float]) -> None:
    """Write into the panel, at a part of its width and height."""
    drawn.add_text(text, position=position, viewport=True, font_size=11, color=INK)


def picture(drawn: Any) -> NDArray[np.uint8]:
    """What was drawn, (rows, columns, 3), kept where PyVista's scraper for Sphinx looks for it."""
    drawn.last_image = drawn.screenshot(return_img=True)
    return np.asarray(drawn.last_image)


def png(image: NDArray[np.uint8]) -> bytes:
    """An image (rows, columns, 3) as a PNG."""
    from matplotlib.image import imsave

    buffer = io.BytesIO()
    imsave(buffer, image, format="png", metadata={"Software": "bulgefit"})
    return buffer.getvalue()


def require_opengl() -> None:
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
