"""Where no branch can be followed any more: stable shapes, each by descent from the one before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause
from bulgefit.fem.equilibrium import RUN_AWAY, NewtonError, RunAwayError
from bulgefit.fem.tracing.ends import StoppedError
from bulgefit.fem.tracing.levels import Tracer

__all__ = ["settle"]

Floats = NDArray[np.float64]

#: Levels over the rest of the range, and the least of their steps, over the longest.
_SETTLED, _LEAST = 6, 0.01
#: How closely an end is told, relative in s, where the range goes far beyond it.
_CLOSELY = 1e-3
#: Share of what counts as run away that a shape so close below must not have, if it leaps: a law
#: that stiffens has larger and larger ones, and no limit.
_LEAP = 0.5


def settle(tracer: Tracer, s: float, shape: Floats, end: float) -> None:
    """Add levels from a stable shape at s up to `end`.

    Beyond the loss of ellipticity a soft shear modulus leaves many equilibria. The stable ones
    have bands as wide as a cell; they are equilibria all the same, and tell a search more than a
    failure would. The dense output between them may be far off. Where descent runs away however
    short a step is, there is none: the pressure is beyond its limit.

    Raises
    ------
    StoppedError
        With the limit pressure; or where descent does not converge.
    """
    step = longest = (end - s) / _SETTLED
    while s < end * (1.0 - 1e-12):
        above = min(s + step, end)
        try:
            tracer.solve(above, shape, follow=False, patient=True)
        except NewtonError as error:
            step *= 0.5
            if step < min(_LEAST * longest, _CLOSELY * s):
                raise _stopped(tracer, error, s, above, shape) from error
            continue
        s, shape, step = above, tracer.levels[-1].displacement, min(2.0 * step, longest)
        tracer.judge()


def _stopped(
    tracer: Tracer, error: NewtonError, s: float, above: float, shape: Floats
) -> StoppedError:
    """What is said where there is a shape at s, and none was found above."""
    size = float(np.abs(shape).max()) / tracer.membrane.radius
    if isinstance(error, RunAwayError) and size < _LEAP * RUN_AWAY:
        cause = Cause.LIMIT_PRESSURE
        return StoppedError(cause.value, cause, above, s, error, shape)
    return StoppedError(error.reason, error.cause, above, s, error, shape)
