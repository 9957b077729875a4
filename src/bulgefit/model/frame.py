"""Which balanced shape of a frame is near to what is known of it, and what is said of none?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause, SolveError
from bulgefit.fem.equilibrium import Equilibrium, NewtonError, solve
from bulgefit.fem.membrane import Membrane

__all__ = ["solved", "unsolved"]

Floats = NDArray[np.float64]


def solved(
    membrane: Membrane,
    starts: Floats,
    pressure: float,
    stiffness: Floats,
    values: dict[str, float],
    *,
    loose: bool,
    reached: float,
) -> Equilibrium:
    """Balance one frame; raises SolveError, which says up to which pressure others are balanced.

    From the first of the displacements (k, n, 3) that leads there. A path's dense output may be far
    off where its levels are a descent apart, while each of these is a balanced shape.
    """
    failed = None
    for start in starts:
        try:
            return _nearest(membrane, start, pressure, stiffness, loose=loose)
        except NewtonError as error:
            failed = failed or error
    assert failed is not None
    reason = f"no equilibrium near the last shape: {failed.reason}"
    raise unsolved(
        reason, pressure, reached, values, failed.iteration, failed.residual_norm, failed.cause
    ) from failed


def _nearest(
    membrane: Membrane, start: Floats, pressure: float, stiffness: Floats, *, loose: bool
) -> Equilibrium:
    """Balance a shape (n, 3) mm along its branch, else by descent; raises NewtonError.

    Between the levels of a path of `loose` cloth folds come and go, and its dense output may be too
    far off for a search along the path: descent finds the shape, as it finds the levels. So it may
    be under a light pressure with what a neighbour's derivatives say. Where the law is not elliptic
    it would leap into bands of shear, so that what it finds there from a neighbour is none.
    """
    try:
        return solve(membrane, start, float(pressure), stiffness, follow=True)
    except NewtonError:
        found = solve(membrane, start, float(pressure), stiffness)
        if loose or membrane.is_elliptic(found.displacement, stiffness):
            return found
        raise


def unsolved(
    reason: str,
    pressure: float,
    reached: float,
    values: dict[str, float],
    iteration: int = 0,
    residual_norm: float = 0.0,
    cause: Cause = Cause.NOT_CONVERGED,
) -> SolveError:
    """What is said of a frame that is not balanced (MPa, N)."""
    return SolveError(
        reason,
        cause=cause,
        pressure=float(pressure),
        reached=reached,
        iteration=iteration,
        residual_norm=residual_norm,
        parameters=values,
    )
