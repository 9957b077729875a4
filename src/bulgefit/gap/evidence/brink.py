"""How far may a step go where a shape is about to lose its stability?

Beyond that fields are as wild as the mesh allows, and before it they change the faster the nearer
it is: derivatives hold as long as what keeps the shape from the mode that is lost, q (N/mm), stays
about what it is. A trust region of one size for all coordinates would hold back what has nothing to
do with it. So q has one of its own: no step changes it by more than a share of itself, as it is
forecast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from bulgefit.errors import SolveError
from bulgefit.gap.evidence.laplace import bounded_optimum

__all__ = ["ROUNDS", "SHARE", "Brink", "LostStabilityError", "bounded_within"]

Floats = NDArray[np.float64]

#: Share of q that a step may change: shapes go with 1/q along the mode, so that derivatives at both
#: ends of a step that halves it differ by as much as they are.
SHARE = 0.5
#: Rounds of holding back what goes farthest, and how much farther it may still go: where no bound
#: is in the way, one round for one row is exact.
ROUNDS, _SLIGHT = 10, 1e-3


@dataclass(frozen=True, eq=False)
class Brink:
    """Where a step lost stability.

    Attributes
    ----------
    specimen, frame : int
    mode : (n, 3) array
        Along which the shape gave way.
    """

    specimen: int
    frame: int
    mode: Floats


class LostStabilityError(SolveError):
    """A step lost the stability of a shape.

    Parameters
    ----------
    brink : Brink or None
        None where no mode was found.
    **known
        As `SolveError` takes it.
    """

    def __init__(self, reason: str, brink: Brink | None = None, **known: Any) -> None:
        super().__init__(reason, **known)
        self.brink = brink

    def __reduce__(self) -> tuple[object, ...]:
        # what it says beyond others is for the descent that met it
        known = {key: v for key, v in self.__dict__.items() if key not in ("reason", "brink")}
        return partial(SolveError, **known), (self.reason,)


def bounded_within(
    slope: Floats, matrix: Floats, lower: Floats, rows: Sequence[Floats]
) -> tuple[Floats, Floats]:
    """The step of `bounded_optimum` with |row·step| ≤ 1 for each row, and the matrix that made it.

    Held back by stiffness along a row, which is added to the matrix, and as nearly as `ROUNDS` of
    that lead to.

    Parameters
    ----------
    slope, lower : (p,) array
    matrix : (p, p) array
    rows : sequence of (p,) array
    """
    step = bounded_optimum(slope, matrix, lower)
    for _ in range(ROUNDS if len(rows) else 0):
        far = [abs(float(row @ step)) for row in rows]
        worst = int(np.argmax(far))
        if far[worst] <= 1.0 + _SLIGHT:
            break
        row = rows[worst]
        # (A + k rrᵀ)⁻¹ b goes along r by r·A⁻¹b/(1 + k r·A⁻¹r) (Sherman and Morrison, 1950)
        eased = float(row @ cho_solve(cho_factor(matrix, lower=True), row))
        matrix = matrix + (far[worst] - 1.0) / eased * np.outer(row, row)
        step = bounded_optimum(slope, matrix, lower)
    return step, matrix
