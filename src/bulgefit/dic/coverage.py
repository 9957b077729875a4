"""How much of the specimen did the camera see?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FIELD", "coverage", "is_near_centre_only"]

Floats = NDArray[np.floating]

#: Coverage from which points are a field rather than lines or a patch.
FIELD = 0.5
# Measured points reach at least this part of the clamp radius.
_NEAR_CENTRE = 0.5
# Square bins of a tenth of the radius: wider than the spacing of any usable field.
_BINS = 20
# Each bin's share of the disc is found from this many samples a side.
_SAMPLES = 8


def coverage(reference: Floats, radius: float) -> tuple[float, tuple[float, ...]]:
    """Part of the clamp's disc in whose bins at least one point lies.

    Parameters
    ----------
    reference : (n, 3) array, mm
    radius : float, mm

    Returns
    -------
    whole : float
        Part of the disc's area, 0 to 1.
    quadrants : tuple of four floats
        The same of each quadrant: x > 0 and y > 0 first, then counter-clockwise.
    """
    area = _bin_areas()
    index = np.floor((reference[:, :2] / radius + 1) * _BINS / 2).astype(int)
    index = index.clip(0, _BINS - 1)
    seen = np.zeros_like(area)
    seen[index[:, 0], index[:, 1]] = 1.0
    seen *= area
    low, high = slice(0, _BINS // 2), slice(_BINS // 2, _BINS)
    quadrants = [(high, high), (low, high), (low, low), (high, low)]
    parts = tuple(float(seen[part].sum() / area[part].sum()) for part in quadrants)
    return float(seen.sum() / area.sum()), parts


def is_near_centre_only(reach: float, radius: float) -> bool:
    """Whether the farthest point (mm) leaves most of the clamp's disc unseen."""
    return reach < _NEAR_CENTRE * radius


def _bin_areas() -> NDArray[np.float64]:
    count = _BINS * _SAMPLES
    centre = (np.arange(count) + 0.5) / count * 2 - 1
    inside = centre[:, None] ** 2 + centre**2 < 1
    return inside.reshape(_BINS, _SAMPLES, _BINS, _SAMPLES).sum(axis=(1, 3)).astype(np.float64)
