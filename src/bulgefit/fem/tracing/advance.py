"""The next level: by steps in pressure, by descent, by volume, or over a singular point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause
from bulgefit.fem.equilibrium import NewtonError, flat_guess
from bulgefit.fem.tracing.by_volume import go_by_volume
from bulgefit.fem.tracing.ends import StoppedError, given_up, lost_at
from bulgefit.fem.tracing.levels import BandedError, Tracer

__all__ = ["PATIENCE", "TAUTER", "advance", "leap"]

Floats = NDArray[np.float64]

#: Factorisations that failed attempts may cost before the path is given up.
PATIENCE = 80
#: After a failure: shorter steps to try, as shares of the one that failed, and leaps over a
#: singular point, as shares of s.
_SHORTER, _SHORTER_STILL, _LEAPS = (
    (0.6, 0.3),
    (0.3, 0.1, 0.03),
    (0.015, 0.03, 0.05, 0.022, 0.08, 0.04, 0.12),
)
#: Pressures that are tried one after another where cloth is too loose at the lowest to be found.
TAUTER = (10.0, 100.0, 1000.0)


def advance(tracer: Tracer, step: float, end: float) -> float:
    """Add a level about `step` ahead; returns the share of the step that was made.

    Wrinkled cloth has no stiffness across its folds: what a prediction along the path does not
    find there, descent of the potential does. Where the law has lost ellipticity, it would leap
    into bands of shear, past the point where the path turns unstable; there it may not leave the
    valley that the last shape lies in. Where neither these steps nor shorter ones lead on, the
    branch is followed by its volume until pressure can be stepped again, or its greatest pressure
    is passed. Cloth that is too loose for that is looked for where it is taut. That is a descent as
    well, so where the law is not elliptic the path ends there.

    Raises
    ------
    StoppedError
    """
    below = tracer.levels[-1]
    last, loose = below.s, below.stable and below.wrinkled > 0
    convex = tracer.elliptic and loose and not tracer.is_elliptic(below.displacement)
    descend = loose and (tracer.descends or convex)
    attempts = [(1.0, True), *([(1.0, False)] * descend)]
    attempts += [(share, not convex) for share in _SHORTER]
    # what failed in the last step is likely to in the next
    if descend and tracer.by_descent:
        attempts = attempts[1:]
    for share, follow in attempts[-1:] if tracer.closely else attempts:
        s = last + share * step
        # straight on, the way to the bottom begins in the valley that the last shape lies in
        straight = below.displacement + (s - last) * below.slope
        start = tracer.predict(s) if follow else tracer.lowest((straight, below.displacement), s)
        try:
            tracer.solve(s, start, follow=follow, convex=convex and not follow)
            tracer.closely, tracer.by_descent = False, not follow
            tracer.in_valley = not follow and convex
            return share
        except NewtonError as error:
            failure = error
            tracer.descends &= follow or convex
    tracer.closely, tracer.by_descent, tracer.in_valley = True, False, False
    if loose and not convex and tracer.creeps:
        tracer.creeps = _creep(tracer, _SHORTER_STILL, step, patient=False)
        if tracer.creeps:
            tracer.descends = True  # a step from here is no longer than this one
            return (tracer.levels[-1].s - last) / step
    try:
        go_by_volume(tracer, last + min(_SHORTER) * step, end, failure)
    except StoppedError as stopped:
        if stopped.cause is not Cause.NOT_CONVERGED:
            raise
        if not below.wrinkled:
            raise
        crept = _creep(tracer, _SHORTER_STILL, step, patient=True)
        if not (crept or _draw_taut(tracer, end)):
            raise
    return (tracer.levels[-1].s - last) / step


def _creep(tracer: Tracer, shares: Sequence[float], step: float, *, patient: bool) -> bool:
    """Add a level a share of `step` ahead by descent from the last shape; False: there is none."""
    last = tracer.levels[-1]
    for share in shares:
        try:
            s = last.s + share * step
            tracer.solve(s, last.displacement, follow=False, patient=patient)
            return True
        except NewtonError:
            continue
    return False


def _draw_taut(tracer: Tracer, end: float) -> bool:
    """Add a level at a pressure that draws loose cloth taut; False where none is found.

    Raises
    ------
    StoppedError
        Where that is past the loss of ellipticity.
    """
    low = tracer.levels[-1].s
    for factor in TAUTER:
        s = min(low * float(np.cbrt(factor)), end)
        try:
            guess = flat_guess(tracer.membrane, s**3, tracer.stiffness)
            tracer.solve(s, guess, follow=False)
            return True
        except BandedError as banded:
            raise lost_at(tracer, s, low) from banded
        except NewtonError:
            if s == end:
                break
    return False


def leap(tracer: Tracer, step: float, smallest: float) -> float:
    """Add a level about `step` ahead; returns the share of the step that was made.

    Where the tangent is singular at a point of an otherwise smooth path (soft shear: the law has
    lost ellipticity, see docs/verification.md), another step avoids it or goes on behind it, even
    beyond the end of the range. Where none does, steps close in on the point.

    Raises
    ------
    StoppedError
    """
    last = tracer.levels[-1].s
    closing = list(step * 0.4 ** np.arange(1, 20))
    detours = [share * step for share in _SHORTER] + [share * last for share in _LEAPS]
    attempts = [step, *closing] if tracer.closing_in else [step, *detours, *closing]
    for attempt, length in enumerate(attempts):
        tracer.closing_in |= attempt > len(detours)
        try:
            tracer.solve(last + length, tracer.predict(last + length), follow=True)
            return length / step
        except NewtonError as error:
            if length < smallest or tracer.wasted > PATIENCE:
                raise given_up(tracer, error, last + length) from error
    raise AssertionError("the last attempt is shorter than the smallest step")
