"""Levels between others, until the dense output is within tolerance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.equilibrium import NewtonError
from bulgefit.fem.hermite import STENCIL
from bulgefit.fem.tracing.advance import PATIENCE
from bulgefit.fem.tracing.levels import Level, Tracer

__all__ = ["AIM", "fill"]

Floats = NDArray[np.float64]

#: Share of the tolerance that steps aim at, and that no estimate may pass.
AIM, _SURE = 0.1, 0.8


def fill(tracer: Tracer, tolerance: float, closest: float, most: int) -> None:
    """Put levels in between until the dense output is within tolerance, or there are `most`.

    The newest level changes the stencils of the intervals below it, so these are looked at too.
    Beside a singular tangent there may be no smooth level, and an error remains.
    """
    singular = set()
    after = len(tracer.levels) - 2
    lowest = max(0, after - STENCIL + 1)
    while after >= lowest and len(tracer.levels) < most:
        low, high = tracer.levels[after].s, tracer.levels[after + 1].s
        error = tracer.error(after, AIM * tolerance)
        done = error <= _SURE * tolerance or high - low < closest or low in singular
        if not done and tracer.wasted <= PATIENCE:
            try:
                _put_between(tracer, tracer.levels[after], tracer.levels[after + 1])
                after = min(after + STENCIL, len(tracer.levels) - 1)
            except NewtonError:
                singular.add(low)
        after -= 1


def _put_between(tracer: Tracer, low: Level, high: Level) -> None:
    """Add a level halfway between two.

    In wrinkled cloth the dense output may be too far off for a search along the path: from the
    shape at the higher pressure, which has fewer wrinkles, descent of the potential finds the level
    as it finds the next one in `advance`; with patience, as the lowest one.

    Raises
    ------
    NewtonError
    """
    s = 0.5 * (low.s + high.s)
    try:
        tracer.solve(s, tracer.interpolate(s), follow=True)
    except NewtonError:
        ends = (low, high)
        wrinkled = any(end.wrinkled for end in ends) and all(end.stable for end in ends)
        if not (wrinkled and all(tracer.is_elliptic(end.displacement) for end in ends)):
            raise
        tracer.solve(s, high.displacement, follow=False, patient=True)
        _check_between(tracer, low, high)


def _check_between(tracer: Tracer, low: Level, high: Level) -> None:
    """Take a level back that lies on another branch: the volumes of one grow with pressure.

    Raises
    ------
    NewtonError
    """
    at = tracer.levels.index(low) + 1
    shapes = [level.displacement for level in (low, tracer.levels[at], high)]
    below, between, above = (tracer.membrane.volume(shape) for shape in shapes)
    if not (tracer.levels[at].stable and below < between < above):
        del tracer.levels[at]
        raise NewtonError("the shape is one of another branch", 0, 0.0, 0)
