"""In which mode does a shape lose its stability, and how does what keeps it change?

Where the tangent K has a negative eigenvalue, a shape gives way along that mode φ, mostly a band of
shear. At a neighbour that is stable q = φᵀKφ is what keeps it from that. With R the residual,

    ∂q/∂θ = ∂²/∂ε² ∂/∂θ (potential along u + εφ) = φᵀ ∂/∂ε (∂R/∂θ) + ∂²R/∂ε² ∂u/∂θ,

by differences of R and of its derivatives by the parameters beside the shape.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from bulgefit.fem.linear import Factor, NotPositiveDefiniteError
from bulgefit.fem.membrane import Membrane, State
from bulgefit.model.forces import Forces

__all__ = ["Kept", "kept_by", "lost_mode"]

Floats = NDArray[np.float64]

#: Stiffness that is added to find the lowest mode, over the tangent's mean diagonal entry.
_SHIFTS = (1e-4 * 2.0 ** np.arange(20)).tolist()
#: Largest displacement (mm, for a radius of 100 mm) by which differences along a mode step: their
#: errors go with its square, and rounding with one over that.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Kept:
    """What keeps a shape from a mode.

    Attributes
    ----------
    stiffness : float, N/mm
        φᵀKφ over the sum of the squares of φ.
    rate : dict of name to float
        By the parameters, N/mm over their units.
    """

    stiffness: float
    rate: dict[str, float]


def lost_mode(
    membrane: Membrane, displacement: Floats, pressure: float, stiffness: Floats
) -> Floats | None:
    """The mode (n, 3), of unit length, in which a shape gives way most.

    None where it does not, or none is found.

    The lowest of the tangent is that of K + c, with c (N/mm) so large that it is positive definite:
    the largest of its inverse.
    """
    state = membrane.state(displacement, pressure, stiffness)
    if state.tangent is None or _factor(membrane, state) is not None:
        return None
    factors = (_factor(membrane, state, shift) for shift in _SHIFTS)
    factor, size = next((f for f in factors if f is not None), None), membrane.linear.size
    if factor is None:
        return None
    inverse = LinearOperator((size, size), matvec=factor.solve, dtype=np.float64)
    start = np.random.default_rng(0).normal(size=size)
    try:
        return membrane.spread(eigsh(inverse, k=1, which="LA", v0=start)[1][:, 0])
    except ArpackNoConvergence:
        return None


def _factor(membrane: Membrane, state: State, shift: float = 0.0) -> Factor | None:
    """Of the tangent with so much added to its diagonal; None where it is not positive definite."""
    try:
        return membrane.factorise(state, shift)
    except NotPositiveDefiniteError:
        return None


def kept_by(
    membrane: Membrane,
    forces: Forces,
    displacement: Floats,
    pressure: float,
    stiffness: Floats,
    frame: int,
    derivative: Mapping[str, Floats],
    mode: Floats,
) -> Kept:
    """What keeps a balanced shape from a mode.

    Parameters
    ----------
    membrane : Membrane
        In its clamp as that is in the frame.
    forces : Forces
        By the parameters.
    displacement : (n, 3) array, mm
    pressure : float, MPa
    stiffness : (4,) array, MPa
    frame : int
    derivative : mapping of name to (n, 3) array
        ∂(displacement)/∂(parameter) in the frame, in the order of `forces`.
    mode : (n, 3) array
    """
    own = membrane.gather(mode)
    step = _STEP * membrane.radius / 100.0 / float(np.abs(mode).max())
    above, below = displacement + step * mode, displacement - step * mode

    def residual(shape: Floats) -> Floats:
        return membrane.state(shape, pressure, stiffness, tangent=False).residual

    up, here, down = residual(above), residual(displacement), residual(below)
    second = (up - 2.0 * here + down) / step**2
    of_forces = (
        forces.columns(above, pressure, frame)[0] - forces.columns(below, pressure, frame)[0]
    )
    direct = of_forces @ own / (2.0 * step)
    length = float(own @ own)
    rate = {
        name: float(first + second @ membrane.gather(change)) / length
        for first, (name, change) in zip(direct, derivative.items(), strict=True)
    }
    return Kept(float(own @ (up - down)) / (2.0 * step) / length, rate)
