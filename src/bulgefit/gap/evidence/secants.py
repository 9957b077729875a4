"""What do the second derivatives of the residual add to JᵀJ? What steps have shown of it.

Gauss and Newton's matrix A = JᵀJ + diag(1/s²) leaves out Σ r·∇²r, with r measured minus modelled. A
misfit that no model takes away, and wrinkles that come and go with a step, make that no smaller
than A along some directions: steps as long as A lets them be lead uphill there, and the trust
region shrinks for all. Each step from k to k + 1 that was taken, s, tells it along itself without
another solve (Dennis, Gay and Welsch, 1981, "An adaptive nonlinear least-squares algorithm"):

    y = A₍k+1₎ s - (J₍k+1₎ - J₍k₎)ᵀ r₍k+1₎

A becomes B by an update of Broyden, Fletcher, Goldfarb and Shanno for each, the oldest first
(Nocedal and Wright, 2006, "Numerical optimization", eq. 6.19 and section 7.2),

    B ← B - B s sᵀB / sᵀBs + y yᵀ / yᵀs

and stays positive definite by Powell's damping (procedure 18.2 there).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["Secant", "with_secants"]

Floats = NDArray[np.float64]

#: A step and y of it, (p,) each.
Secant = tuple[Floats, Floats]

#: Of sᵀBs, what an update leaves at least: Powell's.
_LEFT = 0.2


def with_secants(matrix: Floats, secants: Sequence[Secant]) -> Floats:
    """B of A (p, p), positive definite, and the steps so far; A itself without any."""
    for step, change in secants:
        known = matrix @ step
        before, after = float(step @ known), float(step @ change)
        if after < _LEFT * before:
            share = (1.0 - _LEFT) * before / (before - after)
            change = share * change + (1.0 - share) * known
            after = _LEFT * before
        matrix = matrix + np.outer(change, change / after) - np.outer(known, known / before)
    return matrix
