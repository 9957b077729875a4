"""What looks wrong with a test that can be read all the same?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.outliers import stray_points

__all__ = ["alarms", "suspicions"]

Floats = NDArray[np.floating]

_FEW_FRAMES = 5
# Highest pressures, MPa, between which a test on a fabric is expected (0.02 to 10 bar).
_USUAL_PRESSURE = (0.002, 1.0)
# Measured points reach at least this part of the clamp radius.
_NEAR_CENTRE = 0.5
# A reference image is flat to this, mm; beyond it an initial shape matters.
_FLAT = 0.5
# Mean z of the reference, relative to the clamp radius: beyond it z = 0 is another plane.
_OFF_PLANE = 0.1
# Part of the points that may be lost without a word.
_FEW_LOST = 0.05
# Coverage from which points are a field rather than lines or a patch.
_FIELD = 0.5
# Quadrants may differ by this in coverage.
_UNEVEN = 0.15
# A mean displacement in plane, mm, and its part of the largest one, which symmetry forbids.
_OFFSET, _OFFSET_PART = 0.1, 0.1
# An apex may fall by this, mm, between frames of rising pressure: noise.
_APEX_FALL = 0.05
# Young's modulus, MPa, that no material exceeds: diamond.
_STIFFEST = 1e6
# An apex grows by more than this part where the pressure doubles; that of a membrane by a quarter.
_NO_GROWTH = 0.05
# Displacement, mm, that may be seen at rest.
_AT_REST = 0.1
# Points in which strays are looked for, over all frames: keeps large tests to a few seconds.
_POINTS_LOOKED_AT = 400_000


def suspicions(
    test: BulgeTest,
    points: Floats,
    per_frame: NDArray[np.int_],
    coverage: float,
    quadrants: tuple[float, ...],
) -> Iterator[str]:
    """One line for each thing that looks wrong.

    Parameters
    ----------
    test : BulgeTest
    points : (n, 3) array, mm
        Reference of the measured points.
    per_frame : (frames,) int array
        Measured points of each frame.
    coverage : float
    quadrants : tuple of four floats
        What `bulgefit.dic.coverage.coverage` says of `points`.
    """
    yield from alarms(test)
    yield from _about_order(test)
    yield from _about_points(test, per_frame)
    if len(points) == 1:
        yield "one point only: its rise can be fitted (e_z), a field cannot"
    else:
        yield from _about_coverage(test, points, coverage, quadrants)
        yield from _about_reference_z(points, test.radius)
    yield from _about_apex(test)
    yield from _about_rest(test)
    yield from _about_offset(test, coverage)
    yield from _about_strays(test)


def alarms(test: BulgeTest) -> Iterator[str]:
    """One line for each thing by which whatever is fitted to the test means nothing.

    Units and directions alone: that takes no time.
    """
    low, high = _USUAL_PRESSURE
    if not low <= test.pressure.max() <= high:
        yield (
            f"highest pressure is {test.pressure.max() * 10:.3g} bar: are the pressures in the "
            "unit that the file says or asks for?"
        )
    known = np.flatnonzero(np.isfinite(test.apex_displacement))
    if len(known):
        if test.apex_displacement[known[test.pressure[known].argmax()]] < 0:
            yield "the apex moves to -z under pressure: the z axis points into the specimen"
        yield from _about_rise(test, known)


def _about_order(test: BulgeTest) -> Iterator[str]:
    if not test.pressure_increases:
        frame = int(np.flatnonzero(np.diff(test.pressure) <= 0)[0]) + 1
        yield f"pressure does not increase at frame {frame}: unloading, or frames out of order"
    if test.n_frames < _FEW_FRAMES:
        yield f"only {test.n_frames} frames: little to tell stiffness from other effects"
    if test.time is not None and (np.diff(test.time) <= 0).any():
        frame = int(np.flatnonzero(np.diff(test.time) <= 0)[0]) + 1
        yield f"time does not increase at frame {frame}: frames out of order"


def _about_points(test: BulgeTest, per_frame: NDArray[np.int_]) -> Iterator[str]:
    empty = np.flatnonzero(per_frame == 0)
    if len(empty):
        yield f"{len(empty)} frames without any measured point, first frame {empty[0]}"
    most = int(per_frame.max())
    lost = 1 - per_frame.sum() / (most * test.n_frames)
    if lost > _FEW_LOST:
        frame = int(per_frame.argmin())
        yield (
            f"{lost:.0%} of the points are lost against the fullest frame; "
            f"most at frame {frame} ({per_frame[frame]} of {most} left)"
        )
    for i, key in enumerate(("dx", "dy", "dz")):
        known = sum(int(np.isfinite(block.displacement[..., i]).sum()) for block in test.blocks)
        if not known:
            yield f"{key} was never measured"
        elif known < (1 - _FEW_LOST) * test.n_measured:
            yield f"{key} is missing at {1 - known / test.n_measured:.0%} of the measured points"


def _about_coverage(
    test: BulgeTest, points: Floats, coverage: float, quadrants: tuple[float, ...]
) -> Iterator[str]:
    reach = float(np.hypot(points[:, 0], points[:, 1]).max())
    if reach < _NEAR_CENTRE * test.radius:
        yield (
            f"points only near the centre: the farthest is at {reach:.4g} mm of "
            f"{test.radius:g} mm; check units and radius"
        )
    elif coverage < _FIELD:
        yield f"points cover {coverage:.0%} of the disc only"
    elif max(quadrants) - min(quadrants) > _UNEVEN:
        parts = ", ".join(f"{part:.0%}" for part in quadrants)
        yield f"coverage is uneven (quadrants {parts}): a hole or shadow on one side"


def _about_reference_z(points: Floats, radius: float) -> Iterator[str]:
    z = points[:, 2]
    if not z.any():
        yield "reference z was not kept (all 0): an initial shape shows in dz alone"
    elif len(points) >= 10:
        basis = np.column_stack([np.ones(len(points)), points[:, :2]])
        off = z - basis @ np.linalg.lstsq(basis, z, rcond=None)[0]
        if np.ptp(off) > _FLAT:
            yield f"reference is not flat: z departs from a plane by {np.ptp(off):.2g} mm in all"
        if np.abs(z.mean()) > _OFF_PLANE * radius:
            yield f"reference z is {z.mean():.3g} mm on average: the clamp's plane must be z = 0"


def _about_apex(test: BulgeTest) -> Iterator[str]:
    known = np.flatnonzero(np.isfinite(test.apex_displacement))
    if not len(known):
        yield "dz was never measured at the apex"
        return
    order = known[np.argsort(test.pressure[known], kind="stable")]
    rise = test.apex_displacement[order]
    falls = np.flatnonzero(np.diff(rise) < -_APEX_FALL)
    if len(falls) and rise[-1] >= 0:
        before, after = order[falls[0]], order[falls[0] + 1]
        yield (
            f"the apex does not grow with pressure at {len(falls)} of {len(order) - 1} steps, "
            f"first from frame {before} to {after}: creep, unloading or mixed frames"
        )


def _about_rise(test: BulgeTest, known: NDArray[np.intp]) -> Iterator[str]:
    first, last = known[test.pressure[known].argmin()], known[test.pressure[known].argmax()]
    low, high = (float(test.pressure[frame]) for frame in (first, last))
    before, after = (float(test.apex_displacement[frame]) for frame in (first, last))
    least = _least_rise(test, int(last))
    if abs(after) < least:
        yield (
            f"the apex rises by {abs(after):.2g} mm at {high * 10:.3g} bar, where the stiffest "
            f"material would rise by {least:.2g} mm: is the displacement in mm?"
        )
    elif high > 2 * low and abs(after - before) < _NO_GROWTH * abs(after):
        yield (
            f"the apex stands at {before:.4g} mm at {low * 10:.3g} bar and at {after:.4g} mm at "
            f"{high * 10:.3g} bar: the displacement does not change with pressure"
        )


def _least_rise(test: BulgeTest, frame: int) -> float:
    """What the stiffest membrane would show at the apex point of a frame, mm."""
    pressure = max(float(test.pressure[frame]), 0.0)
    (block,) = (block for block in test.blocks if frame in block.frames)
    x, y, _ = block.reference[test.apex[frame]]
    # p = 3 E t w^3 / R^4, in which the factor is near that of a clamped isotropic disc
    at_centre = np.cbrt(pressure * test.radius**4 / (3 * _STIFFEST * test.thickness))
    return float(at_centre * max(1 - (x**2 + y**2) / test.radius**2, 0.0))


def _about_rest(test: BulgeTest) -> Iterator[str]:
    if test.static_displacement is not None:
        yield from _about_images_at_rest(test.static_displacement)
    frame = int(np.abs(test.pressure).argmin())
    rise = test.apex_displacement[frame]
    if abs(test.pressure[frame]) < 1e-3 * test.pressure.max() and abs(rise) > _AT_REST:
        yield f"at rest (frame {frame}) the apex already stands at {rise:.2f} mm"


def _about_images_at_rest(static: Floats) -> Iterator[str]:
    known = [component[np.isfinite(component)] for component in static.reshape(-1, 3).T]
    for key, values in zip(("dx", "dy", "dz"), known, strict=True):
        if not len(values):
            yield f"{key} was never measured in the images at rest: they do not tell its noise"
    mean = [float(values.mean()) if len(values) else np.nan for values in known]
    if np.nanmax(np.abs(mean)) > _AT_REST:
        shown = ", ".join(f"{value:.2f}" for value in mean)
        yield f"images at rest are displaced by ({shown}) mm on average"


def _about_offset(test: BulgeTest, coverage: float) -> Iterator[str]:
    # the mean over a lopsided field is not 0 even where all is well
    if coverage < _FIELD:
        return
    frame = int(test.pressure.argmin())
    _, displacement = test.frame(frame)
    in_plane = displacement[np.isfinite(displacement).all(axis=1), :2]
    if len(in_plane) < 20:
        return
    offset = in_plane.mean(axis=0)
    if np.abs(offset).max() > max(_OFFSET, _OFFSET_PART * np.abs(in_plane - offset).max()):
        yield (
            f"at the lowest pressure (frame {frame}) the mean of dx, dy is "
            f"({offset[0]:.2f}, {offset[1]:.2f}) mm where symmetry gives 0: the camera or the "
            "clamp moved"
        )


def _about_strays(test: BulgeTest) -> Iterator[str]:
    from threadpoolctl import threadpool_limits

    count = max(1, round(test.n_frames * min(1.0, _POINTS_LOOKED_AT / test.n_measured)))
    frames = np.unique(np.linspace(0, test.n_frames - 1, count).astype(int))
    # the problems are small: threads that wait for busy cores would cost more than they give
    with threadpool_limits(1):
        strays = {int(i): int(stray_points(*test.frame(i), test.radius).sum()) for i in frames}
    total = sum(strays.values())
    if total:
        worst = max(strays, key=lambda frame: strays[frame])
        looked = "" if count == test.n_frames else f" ({count} of {test.n_frames} looked at)"
        yield (
            f"{total} stray displacements, far off their neighbours, in "
            f"{sum(n > 0 for n in strays.values())} frames{looked}; most in frame {worst} "
            f"({strays[worst]})"
        )
