"""Why does a path end? A limit pressure, a loss of ellipticity, or no step that leads on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause, SolveError
from bulgefit.fem.equilibrium import NewtonError
from bulgefit.fem.tracing.levels import Level, Tracer, is_between

__all__ = [
    "BRACKET",
    "StoppedError",
    "beside",
    "check_ellipticity",
    "given_up",
    "lost_at",
    "solve_error",
    "sound_up_to",
]

Floats = NDArray[np.float64]

#: Accuracy of the pressure at which ellipticity is lost, relative in s.
BRACKET = 1e-4
#: Share of a change over so short a way that may not be as tangents say.
_ROUGH = 0.1
#: How far beyond such a pressure its branch is looked for again, in units of that.
_BESIDE = (0.0, 2.0, 6.0, 18.0)


class StoppedError(ArithmeticError):
    """A path ends at s, for a cause; equilibrium was reached up to another s, with a shape."""

    def __init__(
        self,
        reason: str,
        cause: Cause,
        s: float,
        reached: float,
        error: NewtonError,
        shape: Floats | None = None,
    ) -> None:
        super().__init__(reason)
        self.reason, self.cause, self.s, self.reached, self.error = reason, cause, s, reached, error
        self.shape = shape


def lost_at(tracer: Tracer, s: float, reached: float, shape: Floats | None = None) -> StoppedError:
    cause = Cause.LOSS_OF_ELLIPTICITY
    return StoppedError(cause.value, cause, s, reached, tracer.failure, shape)


def given_up(tracer: Tracer, error: NewtonError, s: float) -> StoppedError:
    return StoppedError(error.reason, error.cause, s, tracer.levels[-1].s, error)


def solve_error(
    tracer: Tracer, stopped: StoppedError, parameters: Mapping[str, float]
) -> SolveError:
    return SolveError(
        f"no equilibrium: {stopped.reason}",
        cause=stopped.cause,
        pressure=float(stopped.s**3),
        reached=float(stopped.reached**3),
        iteration=stopped.error.iteration,
        residual_norm=stopped.error.residual_norm,
        parameters=parameters,
    )


def check_ellipticity(tracer: Tracer) -> None:
    """Stop a path that is unstable because the law has lost ellipticity.

    A mesh may hold back the bands of shear that a point no longer resists: as long as the tangent
    is positive definite the shape is that of the mesh's least potential, and the path goes on. A
    long step may also have led past that shape, to an unstable one of another branch: where the
    path is sound all the way up to it, the level is the sound one.

    Raises
    ------
    StoppedError
        With the pressure at which the path is both unstable and not elliptic, by bisection.
    """
    levels = tracer.levels
    if tracer.is_sound(levels[-1]):
        return
    first = [tracer.is_sound(level) for level in levels].index(False)
    if first == 0:
        raise lost_at(tracer, levels[0].s, 0.0)
    s, shape = sound_up_to(tracer, levels[first - 1], levels[first].s)
    del levels[first:]
    tracer.solve(s, shape, follow=True, rough=True)


def sound_up_to(tracer: Tracer, below: Level, top: float) -> tuple[float, Floats]:
    """The shape at s = `top`, or little above it, where a path is sound all the way up to it.

    Parameters
    ----------
    below : Level
        A sound one.

    Raises
    ------
    StoppedError
        Where it is not.
    """
    s, shape, slope = below.s, below.displacement, below.slope
    while s < top:
        s, high, shape, slope = _bisected(tracer, s, top, shape, slope)
        ahead = beside(tracer, s, high, shape, slope)
        if ahead is None:
            raise lost_at(tracer, high, s, shape)
        s, shape, slope = ahead
    return s, shape


def _bisected(
    tracer: Tracer, low: float, high: float, shape: Floats, slope: Floats
) -> tuple[float, float, Floats, Floats]:
    """The last s from which on no sound shape was found along the path, and the next one.

    With the shape at the first, and its slope.
    """
    while high - low > BRACKET * high:
        middle = 0.5 * (low + high)
        found = tracer.sound_from(shape + (middle - low) * slope, middle)
        if found is None:
            high = middle
        else:
            low, (shape, slope) = middle, found
    return low, high, shape, slope


def beside(
    tracer: Tracer, low: float, high: float, shape: Floats, slope: Floats
) -> tuple[float, Floats, Floats] | None:
    """The next s at which a sound shape of the same branch is found from near by; None without any.

    What a long step did not find may be found from there. And beside a point at which a wrinkle
    comes or goes Newton's method may not converge, while the branch goes on behind it.
    """
    for s in (high * (1.0 + BRACKET * np.array(_BESIDE))).tolist():
        found = tracer.sound_from(shape + (s - low) * slope, s)
        if found is None:
            continue
        change = found[0] - shape
        apart = _ROUGH * float(np.abs(change).max())
        if is_between(change, (s - low) * slope, (s - low) * found[1], apart):
            return s, *found
    return None
