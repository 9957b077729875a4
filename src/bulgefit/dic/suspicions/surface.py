"""Do a frame's heights lie on a surface, and how high does it bulge?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["Bulge", "about_rough_frames", "about_surface", "bulge_of"]

# Fewer heights are met by a quadratic surface whatever they are, and more say no more of it.
_FEWEST_POINTS = 30
_MOST_POINTS = 4000
# A surface that leaves more of the mean square height than it explains tells less than it hides.
_MOST_LEFT = 0.5


@dataclass(frozen=True)
class Bulge:
    """The best quadratic surface through the heights of a frame.

    Attributes
    ----------
    rise, error : float, mm
        Height of its paraboloid 1 - r^2/a^2 at the centre, and the standard error of that.
    left : float
        Part of the mean square height that the surface does not explain.
    """

    rise: float
    error: float
    left: float


def bulge_of(test: BulgeTest, frame: int) -> Bulge | None:
    """The bulge of a frame; None where its points span no surface or do not move at all."""
    reference, displacement = test.frame(frame)
    some = slice(None, None, max(1, len(reference) // _MOST_POINTS))
    reference, height = reference[some], displacement[some, 2].astype(np.float64)
    known = np.isfinite(height)
    square = float((height[known] ** 2).sum())
    if known.sum() < _FEWEST_POINTS or square == 0:
        return None
    x, y = test.on_circle(reference[known]).T / test.radius
    basis = np.column_stack([1 - x**2 - y**2, x**2 - y**2, x * y, x, y, np.ones_like(x)])
    if np.linalg.matrix_rank(basis) < basis.shape[1]:
        return None
    found = np.linalg.lstsq(basis, height[known], rcond=None)[0]
    left = float(((height[known] - basis @ found) ** 2).sum())
    variance = left / (len(basis) - basis.shape[1])
    error = float(np.sqrt(variance * np.linalg.inv(basis.T @ basis)[0, 0]))
    return Bulge(float(found[0]), error, left / square)


def about_surface(test: BulgeTest) -> Iterator[Suspicion]:
    """Whether half the frames that are under pressure, or more, show no surface.

    Half is where the sum of absolute deviations and every median break down.
    """
    rough, asked = _rough_frames(test)
    if rough and len(rough) >= asked / 2:
        yield Suspicion(
            "no_surface",
            f"the heights lie on no surface in {len(rough)} of {asked} frames under half the "
            "highest pressure or more: the best quadratic one leaves "
            f"{np.median(list(rough.values())):.0%} of their mean square, as noise alone does, or "
            "points whose correlation was lost",
            "correlate again with an image at rest, leave out the frames and points that lost the "
            "pattern, and look at dz with bulgefit show",
        )


def about_rough_frames(test: BulgeTest) -> Iterator[Suspicion]:
    """Frames under pressure that show no surface, where most do."""
    rough, asked = _rough_frames(test)
    if 0 < len(rough) < asked / 2:
        worst = max(rough, key=lambda frame: rough[frame])
        yield Suspicion(
            "rough_frames",
            f"the heights lie on no surface in {len(rough)} of {asked} frames under half the "
            f"highest pressure or more: in frame {worst} the best quadratic one leaves "
            f"{rough[worst]:.0%} of their mean square",
            "leave these frames out, or correlate them again",
        )


def _rough_frames(test: BulgeTest) -> tuple[dict[int, float], int]:
    """Frames that show no surface, with what it leaves, and how many could be asked."""
    pressed = np.flatnonzero(test.pressure >= test.pressure.max() / 2)
    bulges = {int(frame): bulge_of(test, int(frame)) for frame in pressed}
    left = {frame: bulge.left for frame, bulge in bulges.items() if bulge is not None}
    return {frame: part for frame, part in left.items() if part > _MOST_LEFT}, len(left)
