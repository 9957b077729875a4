"""Were enough points measured, in the right places, and without strays?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.coverage import FIELD, coverage, is_near_centre_only
from bulgefit.dic.outliers import stray_points
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_apex_hole", "about_points"]

Floats = NDArray[np.floating]

# A reference image is flat to this, mm; beyond it an initial shape matters.
_FLAT = 0.5
# Mean z of the reference, relative to the clamp radius: beyond it z = 0 is another plane.
_OFF_PLANE = 0.1
# Part of the points that may be lost without a word.
_FEW_LOST = 0.05
# Part of the rise by which a paraboloid may have fallen at the point nearest the centre: it is 6 %
# in stiffness (E t ~ w^-3).
_UNSEEN = 0.02
# Probability at which scattered points leave a disc about the centre empty by chance.
_BY_CHANCE = 1e-6
# Quadrants may differ by this in coverage.
_UNEVEN = 0.15
# Points in which strays are looked for, over all frames: keeps large tests to a few seconds.
_POINTS_LOOKED_AT = 400_000


def about_points(test: BulgeTest) -> Iterator[Suspicion]:
    """Lost points and components, coverage, the reference's plane, strays."""
    yield from _about_losses(test)
    yield from _about_components(test)
    points = np.concatenate([block.reference[block.measured.any(axis=0)] for block in test.blocks])
    if len(points) == 1:
        yield Suspicion(
            "one_point",
            "one point only: its rise can be fitted (e_z), a field cannot",
            "fit with --objective e_z, or export the whole field",
        )
    else:
        yield from _about_coverage(test, points)
        yield from about_apex_hole(test)
        yield from _about_reference_z(points, test.radius)
    yield from _about_strays(test)


def _about_losses(test: BulgeTest) -> Iterator[Suspicion]:
    per_frame = np.zeros(test.n_frames, dtype=int)
    for block in test.blocks:
        per_frame[block.frames] = block.measured.sum(axis=1)
    empty = np.flatnonzero(per_frame == 0)
    if len(empty):
        yield Suspicion(
            "empty_frames",
            f"{len(empty)} frames without any measured point, first frame {empty[0]}",
            "leave these frames out",
        )
    most = int(per_frame.max())
    lost = 1 - per_frame.sum() / (most * test.n_frames)
    if lost > _FEW_LOST:
        frame = int(per_frame.argmin())
        yield Suspicion(
            "lost_points",
            f"{lost:.0%} of the points are lost against the fullest frame; "
            f"most at frame {frame} ({per_frame[frame]} of {most} left)",
            "correlate again with larger subsets or from image to image, or leave the worst "
            "frames out",
        )


def _about_components(test: BulgeTest) -> Iterator[Suspicion]:
    for i, key in enumerate(("dx", "dy", "dz")):
        known = sum(int(np.isfinite(block.displacement[..., i]).sum()) for block in test.blocks)
        if not known:
            yield Suspicion(
                "component_never_measured",
                f"{key} was never measured",
                f"export {key}"
                + (", or fit with --objective e_z, which takes dz alone" if key != "dz" else ""),
            )
        elif known < (1 - _FEW_LOST) * test.n_measured:
            yield Suspicion(
                "component_missing",
                f"{key} is missing at {1 - known / test.n_measured:.0%} of the measured points",
                f"export {key} of all points",
            )


def _about_coverage(test: BulgeTest, points: Floats) -> Iterator[Suspicion]:
    whole, quadrants = coverage(test.on_circle(points), test.radius)
    reach = float(np.hypot(*test.on_circle(points).T).max())
    if is_near_centre_only(reach, test.radius):
        yield Suspicion(
            "near_centre_only",
            f"points only near the centre: the farthest is at {reach:.4g} mm of "
            f"{test.radius:g} mm; check units and radius",
            "bulgefit convert IN OUT --unit reference=UNIT/mm if positions are in another unit, "
            "or give --radius",
        )
    elif whole < FIELD:
        yield Suspicion(
            "low_coverage",
            f"points cover {whole:.0%} of the disc only",
            "export the whole field if there is one",
        )
    elif max(quadrants) - min(quadrants) > _UNEVEN:
        parts = ", ".join(f"{part:.0%}" for part in quadrants)
        yield Suspicion(
            "uneven_coverage",
            f"coverage is uneven (quadrants {parts}): a hole or shadow on one side",
            "correlate again where points are missing; if the field is whole, check --centre",
        )


def about_apex_hole(test: BulgeTest) -> Iterator[Suspicion]:
    """Frames without heights near the centre: a hole there, and no sparse field of points."""
    nearest, holes = [], 0
    for block in test.blocks:
        part = np.sum(test.on_circle(block.reference) ** 2, axis=1) / test.radius**2
        for known in np.isfinite(block.displacement[..., 2]):
            empty = float(part[known].min(initial=1.0))
            # of n points scattered over the disc, n part lie within, and none with exp(-n part)
            if empty > _UNSEEN and known.sum() * empty > -np.log(_BY_CHANCE):
                holes += 1
                nearest.append(np.sqrt(empty) * test.radius)
    if holes:
        yield Suspicion(
            "apex_hole",
            f"no height was measured within {max(nearest):.3g} mm of the centre in {holes} of "
            f"{test.n_frames} frames: how high the specimen rises there is not known",
            "correlate again where points are missing; --objective e_z would fit the nearest point "
            "that was measured",
        )


def _about_reference_z(points: Floats, radius: float) -> Iterator[Suspicion]:
    z = points[:, 2]
    if not z.any():
        yield Suspicion(
            "reference_z_missing",
            "reference z was not kept (all 0): an initial shape shows in dz alone",
            "export z of the reference image if it was measured",
        )
    elif len(points) >= 10:
        basis = np.column_stack([np.ones(len(points)), points[:, :2]])
        off = z - basis @ np.linalg.lstsq(basis, z, rcond=None)[0]
        if np.ptp(off) > _FLAT:
            yield Suspicion(
                "reference_not_flat",
                f"reference is not flat: z departs from a plane by {np.ptp(off):.2g} mm in all",
                "bulgefit diagnose frees initial_shape",
            )
        if np.abs(z.mean()) > _OFF_PLANE * radius:
            yield Suspicion(
                "reference_off_plane",
                f"reference z is {z.mean():.3g} mm on average: the clamp's plane must be z = 0",
                "bulgefit convert IN OUT --level",
            )


def _about_strays(test: BulgeTest) -> Iterator[Suspicion]:
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
        yield Suspicion(
            "stray_points",
            f"{total} stray displacements, far off their neighbours, in "
            f"{sum(n > 0 for n in strays.values())} frames{looked}; most in frame {worst} "
            f"({strays[worst]})",
            "bulgefit align IN OUT --drop-strays marks them as lost",
        )
