"""Where no step in pressure leads on: the same branch by its volume, up to where it turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause
from bulgefit.fem.equilibrium import NewtonError
from bulgefit.fem.tracing.ends import BRACKET, StoppedError, given_up, lost_at
from bulgefit.fem.tracing.levels import ROUGH, Level, Tracer
from bulgefit.fem.volume_control import Point, at_volume, highest_pressure

__all__ = ["go_by_volume"]

Floats = NDArray[np.float64]

#: Growth of the volume in a step by volume: at first, the least that is tried, and the most.
_GROWTH, _LEAST_GROWTH, _MOST_GROWTH = 0.05, 1e-4, 0.2
#: Steps by volume before a branch that still rises is given up.
_BY_VOLUME = 40
#: Bisection of a volume ends where steps of this share of what is left lead to no shape.
_LEAST_SHARE = 0.01


def go_by_volume(tracer: Tracer, beyond: float, failure: NewtonError) -> None:
    """Add a level beyond an s, reached by growing volumes.

    Raises
    ------
    StoppedError
        At the limit pressure, where the law loses ellipticity, or where this does not do either.
    """
    last = tracer.levels[-1]
    here = _of_level(tracer, last)
    points = [here]
    growth = _first_growth(tracer, here.volume)
    for _ in range(_BY_VOLUME):
        here = points[-1]
        wanted = here.volume + growth * abs(here.volume)
        try:
            point = _at_volume(tracer, here, wanted)
        except NewtonError as error:
            tracer.work, tracer.wasted = tracer.work + error.work, tracer.wasted + error.work
            growth *= 0.5
            if growth < _LEAST_GROWTH:
                break
            continue
        tracer.work += point.work
        points.append(point)
        if tracer.elliptic and not point.stable and not tracer.is_elliptic(point.displacement):
            low, high = _turn(tracer, here, point)
            # one that turned unstable before has passed its limit pressure, if pressure falls next
            if low.stable or not here.stable:
                reached = np.cbrt(low.pressure)
                # what lies behind may be found on a branch of lower pressures
                beyond = max(np.cbrt(high.pressure), reached * (1.0 + BRACKET))
                raise lost_at(tracer, beyond, reached, low.displacement)
        # falling pressure, or one that has been higher still
        if point.pressure < here.pressure or not point.rises:
            raise _limit(tracer, points, failure)
        s = np.cbrt(point.pressure)
        if s > beyond:
            try:
                tracer.solve(s, point.displacement, follow=True, rough=True)
                return
            except NewtonError as error:
                failure = error
        growth = min(1.5 * growth, _MOST_GROWTH)
    if tracer.elliptic and not tracer.is_elliptic(points[-1].displacement):
        reached = float(np.cbrt(points[-1].pressure))
        raise lost_at(tracer, reached * (1.0 + BRACKET), reached, points[-1].displacement)
    raise given_up(tracer, failure, last.s)


def _of_level(tracer: Tracer, level: Level) -> Point:
    """A level as a point of its branch: ∂u/∂V is ∂u/∂s over ∂V/∂s = f·∂u/∂s."""
    membrane = tracer.membrane
    volume = membrane.volume(level.displacement)
    slope = level.slope / membrane.volume_change(level.displacement, level.slope)
    return Point(level.displacement, level.s**3, volume, level.stable, True, slope, 0)


def _first_growth(tracer: Tracer, volume: float) -> float:
    """Share of the volume (mm³) of the last level by which a first step goes beyond it.

    By as much as the last step in pressure did: what that closed in on, a longer one may leap over,
    to shapes that no path leads to.
    """
    if len(tracer.levels) < 2:
        return _GROWTH
    grown = volume - tracer.membrane.volume(tracer.levels[-2].displacement)
    return min(_GROWTH, max(_LEAST_GROWTH, grown / abs(volume)))


def _at_volume(tracer: Tracer, here: Point, volume: float) -> Point:
    """The point of a branch at a volume above that of `here`, begun along its tangent.

    Where shapes are stable, volume grows with pressure: dV/dp = f·K⁻¹f > 0 for a tangent K that is
    positive definite, f = ∂V/∂x. So a stable shape of more volume under less pressure is one of
    another branch, or lies behind a limit and a least pressure too: shorter steps tell. So do they
    where the law is not elliptic and the branch leaps: between two shapes bands of shear may have
    come.

    Raises
    ------
    NewtonError
    """
    start = here.displacement + (volume - here.volume) * here.slope
    point = at_volume(tracer.membrane, tracer.stiffness, start, here.pressure, volume)
    doubtful = tracer.elliptic and not tracer.is_elliptic(here.displacement)
    banded = doubtful and _leaps(tracer, here, point, start)
    if banded or (point.stable and point.pressure < here.pressure):
        raise NewtonError("the shape is one of another branch", 0, 0.0, point.work)
    return point


def _leaps(tracer: Tracer, here: Point, point: Point, start: Floats) -> bool:
    """Whether a shape is on another branch than the one before it.

    It is on the same where the tangent led to it but for `ROUGH` of the change. Where a wrinkle
    comes or goes the branch has a kink, and its tangent leads elsewhere however short a step is;
    but then the shape halfway lies in the middle, which it does not between two branches.

    Raises
    ------
    NewtonError
    """
    close = ROUGH * np.abs(point.displacement - here.displacement).max()
    if np.abs(point.displacement - start).max() <= close:
        return False
    middle = 0.5 * (here.displacement + point.displacement)
    pressure, volume = 0.5 * (here.pressure + point.pressure), 0.5 * (here.volume + point.volume)
    halfway = at_volume(tracer.membrane, tracer.stiffness, middle, pressure, volume)
    tracer.work += halfway.work
    return bool(np.abs(halfway.displacement - middle).max() > close)


def _turn(tracer: Tracer, low: Point, high: Point) -> tuple[Point, Point]:
    """Bisect by volume where a branch becomes both unstable and not elliptic.

    Steps that lead to no shape are halved: the upper shape may be one of another branch.
    """
    share = 0.5
    while high.volume - low.volume > BRACKET * abs(high.volume) and share > _LEAST_SHARE:
        volume = low.volume + share * (high.volume - low.volume)
        start = low.displacement + share * (high.displacement - low.displacement)
        pressure = low.pressure + share * (high.pressure - low.pressure)
        try:
            middle = at_volume(tracer.membrane, tracer.stiffness, start, pressure, volume)
        except NewtonError as error:
            tracer.work += error.work
            share *= 0.5
            continue
        tracer.work += middle.work
        share = 0.5
        if middle.stable or tracer.is_elliptic(middle.displacement):
            low = middle
        else:
            high = middle
    return low, high


def _limit(tracer: Tracer, points: list[Point], failure: NewtonError) -> StoppedError:
    """What ends a path at whose last point more volume takes less pressure."""
    best, work = highest_pressure(tracer.membrane, tracer.stiffness, points)
    tracer.work += work
    s, cause = np.cbrt(best.pressure), Cause.LIMIT_PRESSURE
    return StoppedError(cause.value, cause, s * (1.0 + BRACKET), s, failure, best.displacement)
