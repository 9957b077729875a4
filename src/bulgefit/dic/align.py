"""How is a cloud of points, as the cameras saw it, laid into the frame of the clamp?

The clamp's plane becomes z = 0 and its centre the origin: first by the outline of the cloud, which
is seen from afar, then by where the heights fall to zero, which is finer (`bulgefit.dic.rim`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic import mend
from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.outliers import stray_points
from bulgefit.dic.rim import rim_of, rim_semi_axes
from bulgefit.dic.rim_motion import rim_motions
from bulgefit.errors import InputError

__all__ = ["Pose", "by_marks", "centred", "masked", "on_plane", "pose_of", "without_strays"]

Floats = NDArray[np.floating]

# Turning and shifting change the outline a little; it settles like a geometric series.
_ROUNDS = 4
# Movement, mm, below which the centre has settled: far below what heights tell.
_SETTLED = 1e-3
# Part of the radius by which the origin may be off while the heights' linear estimate holds.
_NEAR = 0.05


@dataclass(frozen=True)
class Pose:
    """How a test lies to the clamp, and what it holds. None stands where the points do not tell.

    Attributes
    ----------
    tilt_deg : float or None, degree
        Of the plane through the outer points of the reference.
    height_mm : float or None, mm
        Of that plane at the origin.
    outline_centre_mm : (x, y), mm
        Of a circle through the outline of the points.
    outline_radius_mm : float, mm
    rim_centre_mm, rim_centre_error_mm : (x, y) or None, mm
        Where the heights fall to zero.
    rim_radius_mm, rim_radius_error_mm : float or None, mm
    rim_semi_axes_mm, rim_semi_axes_error_mm : (along x, along y) or None, mm
        Of the ellipse on which the heights fall to zero.
    rim_rotation_deg, rim_shift_mm : float or None
        The largest rigid motion of the rim in any frame. This and the rim are told where the test
        lies near the clamp's frame.
    strays : int
        Displacements far off their neighbours, over all frames.
    points, measured : int
        Distinct points, and measured ones over all frames.
    """

    tilt_deg: float | None
    height_mm: float | None
    outline_centre_mm: tuple[float, float]
    outline_radius_mm: float
    rim_centre_mm: tuple[float, float] | None
    rim_centre_error_mm: tuple[float, float] | None
    rim_radius_mm: float | None
    rim_radius_error_mm: float | None
    rim_semi_axes_mm: tuple[float, float] | None
    rim_semi_axes_error_mm: tuple[float, float] | None
    rim_rotation_deg: float | None
    rim_shift_mm: float | None
    strays: int
    points: int
    measured: int


def pose_of(test: BulgeTest) -> Pose:
    """How a test lies to the clamp."""
    centre, radius = outline(test)
    tilt, height = _plane(test)
    near = tilt is not None and np.hypot(*centre) < _NEAR * test.radius
    rim, oval = (rim_of(test), rim_semi_axes(test)) if near else (None, None)
    rotation, shift = _motion(test) if near else (None, None)
    return Pose(
        tilt_deg=tilt,
        height_mm=height,
        outline_centre_mm=_pair(centre),
        outline_radius_mm=radius,
        rim_centre_mm=None if rim is None else _pair(rim.centre),
        rim_centre_error_mm=None if rim is None else _pair(rim.centre_error),
        rim_radius_mm=None if rim is None else rim.radius,
        rim_radius_error_mm=None if rim is None else rim.radius_error,
        rim_semi_axes_mm=None if oval is None else _pair(oval[0]),
        rim_semi_axes_error_mm=None if oval is None else _pair(oval[1]),
        rim_rotation_deg=rotation,
        rim_shift_mm=shift,
        strays=sum(int(_strays(test, i).sum()) for i in range(test.n_frames)),
        points=test.n_points,
        measured=test.n_measured,
    )


def _plane(test: BulgeTest) -> tuple[float | None, float | None]:
    """Tilt (degree) and height (mm) of the plane through the outer points."""
    try:
        point, normal = mend.rim_plane(test)
    except InputError:
        return None, None
    return float(np.rad2deg(np.arccos(min(normal[2], 1.0)))), float(point[2])


def _motion(test: BulgeTest) -> tuple[float | None, float | None]:
    """The largest rotation (degree) and shift (mm) of the rim."""
    try:
        rotation, shift = rim_motions(test)
    except InputError:
        return None, None
    largest = [float(np.nanmax(np.linalg.norm(part, axis=1))) for part in (rotation, shift)]
    return float(np.rad2deg(largest[0])), largest[1]


def _pair(values: Floats) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def outline(test: BulgeTest) -> tuple[Floats, float]:
    """Centre (2,) and radius (mm) of a circle through the convex hull of the measured points.

    Of an ellipse like the clamp's where that is one; its radius is the mean of the semi-axes.

    The least-squares circle of Kåsa (IEEE Trans. Instrum. Meas. 25, 1976), which is linear.

    Raises
    ------
    InputError
        No point is measured.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = test.on_circle(_measured(test))
    if not len(points):
        raise InputError(f"{test.source or test.name}: no measured point is left")
    middle = points.mean(axis=0)
    try:
        hull = points[ConvexHull(points).vertices] - middle
        basis = np.column_stack([2 * hull, np.ones(len(hull))])
        found = np.linalg.lstsq(basis, (hull**2).sum(axis=1), rcond=None)[0]
    except QhullError:
        # one point, or points on a line
        return middle * test.stretch, float(np.hypot(*(points - middle).T).max())
    centre = (middle + found[:2]) * test.stretch
    return centre, float(np.sqrt(found[2] + found[:2] @ found[:2]))


def _measured(test: BulgeTest) -> Floats:
    return np.concatenate([block.reference[block.measured.any(axis=0)] for block in test.blocks])


def on_plane(test: BulgeTest) -> BulgeTest:
    """Turn and shift a test so that the plane through its outer points is z = 0.

    The outer points are those beyond nine tenths of the outline's radius. It turns about the
    outline's centre, which keeps its x and y.

    Raises
    ------
    InputError
        Too few points lie there, or on one side only.
    """
    away = np.zeros(2)
    for _ in range(_ROUNDS):
        centre, radius = outline(test)
        test = mend.shifted(test, np.append(-centre, 0.0))
        away += centre
        # the outline may be smaller than the clamp: its own radius says what lies outside
        inner = mend.levelled(replace(test, radius=radius), "leave the plane with --no-plane")
        test = replace(inner, radius=test.radius)
    return mend.shifted(test, np.append(away, 0.0))


def centred(test: BulgeTest) -> BulgeTest:
    """Shift a test in plane to the clamp's centre: the outline's, then that of the heights.

    An origin that the heights do not tell from the clamp's centre stays: what they say is no better
    than where it lies.
    """
    centre, _ = outline(test)
    far = np.hypot(*centre) > _NEAR * test.radius
    if far:
        test = mend.shifted(test, np.append(-centre, 0.0))
    for turn in range(_ROUNDS):
        rim = rim_of(test)
        if rim is None:
            centre, _ = outline(test)
            return mend.shifted(test, np.append(-centre, 0.0))
        if turn == 0 and not far and (np.abs(rim.centre) <= rim.centre_error).all():
            return test
        test = mend.shifted(test, np.append(-rim.centre, 0.0))
        if np.hypot(*rim.centre) < _SETTLED:
            break
    return test


def by_marks(test: BulgeTest, marks: Sequence[float]) -> BulgeTest:
    """Turn a test about z so that the warp runs through two marks.

    Parameters
    ----------
    test : BulgeTest
    marks : (x1, y1, x2, y2), mm
        Two positions on one warp yarn, in the frame of the test. x comes to run along it, in the
        direction that is nearer the old x.

    Raises
    ------
    InputError
        The marks are one point.
    """
    x1, y1, x2, y2 = marks
    if (x1, y1) == (x2, y2):
        raise InputError("--marks: the two marks are one point; give two on one warp yarn")
    angle = np.rad2deg(np.arctan2(y2 - y1, x2 - x1))
    return along_warp(test, float((angle + 90) % 180 - 90))


def along_warp(test: BulgeTest, angle: float) -> BulgeTest:
    """Turn a test about z so that x runs along the warp, which lies at an angle (degree) to it."""
    return replace(test.rotated(-angle), warp_angle=None)


def masked(test: BulgeTest, discs: Sequence[Sequence[float]]) -> BulgeTest:
    """Leave out the points within discs (x, y, radius), mm: glare, a seam, a sensor."""
    return replace(
        test,
        blocks=tuple(_without(block, _hit(block.reference, discs)) for block in test.blocks),
        static_displacement=None
        if test.static_displacement is None
        else test.static_displacement[:, ~_hit(test.blocks[0].reference, discs)],
    )


def _hit(points: Floats, discs: Sequence[Sequence[float]]) -> NDArray[np.bool_]:
    hit = np.zeros(len(points), dtype=bool)
    for x, y, radius in discs:
        hit |= np.hypot(points[:, 0] - x, points[:, 1] - y) <= radius
    return hit


def _without(block: Block, hit: NDArray[np.bool_]) -> Block:
    return Block(block.reference[~hit], block.frames, block.displacement[:, ~hit])


def without_strays(test: BulgeTest) -> BulgeTest:
    """Mark displacements far off those of their neighbours as lost (`stray_points`)."""
    blocks = []
    for block in test.blocks:
        moved = block.displacement.copy()
        for row in moved:
            row[stray_points(block.reference, row, test.radius)] = np.nan
        blocks.append(Block(block.reference, block.frames, moved))
    return replace(test, blocks=tuple(blocks))


def _strays(test: BulgeTest, frame: int) -> NDArray[np.bool_]:
    reference, displacement = test.frame(frame)
    return stray_points(reference, displacement, test.radius)
