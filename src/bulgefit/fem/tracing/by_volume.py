"""Where no step in pressure leads on: the same branch by its volume, up to where it turns."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause
from bulgefit.fem.equilibrium import NewtonError
from bulgefit.fem.tracing.ends import BRACKET, StoppedError, beside, given_up, lost_at
from bulgefit.fem.tracing.levels import Tracer, are_alike, is_between, is_over_kinks
from bulgefit.fem.volume_control import Point, at_volume, highest_pressure

__all__ = ["LEAST_GROWTH", "PATIENTLY", "ahead_of", "go_by_volume", "point_at", "rising"]

Floats = NDArray[np.float64]

#: Growth of the volume in a step by volume: at first, the least that is tried, and the most.
_GROWTH, LEAST_GROWTH, _MOST_GROWTH = 0.05, 1e-6, 0.2
#: How many times as long as one that has led on the next step may be, and the share that is taken
#: of one that would just do.
_LONGEST, _SURE = 1.5, 0.9
#: Steps by volume before pressure is stepped again from wherever they have led.
PATIENTLY = 40


def go_by_volume(tracer: Tracer, beyond: float, end: float, failure: NewtonError) -> None:
    """Add a level beyond an s, reached by growing volumes; what comes after the end is none of it.

    Raises
    ------
    StoppedError
        At the limit pressure, where the law loses ellipticity, or where this does not do either.
    """
    last = tracer.levels[-1]
    here = first = point_at(tracer, last.s, last.displacement, last.slope, stable=last.stable)
    growth = _first_growth(tracer, first.volume)
    steps = 0
    for steps, here in enumerate(rising(tracer, first, growth, end), start=1):
        s = np.cbrt(here.pressure)
        if s > beyond or steps == PATIENTLY:
            try:
                tracer.solve(s, here.displacement, follow=True, rough=True)
                return
            except NewtonError as error:
                failure = error
    if steps < PATIENTLY and tracer.elliptic and not tracer.is_elliptic(here.displacement):
        s, shape, _ = ahead_of(tracer, here)
        tracer.solve(s, shape, follow=True, rough=True)
        return
    raise given_up(tracer, failure, last.s)


def rising(tracer: Tracer, here: Point, growth: float, end: float) -> Iterator[Point]:
    """Points of a branch by volumes that grow, by a share at first, as long as it is sound.

    They end where shorter steps do not lead on, or after `PATIENTLY` of them.

    Raises
    ------
    StoppedError
        At the limit pressure, or where the law loses ellipticity short of the s = `end`.
    """
    points, halved = [here], False
    while growth >= LEAST_GROWTH and len(points) <= PATIENTLY:
        here = points[-1]
        try:
            point = _at_volume(tracer, here, here.volume + growth * abs(here.volume))
        except NewtonError as error:
            tracer.wasted += error.work
            growth, halved = 0.5 * growth, True
            continue
        # falling pressure, or one that has been higher still
        lower = point.pressure < here.pressure and not point.stable
        falls = lower or point.rate <= 0.0
        if not tracer.is_sound(point):
            near = _past_turn(tracer, here, point, end, falls=falls)
            falls, point = (True, point) if near is None else (False, near)
        points.append(point)
        if falls:
            raise _limit(tracer, points)
        yield point
        # half of what is left to where no step led
        growth *= 0.5 if halved else _longer(tracer, here, point)
        halved = False
        growth = min(max(growth, LEAST_GROWTH), _MOST_GROWTH)  # over a kink ∂u/∂p grows at once


def _longer(tracer: Tracer, here: Point, point: Point) -> float:
    """How many times as long the next step may be as one that has led to a point.

    Where a branch is about to fold ∂u/∂p grows as one over the way that is left. Of that a step may
    take half where the law is not elliptic (`_may_fold`): h/2(R - 1) after one of h by which ∂u/∂p
    has grown by a factor R.
    """
    grown = _speed(point) / _speed(here)
    if not tracer.elliptic or grown <= 1.0 + 0.5 * _SURE / _LONGEST:
        return _LONGEST
    return _LONGEST if tracer.is_elliptic(point.displacement) else 0.5 * _SURE / (grown - 1.0)


def _speed(point: Point) -> float:
    """The greatest ∂u/∂p of any node, mm/MPa."""
    return float(np.abs(point.slope).max()) / point.rate


def ahead_of(tracer: Tracer, point: Point) -> tuple[float, Floats, Floats]:
    """The next s near by at which there is a sound shape where no volume leads on, and its slope.

    Raises
    ------
    StoppedError
        Where there is none: the law has lost ellipticity, and beyond it is a branch of its own.
    """
    s = float(np.cbrt(point.pressure))
    here = tracer.sound_from(point.displacement, s)
    above = s * (1.0 + BRACKET)
    ahead = None if here is None else beside(tracer, s, above, *here)
    if ahead is None:
        raise lost_at(tracer, above, s, point.displacement)
    return ahead


def point_at(tracer: Tracer, s: float, shape: Floats, slope: Floats, *, stable: bool) -> Point:
    """A shape as a point of its branch: ∂u/∂V is ∂u/∂s over ∂V/∂s = f·∂u/∂s."""
    volume, grown = tracer.membrane.volume(shape), tracer.membrane.volume_change(shape, slope)
    state = tracer.membrane.state(shape, s**3, tracer.stiffness, tangent=False)
    rate = 3.0 * s**2 / grown
    return Point(shape, s**3, volume, stable, state.wrinkled, rate, slope / grown, 0)


def _first_growth(tracer: Tracer, volume: float) -> float:
    """Share of the volume (mm³) of the last level by which a first step goes beyond it.

    By as much as the last step in pressure did: what that closed in on, a longer one may leap over,
    to shapes that no path leads to.
    """
    if len(tracer.levels) < 2:
        return _GROWTH
    grown = volume - tracer.membrane.volume(tracer.levels[-2].displacement)
    return min(_GROWTH, max(LEAST_GROWTH, grown / abs(volume)))


def _at_volume(tracer: Tracer, here: Point, volume: float) -> Point:
    """The point of a branch at a volume above that of `here`; raises NewtonError.

    Where a first correction is longer than the step, the tangent says nothing of what lies ahead.
    """
    grown = volume - here.volume
    step = grown * here.slope
    within = np.inf if _is_short(here, volume) else float(np.abs(step).max())
    found = _from(tracer, here.displacement + step, here.pressure, volume, within)
    return _checked(tracer, here, found)


def _checked(tracer: Tracer, here: Point, point: Point) -> Point:
    """A point of more volume, if it is one of the same branch.

    Where shapes are stable, volume grows with pressure: dV/dp = f·K⁻¹f > 0 for a tangent K that is
    positive definite, f = ∂V/∂x. So a stable shape of more volume under less pressure is one of
    another branch, or lies behind a limit and a least pressure too: shorter steps tell. So do they
    where the law is not elliptic and the branch leaps: between two shapes bands of shear may have
    come. What tangents at both ends leave of a change is ΔV³u'''/12 on a smooth branch and nothing
    over a kink, so that shorter steps bring it under any length; over a leap it is about the leap,
    however short the step. One of twice the path's tolerance is none that it would tell: a way
    between is off by no more than that. Over the shortest steps pressure may fall by it, too. Where
    there are many kinks on the way, the potential tells: it is convex over these. Kinks come with
    wrinkles; without any it may be convex on the way to another branch, too, whose fold is ahead.

    Raises
    ------
    NewtonError
    """
    change, grown = point.displacement - here.displacement, point.volume - here.volume
    before, after = grown * here.slope, grown * point.slope
    folds = _may_fold(here, point)
    near = not folds and is_between(change, before, after, 2.0 * tracer.tolerance)
    # in the order of what they take
    leaps = tracer.elliptic and not near and not tracer.is_elliptic(here.displacement)
    kinks = here.wrinkled + point.wrinkled > 0
    if leaps and kinks and not folds and here.stable and point.stable:
        leaps = not _in_one_valley(tracer, here, point, (before, after))
    behind = point.stable and point.pressure < here.pressure
    if leaps or (behind and not (near and _is_short(here, point.volume))):
        raise NewtonError("the shape is one of another branch", 0, 0.0, 0)
    return point


def _in_one_valley(
    tracer: Tracer, here: Point, point: Point, tangents: tuple[Floats, Floats]
) -> bool:
    """Whether nothing but kinks lies between two points.

    Where tangents are not alike shorter steps tell, which cost less than to look at both ways.
    """
    change = point.displacement - here.displacement
    if not (_is_like(here, point) and is_over_kinks(change, *tangents)):
        return False
    low, high = (here.pressure, here.displacement), (point.pressure, point.displacement)
    return _leads_through(tracer, here, point, tangents) and tracer.is_convex(low, high, tangents)


def _leads_through(
    tracer: Tracer, here: Point, point: Point, tangents: tuple[Floats, Floats]
) -> bool:
    """Whether the point of the branch halfway between two in volume is as both tell.

    A snap that is small beside the step has no ridge on the straight way. But before and behind it
    tangents turn to the mode that it snaps by, over a longer way than its own.
    """
    pressure, volume = 0.5 * (here.pressure + point.pressure), 0.5 * (here.volume + point.volume)
    halfway = 0.5 * (here.displacement + point.displacement) + 0.125 * (tangents[0] - tangents[1])
    try:
        middle = _from(tracer, halfway, pressure, volume, np.inf)
    except NewtonError:
        return False
    rises = here.pressure < middle.pressure < point.pressure
    return middle.stable and rises and _is_like(here, middle) and _is_like(middle, point)


def _is_like(here: Point, point: Point) -> bool:
    """Whether the tangents at two points differ by less than half of what lies between them."""
    change, grown = point.displacement - here.displacement, point.volume - here.volume
    return are_alike(change, grown * here.slope, grown * point.slope)


def _may_fold(here: Point, point: Point) -> bool:
    """Whether between two points that rise the branch may have gone down and up again.

    There the least stiffness goes through zero, and ∂u/∂p = K⁻¹f through infinity as its inverse. A
    step that halves the stiffness is as long as the way that is left to zero; so is one from there.
    Over a kink, where a wrinkle comes or goes, ∂u/∂p changes by any factor, but however short the
    step: so the shortest ones tell a kink.
    """
    if _is_short(here, point.volume):
        return False
    speeds = sorted((_speed(here), _speed(point)))
    return 0.0 < 2.0 * speeds[0] < speeds[1]


def _is_short(here: Point, volume: float) -> bool:
    """Whether a step is one of the shortest, over which nothing is told of what lies between."""
    return volume - here.volume < 2.0 * LEAST_GROWTH * abs(here.volume)


def _past_turn(
    tracer: Tracer, here: Point, point: Point, end: float, *, falls: bool
) -> Point | None:
    """The sound point at the volume of one that is not, if the branch leads there from near by.

    Or the last sound one, where that lies beyond the s = `end`. None where pressure falls, and the
    branch was unstable before: it has passed its limit pressure.

    Raises
    ------
    StoppedError
        Where it turns unstable.
    """
    low, high = _turn(tracer, here, point)
    with suppress(NewtonError):
        near = _at_volume(tracer, low, high.volume)
        if tracer.is_sound(near) and near.pressure > low.pressure:
            return near
    if falls and here.stable and not low.stable:
        return None
    # of what lies behind the shape may be another branch's, of any pressure
    reached = float(np.cbrt(low.pressure))
    if reached >= end:
        return low
    raise lost_at(tracer, reached * (1.0 + BRACKET), reached, low.displacement)


def _turn(tracer: Tracer, low: Point, high: Point) -> tuple[Point, Point]:
    """Bisect by volume where a branch becomes both unstable and not elliptic.

    From below, along the branch's own tangent, since the upper shape may be one of another branch.
    Steps that this does not lead are halved, down to the least: where an imperfection keeps a
    branch from forking, its stable side bends the more sharply the less that is (Koiter, 1945, "On
    the stability of elastic equilibrium"), and longer steps lose it to the unstable side.
    """
    size, share = abs(high.volume), 0.5
    while (apart := high.volume - low.volume) > BRACKET * size:
        if share * apart < LEAST_GROWTH * size:
            break
        try:
            middle = _at_volume(tracer, low, low.volume + share * apart)
        except NewtonError:
            share *= 0.5
            continue
        share = min(2.0 * share, 0.5)
        if tracer.is_sound(middle):
            low = middle
        else:
            high = middle
    return low, high


def _from(tracer: Tracer, start: Floats, pressure: float, volume: float, within: float) -> Point:
    """The point at a volume from a shape near by (mm), and a pressure; raises NewtonError."""
    try:
        point = at_volume(tracer.membrane, tracer.stiffness, start, pressure, volume, within=within)
    except NewtonError as error:
        tracer.work += error.work
        raise
    tracer.work += point.work
    return point


def _limit(tracer: Tracer, points: list[Point]) -> StoppedError:
    """What ends a path at whose last point more volume takes less pressure."""
    best, work = highest_pressure(tracer.membrane, tracer.stiffness, points)
    tracer.work += work
    s, cause = np.cbrt(best.pressure), Cause.LIMIT_PRESSURE
    return StoppedError(
        cause.value, cause, s * (1.0 + BRACKET), s, tracer.failure, best.displacement
    )
