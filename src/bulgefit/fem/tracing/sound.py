"""Is a path stable, or the law elliptic, all the way up to a level?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from bulgefit.fem.tracing.by_volume import LEAST_GROWTH, PATIENTLY, ahead_of, point_at, rising
from bulgefit.fem.tracing.ends import given_up, lost_at
from bulgefit.fem.tracing.levels import Level, Tracer
from bulgefit.fem.volume_control import Point

__all__ = ["check_ellipticity"]

Floats = NDArray[np.float64]

#: How often a branch is taken up again from where no volume leads on.
_TIMES = 10


def check_ellipticity(tracer: Tracer, *, ended: bool) -> None:
    """Stop a path that is unstable because the law has lost ellipticity.

    A mesh may hold back the bands of shear that a point no longer resists: as long as the tangent
    is positive definite the shape is that of the mesh's least potential, and the path goes on. A
    long step may also have led past that shape, to an unstable one of another branch: where the
    path is sound all the way up to it, the level is the sound one.

    Where a level is not sound, or the law not elliptic at the last one of a path that has `ended`,
    those below it are looked at again by their own tangents, levels between others among them.

    Raises
    ------
    StoppedError
        With the pressure at which the path is both unstable and not elliptic.
    """
    levels = tracer.levels
    if ended and not tracer.is_elliptic(levels[-1].displacement):
        for level in levels:
            tracer.look_again(level)
    sound = [tracer.is_sound(level) for level in levels]
    if all(sound):
        return
    first = sound.index(False)
    while first > 0:
        tracer.look_again(levels[first - 1])
        if tracer.is_sound(levels[first - 1]):
            break
        first -= 1
    if first == 0:
        raise lost_at(tracer, levels[0].s, 0.0)
    s, shape = _sound_up_to(tracer, levels[first - 1], levels[first].s)
    del levels[first:]
    tracer.solve(s, shape, follow=True, rough=True)


def _sound_up_to(tracer: Tracer, below: Level, top: float) -> tuple[float, Floats]:
    """The shape (mm) at s = `top` where a path is sound all the way up to it.

    By volume: beyond a snap there are sound shapes again, at the same pressures, so that a
    bisection by pressure would go on behind it. Where no volume leads on just short of `top`, it is
    the shape at an s above it.

    Parameters
    ----------
    below : Level
        A sound one.

    Raises
    ------
    StoppedError
        Where it is not, or was not followed so far.
    """
    here = point_at(tracer, below.s, below.displacement, below.slope, stable=below.stable)
    for _ in range(_TIMES):
        first = last = here
        steps, s = 0, float(np.cbrt(first.pressure))
        grown = (top - s) * 3.0 * s**2 / first.rate
        growth = max(0.5 * grown / abs(first.volume), LEAST_GROWTH)
        for here in rising(tracer, first, growth, top):
            steps += 1
            s = float(np.cbrt(here.pressure))
            if s >= top:
                return top, _shape_between(last, here, top**3)
            last = here
        if steps < PATIENTLY:
            s, shape, slope = ahead_of(tracer, here)
            if s >= top:
                return s, shape
            here = point_at(tracer, s, shape, slope, stable=here.stable)
    raise given_up(tracer, tracer.failure, s)


def _shape_between(low: Point, high: Point, pressure: float) -> Floats:
    """The shape (mm) at a pressure (MPa) between two points of a branch that rises.

    Shapes and pressures are smooth in the volume where the branch is about to fold, too.
    """
    ends = low.volume, high.volume
    pressures = CubicHermiteSpline(ends, (low.pressure, high.pressure), (low.rate, high.rate))
    at = pressures.solve(pressure, extrapolate=False)
    volume = at[0] if len(at) else high.volume  # by rounding
    shapes = (low.displacement, high.displacement)
    return np.asarray(CubicHermiteSpline(ends, shapes, (low.slope, high.slope))(volume))
