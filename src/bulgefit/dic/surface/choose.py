"""How wide should the windows be? As wide as makes the error of strain and curvature smallest.

A wide window smooths the surface, a narrow one lets the noise through. The noise's part is known
from the weights; what a quartic smooths away is told by how a sextic over the same window differs
from it, less what noise alone makes of that difference: of nested least squares the difference's
variance is that of the variances. Looked at are the apex and places half way to the rim, in frames
from the highest pressure down; errors of strain and of curvature count in parts of their own size.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.surface.local import frames_of
from bulgefit.dic.surface.shape import slopes_of, strain_and_curvature
from bulgefit.dic.surface.windows import DEGREE, fewest_points
from bulgefit.errors import InputError

__all__ = ["best_window"]

Floats = NDArray[np.float64]

#: Windows that are tried, evenly in their logarithm.
_TRIED = 12
#: Places are this part of the radius off the apex: wider windows would reach over the rim.
_OFF = 0.5
_PLACES = 8
#: Frames that are looked at.
_FRAMES = 8


def best_window(test: BulgeTest, sigma: Floats) -> float:
    """Radius (mm) of the windows, for noise (3,) mm.

    Raises
    ------
    InputError
        The points are too few for any window.
    """
    angle = 2.0 * np.pi * np.arange(_PLACES) / _PLACES
    around = _OFF * test.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    places = np.vstack([np.zeros(2), around])
    low, high = _narrowest(test, places), _OFF * test.radius
    if not low < high:
        raise InputError(
            f"{test.source or test.name}: has too few points for a window to be chosen, "
            f"{fewest_points(DEGREE + 2)} within {high:g} mm; give its radius in mm"
        )
    order = np.argsort(test.pressure, kind="stable")[::-1]
    some = test.select(frames=np.sort(order[:: -(-len(order) // _FRAMES)]))
    tried = np.geomspace(low, high, _TRIED)
    return float(tried[int(np.argmin([_error(some, places, w, sigma) for w in tried]))])


def _narrowest(test: BulgeTest, places: Floats) -> float:
    """Radius (mm) in which a sextic has points enough, at the median place of the fullest block."""
    from scipy.spatial import KDTree

    needed = fewest_points(DEGREE + 2)
    points = [block.reference[block.measured.any(axis=0), :2] for block in test.blocks]
    fullest = max(points, key=len)
    if len(fullest) < needed:
        return float(np.inf)
    return 1.05 * float(np.median(KDTree(fullest).query(places, k=[needed])[0]))


def _error(test: BulgeTest, places: Floats, window: float, sigma: Floats) -> float:
    """Mean square of the expected error of strain, plus that of curvature, in parts of theirs."""
    value, variance = _sums(test, places, window, sigma, DEGREE)
    closer, of_closer = _sums(test, places, window, sigma, DEGREE + 2)
    known = np.isfinite(value + closer).all(axis=2)
    if not known.any():
        return float(np.inf)
    noise = variance[known].mean(axis=0)
    smoothed = ((closer - value)[known] ** 2).mean(axis=0) - (of_closer[known].mean(axis=0) - noise)
    size = (value[known] ** 2).mean(axis=0)
    return float(((noise + np.maximum(smoothed, 0.0)) / size).sum())


def _sums(
    test: BulgeTest, places: Floats, window: float, sigma: Floats, degree: int
) -> tuple[Floats, Floats]:
    """Sums xx + yy of strain and of curvature, (frames, c, 2), and their variances."""
    value, variance = np.full((2, test.n_frames, len(places), 2), np.nan)

    for group in frames_of(test, places, window, degree):
        flat, spread = group.flat, group.local.covariance()

        def sums(derivatives: Floats, flat: Floats = flat) -> Floats:
            found = strain_and_curvature(derivatives, flat)
            return found[..., [0, 3]] + found[..., [1, 4]]

        for frames, here in group.parts():
            value[frames], slope = slopes_of(sums, here, window)
            through = np.einsum("fcqkd,ckl->fcqld", slope, spread)
            variance[frames] = np.einsum("fcqld,fcqld,d->fcq", through, slope, sigma**2)
    return value, variance
