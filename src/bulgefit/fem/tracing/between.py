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


def fill(tracer: Tracer, closest: float, most: tuple[int, int], affordable: int) -> None:
    """Put levels in between until the dense output is within tolerance, or there are so many.

    Or until more factorisations than are `affordable` were spent on the path.

    Levels that descent has to find are those of cloth that lies loosely, where halving a step gains
    little: of these there are no more than the first of `most`, which leaves some for the rest. The
    newest level changes the stencils of the intervals below it, so these are looked at too, the
    worst one first. Beside a singular tangent there may be no smooth level, and an error remains.
    """
    lowest = max(0, len(tracer.levels) - 1 - STENCIL)
    singular: set[float] = set()

    def lacking(after: int) -> float:
        low, high = tracer.levels[after].s, tracer.levels[after + 1].s
        error = tracer.error(after, AIM * tracer.tolerance)
        done = error <= _SURE * tracer.tolerance or high - low < closest or low in singular
        return 0.0 if done else error

    while tracer.wasted <= PATIENCE and tracer.work <= affordable:
        if len(tracer.levels) >= most[not tracer.between_by_descent]:
            break
        errors = [lacking(after) for after in range(lowest, len(tracer.levels) - 1)]
        if not max(errors) > 0.0:
            break
        worst = lowest + int(np.argmax(errors))
        low, high = tracer.levels[worst], tracer.levels[worst + 1]
        try:
            _put_between(tracer, low, high)
        except NewtonError:
            singular.add(low.s)


def _put_between(tracer: Tracer, low: Level, high: Level) -> None:
    """Add a level halfway between two.

    In wrinkled cloth the dense output may be too far off for a search along the path: descent of
    the potential finds the level as it finds the next one in `advance`; with patience, as the
    lowest one.

    Raises
    ------
    NewtonError
    """
    s = 0.5 * (low.s + high.s)
    if not (tracer.between_by_descent and _may_descend(tracer, low, high)):
        try:
            tracer.solve(s, tracer.interpolate(s), follow=True)
            return
        except NewtonError:
            if not _may_descend(tracer, low, high):
                raise
    starts = (tracer.interpolate(s), low.displacement, high.displacement)
    tracer.solve(s, tracer.lowest(starts, s), follow=False, patient=True)
    tracer.between_by_descent = True
    _check_between(tracer, low, high)


def _may_descend(tracer: Tracer, low: Level, high: Level) -> bool:
    """Whether descent between two levels keeps to their branch: stable, elliptic, with wrinkles."""
    ends = (low, high)
    wrinkled = any(end.wrinkled for end in ends) and all(end.stable for end in ends)
    return wrinkled and all(tracer.is_elliptic(end.displacement) for end in ends)


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
