"""How did the clamp itself move before the cameras? By what the rim of each frame did.

A clamped rim stays where it is, so that what a smooth field tells there is the motion of clamp or
cameras. In plane and in height the field is (1 - r^2/a^2) q(x), which vanishes at the rim, plus a
rigid motion: a shift and three small rotations, by least squares over the frame. A rim that is
stretched or slips evenly inwards is none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.coverage import coverage
from bulgefit.errors import InputError

__all__ = ["rim_motions", "without_rim_motion"]

Floats = NDArray[np.floating]

_FEWEST_POINTS = 100
# Part of the disc whose points tell how the field goes on to the rim.
_FIELD = 0.5
# Degree of q; of even degree it holds what the bulge does, which is even in height.
_DEGREE = 4


def rim_motions(test: BulgeTest) -> tuple[Floats, Floats]:
    """Rotations (rad) and shifts (mm) of the rim.

    Returns
    -------
    rotation, shift : (frames, 3) arrays
        About x, y, z through the clamp's centre, and along them; a frame without points has NaN.

    Raises
    ------
    InputError
        The points of a frame are too few, or do not cover half the disc.
    """
    rotation, shift = np.full((2, test.n_frames, 3), np.nan)
    for i in range(test.n_frames):
        reference, displacement = test.frame(i)
        known = np.isfinite(displacement).all(axis=1)
        if not len(reference):
            continue
        if (
            known.sum() < _FEWEST_POINTS
            or coverage(test.on_circle(reference[known]), test.radius)[0] < _FIELD
        ):
            raise InputError(
                f"{test.source or test.name}: frame {i} has too few points to tell how its rim "
                "moved; leave --rigid out, or the frame"
            )
        points, moved = reference[known, :2], displacement[known].astype(np.float64)
        x, y = test.on_circle(points).T / test.radius
        inside = 1 - x**2 - y**2
        rotation[i], shift[i] = _motion(points / test.radius, moved / test.radius, inside)
    return rotation, shift * test.radius


def _motion(points: Floats, moved: Floats, inside: Floats) -> tuple[Floats, Floats]:
    x, y = points.T
    smooth = [inside * x**i * y**j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    basis = np.column_stack([*smooth, np.ones_like(x), x, y])
    found = np.linalg.lstsq(basis, moved, rcond=None)[0]
    shift, along_x, along_y = found[-3:]
    return np.array([along_y[2], -along_x[2], (along_x[1] - along_y[0]) / 2]), shift


def without_rim_motion(test: BulgeTest) -> BulgeTest:
    """Take the motion of its rim off each frame.

    The points are turned and shifted back where they are: X + u -> R^T (X + u - shift).

    Raises
    ------
    InputError
        As of `rim_motions`.
    """
    rotation, shift = rim_motions(test)
    blocks = []
    for block in test.blocks:
        moved = np.empty_like(block.displacement)
        for row, frame in enumerate(block.frames):
            seen = block.reference + block.displacement[row] - shift[frame]
            moved[row] = seen @ _rotation(rotation[frame]) - block.reference
        blocks.append(Block(block.reference, block.frames, moved))
    return replace(test, blocks=tuple(blocks))


def _rotation(vector: Floats) -> Floats:
    """The rotation (3, 3) by a vector of small angles (rad): Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if not angle > 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
