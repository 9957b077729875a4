"""How do the points move in their plane when a clamped membrane is inflated?

A clamped fibre along x whose strain is even moves in plane so as to make up for its slope:
u' = e - w'^2/2 with u = 0 at both ends. On a paraboloid w = w0 (1 - r^2/a^2) that is, for fibres
along x and y alike,

    u = 2/3 (w0/a)^2 x (1 - r^2/a^2),    v = 2/3 (w0/a)^2 y (1 - r^2/a^2),

whatever the material: membranes of E1/E2 from 1/5 to 5 with soft and stiff shear have 0.9 to 1.3
times that. So the matrix C in (u, v) = 2/3 (w0/a)^2 C (x, y) (1 - r^2/a^2) is the identity where
the axes of the displacement are those of the positions, and tells how they lie where they are not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.coverage import is_near_centre_only

__all__ = ["InPlane", "in_plane"]

Floats = NDArray[np.floating]

_FEWEST_POINTS = 30
_MOST_POINTS = 4000
_FRAMES = 4


@dataclass(frozen=True)
class InPlane:
    """In-plane motion of a frame.

    Attributes
    ----------
    swelling, swelling_error : (2, 2) arrays
        C of the module's text, and its standard errors: row i is that of dx, dy.
    slope, slope_error : (2, 2) arrays
        Linear part: change of dx, dy with x, y over the whole disc, and its standard errors.
    """

    swelling: Floats
    swelling_error: Floats
    slope: Floats
    slope_error: Floats


def in_plane(test: BulgeTest) -> InPlane | None:
    """The motion in the frame that tells it best; None where no frame's points do.

    Points near the centre only tell nothing of the disc: what it does is not told by a patch.

    Frames under at least half the highest pressure are asked: there the swelling is large, and
    one of them may hold strays.
    """
    pressed = np.flatnonzero(test.pressure >= test.pressure.max() / 2)
    asked = pressed[np.unique(np.linspace(0, len(pressed) - 1, _FRAMES).astype(int))]
    found = [motion for frame in asked if (motion := _of_frame(test, int(frame))) is not None]
    return min(found, key=lambda motion: float(motion.swelling_error.max()), default=None)


def _of_frame(test: BulgeTest, frame: int) -> InPlane | None:
    reference, displacement = test.frame(frame)
    # more points say no more of five numbers
    step = max(1, len(reference) // _MOST_POINTS)
    known = np.isfinite(displacement[::step]).all(axis=1)
    rise = test.apex_displacement[frame]
    if known.sum() < _FEWEST_POINTS or not abs(rise) > 0:
        return None
    x, y = test.on_circle(reference[::step][known]).T / test.radius
    if is_near_centre_only(float(np.hypot(x, y).max()), 1.0):
        return None
    moved = displacement[::step][known, :2].astype(np.float64) / test.radius
    bulge = 1 - x**2 - y**2
    basis = np.column_stack([x * bulge, y * bulge, x, y, np.ones_like(x)])
    if np.linalg.matrix_rank(basis) < basis.shape[1]:
        return None
    found = np.linalg.lstsq(basis, moved, rcond=None)[0]
    variance = ((moved - basis @ found) ** 2).sum(axis=0) / (len(x) - basis.shape[1])
    error = np.sqrt(np.diag(np.linalg.inv(basis.T @ basis))[:, None] * variance)
    expected = 2 / 3 * (rise / test.radius) ** 2
    return InPlane(found[:2].T / expected, error[:2].T / expected, found[2:4].T, error[2:4].T)
