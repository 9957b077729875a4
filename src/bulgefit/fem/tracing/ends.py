"""Why does a path end? A limit pressure, a loss of ellipticity, or no step that leads on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause, SolveError
from bulgefit.fem.equilibrium import NewtonError
from bulgefit.fem.tracing.levels import Tracer, is_between

__all__ = [
    "BRACKET",
    "StoppedError",
    "beside",
    "given_up",
    "lost_at",
    "solve_error",
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


def solve_error(stopped: StoppedError, parameters: Mapping[str, float]) -> SolveError:
    return SolveError(
        f"no equilibrium: {stopped.reason}",
        cause=stopped.cause,
        pressure=float(stopped.s**3),
        reached=float(stopped.reached**3),
        iteration=stopped.error.iteration,
        residual_norm=stopped.error.residual_norm,
        parameters=parameters,
    )


def beside(
    tracer: Tracer, low: float, high: float, shape: Floats, slope: Floats
) -> tuple[float, Floats, Floats] | None:
    """The next s at which a sound shape of the same branch is found from near by; None without any.

    What a long step did not find may be found from there. And beside a point at which a wrinkle
    comes or goes Newton's method may not converge, while the branch goes on behind it.
    """
    for s in (high * (1.0 + BRACKET * np.array(_BESIDE))).tolist():
        found = tracer.sound_from(shape + (s - low) * slope, s)
        if found is not None and _leads_back(tracer, low, shape, slope, s, found):
            return s, *found
    return None


def _leads_back(
    tracer: Tracer,
    low: float,
    shape: Floats,
    slope: Floats,
    s: float,
    found: tuple[Floats, Floats],
) -> bool:
    """Whether a shape found at s, and its ∂u/∂s, are of the same branch as one below.

    Beside a fold the branch runs along the mode that it snaps by, so that tangents at both ends
    agree with the leap. But what is above a snap leads down past it, or nowhere.
    """
    change, before, after = found[0] - shape, (s - low) * slope, (s - low) * found[1]
    back = tracer.sound_from(found[0] - after, low)
    if back is None or float(np.abs(back[0] - shape).max()) > tracer.tolerance:
        return False
    return is_between(change, before, after, _ROUGH * float(np.abs(change).max()))
