"""From which frame on does the fabric deform in bands, which no mesh-independent model follows?"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bulgefit.dic.noise import rough_part

__all__ = ["BANDS", "excess_roughness", "first_with_bands"]

Floats = NDArray[np.float64]

#: Roughness, over what it can be by an earlier frame, above which there are bands. Between what
#: shapes that keep their stability reach and what those that lost it do (`benchmarks/bands.py`).
BANDS = 2.5
#: mm: beyond it a single point is a stray.
_STRAY = 1.0


def excess_roughness(points: Floats, displacement: Floats) -> Floats:
    """How much rougher each frame is than noise and a smooth field can make it; 0 for three frames.

    What a quadratic surface leaves of a field that keeps its form grows in proportion to that, and
    noise does not grow: by an earlier frame the roughness is no more than its own, times the growth
    of the field. Bands come within frames. The tightest such bound holds, of medians of three
    frames in a row: one frame alone may be smoother than others.

    Parameters
    ----------
    points : (points, 2) array, mm
    displacement : (frames, points, 3) array, mm
        In the order of pressure; NaN where a point was not measured.

    Returns
    -------
    (frames,) array
    """
    rough = np.clip(rough_part(points, displacement), -_STRAY, _STRAY)
    field = np.stack([_without_motion(points, frame[:, :2]) for frame in displacement])
    level, size = (np.sqrt(np.nanmean(d[..., :2] ** 2, axis=(1, 2))) for d in (rough, field))
    growth = np.maximum(size[:, None] / np.maximum(size, np.finfo(float).tiny), 1.0)
    # a frame without any roughness is no measurement, and bounds nothing
    bound = np.where(level > 0.0, level, np.inf) * growth
    medians = np.median(sliding_window_view(bound, 3, axis=1), axis=2)
    excess = np.zeros(len(level))
    for frame in range(3, len(level)):
        excess[frame] = level[frame] / medians[frame, : frame - 2].min()
    return excess


def _without_motion(points: Floats, field: Floats) -> Floats:
    """In-plane field (points, 2) less the shift and turn of the camera that show in it.

    They leave no roughness, and would hide how much the field itself has grown.
    """
    x, y = points.T
    one, none = np.ones_like(x), np.zeros_like(x)
    # rows dx and dy of each point; columns the shifts and a turn
    basis = np.stack([[one, none], [none, one], [-y, x]], axis=-1).swapaxes(0, 1)
    seen = np.isfinite(field).all(axis=1)
    found, *_ = np.linalg.lstsq(basis[seen].reshape(-1, 3), field[seen].ravel(), rcond=None)
    return np.asarray(field - basis @ found)


def first_with_bands(points: Floats, displacement: Floats) -> int | None:
    """The frame from which on each has bands; None where the last has none.

    Parameters
    ----------
    points, displacement
        As of `excess_roughness`.
    """
    smooth = np.flatnonzero(excess_roughness(points, displacement) <= BANDS)
    first = int(smooth[-1]) + 1
    return first if first < len(displacement) else None
