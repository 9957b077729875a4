"""What is in a bulge test? Counts, ranges and coverage in numbers that fit on a page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.coverage import coverage
from bulgefit.dic.suspicions import Suspicion, suspicions

__all__ = ["TestInfo", "describe"]

Range = tuple[float, float] | None


@dataclass(frozen=True)
class TestInfo:
    """A summary of a test. None stands where there is no value.

    Attributes
    ----------
    name, source, checksum : str
    radius, thickness : float, mm
    semi_axes : (along x, along y) or None, mm
        Of an elliptic clamp, whose radius is their mean.
    poisson_ratio : float
    n_frames : int
    n_blocks : int
        1 where the frames share their points.
    n_points : int
        Distinct points.
    n_measured : int
        Measured points, summed over the frames.
    n_lost : int
        Points of a frame's block without any measured component, summed over the frames.
    points_per_frame : tuple of int
        Measured points of each frame.
    reference_range : tuple of three (low, high), mm
        Of the measured points' x, y, z.
    largest_radius : float, mm
        Of the measured points.
    displacement_range : tuple of three (low, high) or None, mm
        Of dx, dy, dz; None where a component was never measured.
    coverage : float
        Part of the disc's area with measured points, 0 to 1.
    coverage_quadrants : tuple of four floats
        The same of the quadrants, counter-clockwise from x > 0, y > 0.
    pressure_bar : tuple of float, bar
    pressure_increases : bool
    apex_mm : tuple of float or None, mm
        dz of the point nearest the centre at each frame.
    duration_s : float or None, s
    n_static : int
        Images at rest.
    static_noise_mm : tuple of three floats or None, mm
        Standard deviation of dx, dy, dz about each point's mean over the images at rest.
    history : tuple of str
        What was done to the test before, one line each.
    warnings : tuple of Suspicion
        What looks wrong: code, text and remedy of each.
    """

    __test__ = False  # keeps pytest from collecting a class of this name

    name: str
    source: str
    checksum: str
    radius: float
    thickness: float
    semi_axes: tuple[float, float] | None
    poisson_ratio: float
    warp_angle: float | None
    n_frames: int
    n_blocks: int
    n_points: int
    n_measured: int
    n_lost: int
    points_per_frame: tuple[int, ...]
    reference_range: tuple[Range, ...]
    largest_radius: float
    displacement_range: tuple[Range, ...]
    coverage: float
    coverage_quadrants: tuple[float, ...]
    pressure_bar: tuple[float, ...]
    pressure_increases: bool
    apex_mm: tuple[float | None, ...]
    duration_s: float | None
    n_static: int
    static_noise_mm: tuple[float | None, ...] | None
    history: tuple[str, ...]
    warnings: tuple[Suspicion, ...]


def describe(test: BulgeTest) -> TestInfo:
    """Summarise a test and say what looks wrong with it."""
    measured = [block.measured for block in test.blocks]
    points = np.concatenate(
        [
            block.reference[seen.any(axis=0)]
            for block, seen in zip(test.blocks, measured, strict=True)
        ]
    )
    per_frame = np.zeros(test.n_frames, dtype=int)
    for block, seen in zip(test.blocks, measured, strict=True):
        per_frame[block.frames] = seen.sum(axis=1)
    whole, quadrants = coverage(test.on_circle(points), test.radius)
    along_x, along_y = test.semi_axes
    static = test.static_displacement
    return TestInfo(
        name=test.name,
        source=test.source,
        checksum=test.checksum,
        radius=test.radius,
        thickness=test.thickness,
        semi_axes=(float(along_x), float(along_y)) if test.ellipticity else None,
        poisson_ratio=test.poisson_ratio,
        warp_angle=test.warp_angle,
        n_frames=test.n_frames,
        n_blocks=len(test.blocks),
        n_points=test.n_points,
        n_measured=test.n_measured,
        n_lost=sum(seen.size for seen in measured) - test.n_measured,
        points_per_frame=tuple(int(n) for n in per_frame),
        reference_range=tuple(_range([axis]) for axis in points.T),
        largest_radius=float(np.hypot(points[:, 0], points[:, 1]).max()),
        displacement_range=tuple(
            _range([block.displacement[..., i] for block in test.blocks]) for i in range(3)
        ),
        coverage=whole,
        coverage_quadrants=quadrants,
        pressure_bar=tuple(float(p) * 10 for p in test.pressure),
        pressure_increases=test.pressure_increases,
        apex_mm=tuple(float(w) if np.isfinite(w) else None for w in test.apex_displacement),
        duration_s=None if test.time is None else float(np.ptp(test.time)),
        n_static=0 if static is None else len(static),
        static_noise_mm=None if static is None else _static_noise(static),
        history=test.history,
        warnings=tuple(suspicions(test)),
    )


def _range(arrays: list[NDArray[Any]]) -> Range:
    known = [array[np.isfinite(array)] for array in arrays]
    known = [array for array in known if array.size]
    if not known:
        return None
    return float(min(a.min() for a in known)), float(max(a.max() for a in known))


def _static_noise(static: NDArray[np.floating]) -> tuple[float | None, ...] | None:
    # one image shows no scatter; a point lost in any image is left out
    if len(static) < 2:
        return None
    noise: list[float | None] = []
    for i in range(3):
        values = static[..., i].astype(np.float64)
        values = values[:, np.isfinite(values).all(axis=0)]
        noise.append(float(np.sqrt(values.var(axis=0, ddof=1).mean())) if values.size else None)
    return tuple(noise)
