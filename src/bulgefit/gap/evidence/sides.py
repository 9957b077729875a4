"""From which side does what is periodic take off most, where it means nothing?

A rim that does not lift has no direction. All directions are one point there, and a descent that
ends in it has found an optimum only if from no side of it more can be gained.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.errors import SolveError
from bulgefit.gap.evidence.problem import Layout, Problem

__all__ = ["best_side", "idle"]

Floats = NDArray[np.float64]


def idle(layout: Layout, x: Floats, names: Iterable[tuple[Owned, int]]) -> list[int]:
    """Periodic coordinates of groups in some forms that mean nothing at x: what governs them is 0.

    At its bound, that is: a governor without one has a sign, and needs no side.
    """
    turning = (at for _, at in layout.turning(names))
    return [at for at in turning if x[layout.governor[at]] == layout.lower[layout.governor[at]]]


def best_side(
    problem: Problem, layout: Layout, x: Floats, at: int, near: Any
) -> tuple[Floats, float]:
    """The side of x (n,) by a coordinate from which its governor takes off most, and how much.

    That is of |r|², by a linear step of the governor alone; nothing from where nothing balances.
    Of eight sides: beside what makes up for half a turn, as a tilt does for a lift, what is seen of
    one has the half of its period, and of four sides none may show it.
    """

    def taken(side: Floats) -> float:
        try:
            slope, curvature = problem.along(side, int(layout.governor[at]), near)
        except SolveError:
            return 0.0
        return max(slope, 0.0) ** 2 / curvature if curvature > 0.0 else 0.0

    with problem.remembering():
        found = [(taken(side), side) for side in layout.sides(x, at, range(8))]
    most, side = max(found, key=lambda f: f[0])
    return side, most
