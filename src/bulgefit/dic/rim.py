"""Where is the clamp's rim? Where the heights, continued outwards, fall to zero.

About the clamp's centre c the heights of a frame are w = (1 - |x - c|^2/a^2) q(x) with a smooth q.
To first order in c that is (1 - |x|^2/a^2) q + 2 (x . c)/a^2 q, so that on the circle about the
origin a height that grows along c is left. It is in proportion to q at the rim, which grows as the
cube root of pressure, where a tilt of the reference stays the same and one of the fixture grows
with pressure: many frames tell them apart. Likewise a clamp of radius a (1 + d) leaves 2 d q all
around, and one of semi-axes a (1 + e) and a (1 - e) leaves 2 e q (x^2 - y^2)/a^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.coverage import coverage
from bulgefit.dic.cut_bins import of_whole_bins

__all__ = ["Rim", "rim_of", "rim_semi_axes"]

Floats = NDArray[np.floating]

_FEWEST_POINTS = 100
# Frames: three unknowns are told apart, and one more shows whether they fit.
_FEWEST_FRAMES, _MOST_FRAMES = 4, 12
# Points of a frame that are looked at: more do not make the centre surer than the model is.
_MOST_POINTS = 4000
# Part of the disc whose points tell how the heights go on to the rim.
_FIELD = 0.5
# Degrees of q. They tell alike where heights are as the text above says.
_DEGREES = (2, 4)
_ERRORS = 3.0


@dataclass(frozen=True)
class Rim:
    """The clamp's rim as the heights tell it.

    The errors are how far it may be off: half the range of what two smooth fields, with and
    without a moving fixture, say, and three standard errors.

    Attributes
    ----------
    centre, centre_error : (2,) arrays, mm
    radius, radius_error : float, mm
    """

    centre: Floats
    centre_error: Floats
    radius: float
    radius_error: float


def rim_of(test: BulgeTest) -> Rim | None:
    """The clamp's rim; None where points or frames are too few to tell."""
    found = _estimates(test, oval=False)
    if found is None:
        return None
    (x, y, growth), (x_error, y_error, growth_error) = found * test.radius
    return Rim(
        np.array([x, y]) * test.stretch,
        np.array([x_error, y_error]) * test.stretch,
        test.radius + float(growth),
        float(growth_error),
    )


def rim_semi_axes(test: BulgeTest) -> tuple[Floats, Floats] | None:
    """Semi-axes along x and y on which the heights fall to zero, and how far they may be off.

    Returns
    -------
    semi_axes, error : (2,) arrays, mm
        None where points or frames are too few to tell.
    """
    found = _estimates(test, oval=True)
    if found is None:
        return None
    (growth, oval), (growth_error, oval_error) = found[:, 2:]
    grown = 1 + np.array([growth + oval, growth - oval])
    return test.semi_axes * grown, test.semi_axes * (growth_error + oval_error)


def _estimates(test: BulgeTest, oval: bool) -> Floats | None:
    """Centre and growth (and ellipticity) of the rim, over the radius, and how far they are off.

    Rows of (2, 3 or 4); None where points or frames are too few to tell.
    """
    test, _ = of_whole_bins(test)
    order = np.argsort(test.pressure, kind="stable")
    at = np.unique(np.linspace(0, test.n_frames - 1, _MOST_FRAMES).astype(int))
    frames = [_heights(test, int(frame)) for frame in order[at]]
    load = np.array([test.pressure[i] for i, found in zip(order[at], frames, strict=True) if found])
    fields = [found for found in frames if found]
    if len(fields) < _FEWEST_FRAMES or np.ptp(load) == 0:
        return None
    estimates, errors = [], []
    for degree in _DEGREES:
        left, at_rim = zip(
            *(_left_at_rim(points, dz, degree, oval) for points, dz in fields), strict=True
        )
        for moving in (False, True):
            found = _in_proportion(np.array(left), np.array(at_rim), load, moving)
            estimates.append(found[0])
            errors.append(found[1])
    low, high = np.min(estimates, axis=0), np.max(estimates, axis=0)
    return np.stack([(low + high) / 2, (high - low) / 2 + _ERRORS * np.max(errors, axis=0)])


def _heights(test: BulgeTest, frame: int) -> tuple[Floats, Floats] | None:
    reference, displacement = test.frame(frame)
    known = np.flatnonzero(np.isfinite(displacement[:, 2]))
    points = test.on_circle(reference[known])
    if len(known) < _FEWEST_POINTS or coverage(points, test.radius)[0] < _FIELD:
        return None
    some = slice(None, None, -(-len(known) // _MOST_POINTS))
    return points[some] / test.radius, displacement[known[some], 2] / test.radius


def _left_at_rim(points: Floats, dz: Floats, degree: int, oval: bool) -> tuple[Floats, float]:
    """What grows along x and y on the circle and is left all around, and the mean of q on it.

    What grows as x^2 - y^2 comes last where `oval` asks for it.
    """
    x, y = points.T
    inside = 1 - (points**2).sum(axis=1)
    smooth = _powers(points, degree)
    rim = [points, np.ones(len(points)), *([x**2 - y**2] if oval else [])]
    basis = np.column_stack([inside[:, None] * smooth, *rim])
    found = np.linalg.lstsq(basis, dz, rcond=None)[0]
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    count = smooth.shape[1]
    return found[count:], float((_powers(circle, degree) @ found[:count]).mean())


def _powers(points: Floats, degree: int) -> Floats:
    x, y = points.T
    return np.column_stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)])


def _in_proportion(
    left: Floats, at_rim: Floats, load: Floats, moving: bool
) -> tuple[Floats, Floats]:
    """c/a and d from the part of what is left that goes with q, and their standard errors."""
    columns = [2 * at_rim, np.ones_like(at_rim)] + ([load / load.max()] if moving else [])
    basis = np.column_stack(columns)
    found = np.linalg.lstsq(basis, left, rcond=None)[0]
    freedom = len(basis) - basis.shape[1]
    variance = ((left - basis @ found) ** 2).sum(axis=0) / freedom
    return found[0], np.sqrt(variance * np.linalg.pinv(basis.T @ basis)[0, 0])
