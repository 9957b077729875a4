"""Are the images at rest at rest, so that they tell the noise?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["AT_REST", "about_images_at_rest", "about_inflated_images"]

Floats = NDArray[np.floating]

#: Displacement, mm, that may be seen at rest.
AT_REST = 0.1
# Standard errors by which a height tells itself from noise.
_SURE = 5.0


def about_inflated_images(test: BulgeTest) -> Iterator[Suspicion]:
    """Images at rest in which the cloth is a dome: their spread is no noise."""
    if test.static_displacement is None:
        return
    x, y = (test.blocks[0].reference[:, :2] / test.radius).T.astype(float)
    rises = [_rise(x, y, image[:, 2].astype(float)) for image in test.static_displacement]
    found = [index for index, rise in enumerate(rises) if abs(rise) > AT_REST]
    if found:
        largest = max((rises[index] for index in found), key=abs)
        which = ", ".join(map(str, found))
        yield Suspicion(
            "static_inflated",
            f"of the {len(rises)} images at rest (from 0) {which} "
            f"{'show domes of up to' if len(found) > 1 else 'shows a dome of'} {largest:.2g} mm, "
            "as under pressure: the noise comes out too large",
            "take as images at rest what was at rest alone (a smaller --at-rest, or fewer of "
            "static_displacement)",
        )


def _rise(x: Floats, y: Floats, dz: Floats) -> float:
    """What a paraboloid about the centre rises within the measured points, mm; 0 if not sure.

    A motion of the camera between the images is a plane, and counts for nothing.
    """
    seen = np.isfinite(dz)
    square = x * x + y * y
    basis = np.stack([np.ones_like(x), x, y, -square], axis=1)[seen]
    if np.linalg.matrix_rank(basis) < 4 or len(basis) < 5:
        return 0.0
    found, left, *_ = np.linalg.lstsq(basis, dz[seen], rcond=None)
    variance = float(left[0]) / (len(basis) - 4) * np.linalg.inv(basis.T @ basis)[3, 3]
    if abs(found[3]) < _SURE * np.sqrt(variance):
        return 0.0
    return float(found[3] * np.ptp(square[seen]))


def about_images_at_rest(test: BulgeTest) -> Iterator[Suspicion]:
    """What images at rest lack, and a motion between them."""
    if test.static_displacement is None:
        return
    rows = test.static_displacement.reshape(-1, 3)
    known = [component[np.isfinite(component)] for component in rows.T]
    for key, values in zip(("dx", "dy", "dz"), known, strict=True):
        if not len(values):
            yield Suspicion(
                "static_component_missing",
                f"{key} was never measured in the images at rest: they do not tell its noise",
                f"export {key} of the images at rest, or leave them out",
            )
    mean = [float(values.mean()) if len(values) else np.nan for values in known]
    if np.nanmax(np.abs(mean)) > AT_REST:
        shown = ", ".join(f"{value:.2f}" for value in mean)
        yield Suspicion(
            "static_displaced",
            f"images at rest are displaced by ({shown}) mm on average",
            "take images at rest with cameras and clamp as in the reference image",
        )
