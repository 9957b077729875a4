"""Where a path's dense output is not within its tolerance, what shapes are there?

Beyond ellipticity a path leads over snaps, and on by descent: between levels that lie on either
side of one it says nothing, of shapes as little as of their derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import SolveError
from bulgefit.model.description import CONSTANTS, Description
from bulgefit.model.forces import Change
from bulgefit.model.inflation import Inflation, Shapes, about
from bulgefit.parallel.threads import side_by_side

__all__ = ["balanced_where_coarse"]

Floats = NDArray[np.float64]


def balanced_where_coarse(
    inflation: Inflation,
    shapes: Shapes,
    given: Description,
    changes: Mapping[str, Change],
    threads: int,
) -> Shapes:
    """Shapes along a path, balanced in the frames for which its levels are too far apart.

    At a singular point there may be no balanced shape near by; what the dense output has there is
    kept, with its error, where that is known.

    Raises
    ------
    SolveError
        No shape is found where nothing is known of the dense output's error.
    """
    pressure = np.maximum(given.load.balanced, 0.0)
    constants = any(name in CONSTANTS for name in changes)
    path = inflation.path(given, shapes.values, constants)  # the one that was kept
    errors = path.errors_at(pressure)
    coarse = np.flatnonzero(errors > inflation.setup.tolerance * inflation.radius / 100.0)
    if not len(coarse):
        return replace(shapes, error=float(errors.max(initial=0.0)))
    starts = about(path, pressure[coarse])

    def one(place: int) -> Shapes | None:
        frame = coarse[place : place + 1]
        own = {name: change.in_frames(frame) for name, change in changes.items()}
        start = starts[:, place : place + 1]
        try:
            return inflation.balanced(given.in_frames(frame), shapes.values, own, start, 1)
        except SolveError:
            if not np.isfinite(errors[frame[0]]):
                raise
            return None

    found = side_by_side(one, range(len(coarse)), threads)
    every = dict(zip(coarse.tolist(), found, strict=True))
    own = {frame: shape for frame, shape in every.items() if shape is not None}
    left = np.delete(errors, list(own))
    return replace(_with(shapes, own), error=float(left.max(initial=0.0)))


def _with(shapes: Shapes, found: Mapping[int, Shapes]) -> Shapes:
    """Shapes with those that were found for some frames; stable where both are."""
    displacement, stable = shapes.displacement.copy(), shapes.stable.copy()
    derivative = {name: rate.copy() for name, rate in shapes.derivative.items()}
    wrinkled = None if shapes.wrinkled is None else shapes.wrinkled.copy()
    for frame, own in found.items():
        displacement[frame] = own.displacement[0]
        stable[frame] &= own.stable[0]
        for name, rate in own.derivative.items():
            derivative[name][frame] = rate[0]
        if wrinkled is not None and own.wrinkled is not None:
            wrinkled[frame] = own.wrinkled[0]
    work = shapes.factorisations + sum(own.factorisations for own in found.values())
    return replace(
        shapes, displacement=displacement, derivative=derivative, stable=stable,
        wrinkled=wrinkled, factorisations=work,
    )  # fmt: skip
