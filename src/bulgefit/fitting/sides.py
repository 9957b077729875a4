"""Which side is it on? What turns is looked for all round where a descent has lost it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fitting.minimise import Limits, descend
from bulgefit.fitting.problem import Problem

__all__ = ["turned"]

Floats = NDArray[np.floating]

#: Parts of a period by which it is turned: of a lift, which acts on half of the rim, one of four
#: sides at least is less than an eighth of a period off the true one.
_TURNS = (0.25, 0.5, 0.75)


def turned(problem: Problem, z: Floats, method: str, limits: Limits | None) -> Floats:
    """The lowest end of descents from other sides; `z` where there is no lower one.

    From a side on which there is no lift its amplitude falls to nothing, and there the side has no
    slope: a descent ends, and says that there is none.

    Parameters
    ----------
    problem : Problem
    z : (free,) array
        Coordinates of an optimum.
    method, limits
        Of the descents.
    """
    for turning, governor in problem.idle(z):
        least = problem.evaluate(z).value
        here = z
        for turn in _TURNS:
            end = descend(problem, problem.awoken(here, turning, governor, turn), method, limits)
            if end.best.value < least:
                z, least = problem.coordinates(end.best.values), end.best.value
    return z
