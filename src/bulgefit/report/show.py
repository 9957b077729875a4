"""What does the bulge look like? Surfaces in true scale by any field, and their inflation."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTest, given_test
from bulgefit.errors import InputError
from bulgefit.files import as_path, atomic_write_bytes, check_output
from bulgefit.report import _figure, _off_screen
from bulgefit.report.cloud import RESIDUALS, Cloud, is_signed
from bulgefit.report.films import check_film, write_film

__all__ = ["animate", "show"]

Floats = NDArray[np.float64]
Prediction = Sequence[NDArray[np.floating]]

#: Pixels of a panel.
_WIDTH, _HEIGHT = 720, 640
#: Share of values within which colours of what is derived end: strays must not pale all others.
_SHARE = 98.0
_SIGNED, _PLAIN = "PuOr_r", "viridis"


def show(
    test: GivenTest,
    path: str | os.PathLike[str] | None = None,
    *,
    field: str = "dz",
    frame: int | None = None,
    prediction: Prediction | None = None,
    window: float | None = None,
    label: str = "model",
    force: bool = False,
) -> NDArray[np.uint8]:
    """Draw the measured surface in true scale, coloured by a field, headless.

    With a prediction the model stands beside it in the same colours, and measured minus modelled
    on the measured surface, centred at 0.

    Parameters
    ----------
    test : BulgeTest or path
    path : path, optional
        A .png; by default nothing is written.
    field : str
        dx, dy, dz; strain_xx, strain_yy, strain_xy; curvature_xx, curvature_yy, curvature_xy;
        tension, stress (see `measure`); with a prediction also residual_dx and so on alone.
    frame : int, optional
        Counted from 0 (from the end where negative); by default that of the highest pressure.
    prediction : sequence of (k, n, 3) arrays, mm, optional
        Modelled displacements, one array for every block of the test: `predict(...).blocks`.
    window : float, mm, optional
        Of strain, curvature, tension and stress; by default as `measure` chooses it.
    label : str
        What the model is.
    force : bool
        Whether a file that exists may be replaced.

    Returns
    -------
    (rows, columns, 3) uint8 array
        The picture.

    Raises
    ------
    InputError
        An unknown field or frame, a prediction of another test, or a file that cannot be written.
    BulgefitError
        The machine has no OpenGL to draw with.
    """
    if path is not None:
        if as_path(path).suffix.lower() != ".png":
            raise InputError(f"{path}: give a name that ends in .png")
        check_output(path, force)
    test = given_test(test)
    cloud = _cloud(test, prediction, window)
    cloud.check_field(field)
    shown = int(np.argmax(test.pressure)) if frame is None else frame
    at = _figure.frame_index(shown, test.n_frames)
    cloud.triangles(at)  # before its fields are looked for
    image = _draw(cloud, at, field, label, _ranges(cloud, [at], field))
    if path is not None:
        atomic_write_bytes(path, _off_screen.png(image), force)
    return image


def animate(
    test: GivenTest,
    path: str | os.PathLike[str],
    *,
    field: str = "dz",
    prediction: Prediction | None = None,
    window: float | None = None,
    label: str = "model",
    force: bool = False,
) -> None:
    """Draw the inflation as a film: all frames in the order of pressure, in the same colours.

    Parameters
    ----------
    test, field, prediction, window, label, force
        As of `show`.
    path : path
        A .gif, or an .mp4, which needs `bulgefit[movie]`.

    Raises
    ------
    InputError, BulgefitError
        As of `show`.
    """
    check_film(path, force)
    test = given_test(test)
    cloud = _cloud(test, prediction, window)
    cloud.check_field(field)
    order = [int(i) for i in np.argsort(test.pressure, kind="stable")]
    seen = [i for i in order if len(cloud.part(i)[0])]
    cloud.triangles((seen or order)[-1])  # before its fields are looked for
    ranges = _ranges(cloud, seen, field)
    images = [_draw(cloud, i, field, label, ranges) for i in seen]
    write_film(images, path, force)


def _cloud(test: BulgeTest, prediction: Prediction | None, window: float | None) -> Cloud:
    return Cloud(test, None if prediction is None else tuple(prediction), window)


def _panels(cloud: Cloud, field: str) -> list[tuple[str, bool]]:
    """Field of each panel, and whether it is the model's."""
    if cloud.prediction is None or field in RESIDUALS:
        return [(field, False)]
    return [(field, False), (field, True), (f"residual_{field}", False)]


def _ranges(cloud: Cloud, frames: Sequence[int], field: str) -> dict[str, tuple[float, float]]:
    """Ends of the colours of each field over all frames."""
    ranges = {}
    for name in dict.fromkeys(name for name, _ in _panels(cloud, field)):
        values = np.concatenate([cloud.value(name, i) for i in frames])
        values = values[np.isfinite(values)]
        if not len(values):
            raise InputError(
                f"{cloud.test.name}: {name} is not told anywhere: too few points in a window; give "
                "a wider one"
            )
        share = 100.0 if name in ("dx", "dy", "dz") else _SHARE
        if is_signed(name):
            end = max(float(np.percentile(np.abs(values), share)), 1e-12)
            ranges[name] = (-end, end)
        else:
            low, high = np.percentile(values, [100.0 - share, share])
            ranges[name] = (float(low), float(max(high, low + 1e-12)))
    return ranges


def _draw(
    cloud: Cloud, frame: int, field: str, label: str, ranges: dict[str, tuple[float, float]]
) -> NDArray[np.uint8]:
    panels = _panels(cloud, field)
    size = (_WIDTH * len(panels), _HEIGHT)
    with _off_screen.plotter(shape=(1, len(panels)), window_size=size) as plotter:
        for place, (name, modelled) in enumerate(panels):
            plotter.subplot(0, place)
            unit = cloud.check_field(name)
            whose = label if modelled else "measured"
            title = f"{name} - {label}" if name in RESIDUALS else f"{whose} {name}"
            title = title.replace("residual_", "measured ")
            pressure = f"{10 * cloud.test.pressure[frame]:.3g} bar"
            surface = _surface(cloud, frame, name, modelled=modelled)
            _add(plotter, surface, cloud.test.semi_axes, is_signed(name), ranges[name], place)
            _off_screen.add_text(plotter, f"{cloud.test.name}, {pressure}", (0.03, 0.94))
            # what has no unit is strain
            shown = f"{title} ({'mm/mm' if unit == '1' else unit})"
            _off_screen.add_text(plotter, shown, (0.03, 0.885))
        return _off_screen.picture(plotter)


def _surface(cloud: Cloud, frame: int, name: str, *, modelled: bool) -> Any:
    import pyvista

    reference, moved, model = cloud.part(frame)
    displacement = model if modelled and model is not None else moved
    surface = pyvista.PolyData.from_regular_faces(reference + displacement, cloud.triangles(frame))
    surface["value"] = cloud.value(name, frame, modelled=modelled)
    return surface


def _add(
    plotter: Any,
    surface: Any,
    semi_axes: NDArray[np.floating],
    signed: bool,
    ends: tuple[float, float],
    place: int,
) -> None:
    import pyvista

    key = f"value {place}"  # PyVista joins the bars of one key
    surface.rename_array("value", key)
    drawn = plotter.add_mesh(
        surface, scalars=key, cmap=_SIGNED if signed else _PLAIN, clim=ends,
        nan_color="lightgrey", smooth_shading=True, ambient=0.45, diffuse=0.55, specular=0.0,
        show_scalar_bar=False,
    )  # fmt: skip
    bar = plotter.add_scalar_bar(
        title=key, mapper=drawn.mapper, position_x=0.2, position_y=0.03, width=0.6, height=0.07,
        vertical=False, n_labels=5, fmt="%.3g", color=_off_screen.INK, label_font_size=17,
    )  # fmt: skip
    bar.SetTitle("")
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    a, b = (float(axis) for axis in semi_axes)
    rim = np.column_stack([a * np.cos(angle), b * np.sin(angle), 0.0 * angle])
    plotter.add_mesh(pyvista.MultipleLines(rim), color="dimgrey", line_width=2)
    high = 0.6 * max(a, b)
    box = (-a, a, -b, b, 0.0, high)
    plotter.show_bounds(
        bounds=box, location="outer", ticks="outside", xtitle="x (mm)", ytitle="y (mm)",
        ztitle="z (mm)", n_xlabels=3, n_ylabels=3, n_zlabels=2, fmt="%.0f", font_size=10,
        color=_off_screen.INK,
    )  # fmt: skip
    # the same view of every frame, whatever its height
    plotter.camera_position = [(1.0, -1.7, 1.3), (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera(bounds=(*box[:4], -high, high))
    plotter.camera.zoom(0.92)  # so far away that the axes' titles are in the picture
