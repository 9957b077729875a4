"""Exact derivatives of balanced shapes: back-substitutions with the factor of their tangent.

At equilibrium R(u, p, θ) = 0, so along a path in s = p^(1/3), at fixed θ,

    K u' = 3 s² f,      K V = -R_θ,      K V' = -d/ds(R_θ + K V)|V held,

with f = -∂R/∂p, V = ∂u/∂θ and ' = d/ds. The last line is the second differentiated along the
path: V' = d²u/(ds dθ) makes the derivative of a Hermite dense output exact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.equilibrium import Equilibrium
from bulgefit.fem.membrane import Membrane

__all__ = ["parameter_sensitivity", "slope_in_pressure", "stiffness_sensitivity"]

Floats = NDArray[np.float64]

#: ∂R/∂θ, (k, N), at a displacement (n, 3) mm and a pressure (MPa).
ForceDerivative = Callable[[Floats, float], Floats]

#: Span of the difference along the path, relative to s. The truncation error is in proportion,
#: the rounding error 1e-16 over it.
_ALONG = 1e-6

#: Corrections of a slope that are worth another, relative to it, and the most of them.
_SLIGHT, _CORRECTIONS = 1e-3, 6


def slope_in_pressure(membrane: Membrane, balance: Equilibrium, stiffness: Floats) -> Floats:
    """∂u/∂s, s = p^(1/3): (n, 3) mm/MPa^(1/3).

    The search may have found it by the way. The factor may be that of a shape some way off; then
    what the out-of-balance force still changes along the slope corrects it.
    """
    s = np.cbrt(balance.pressure)
    slope, changed = balance.slope, balance.slope_change
    for _ in range(_CORRECTIONS):
        if changed <= _SLIGHT:
            break
        along = (slope, 3.0 * s**2)
        change = membrane.state(
            balance.displacement, balance.pressure, stiffness, tangent=False, along=along
        ).change
        assert change is not None
        correction = membrane.spread(balance.factor.solve(change))
        slope = slope - correction
        changed = np.abs(correction).max() / np.abs(slope).max()
        if balance.exact:
            break
    return slope


def parameter_sensitivity(
    membrane: Membrane,
    balance: Equilibrium,
    slope: Floats,
    stiffness: Floats,
    force_derivative: ForceDerivative,
) -> tuple[Floats, Floats]:
    """∂u/∂θ at fixed pressure, and its slope d/ds along the path: two (k, n, 3).

    Parameters
    ----------
    balance : Equilibrium
        Found with its exact factor.
    slope : (n, 3) array, mm/MPa^(1/3)
        ∂u/∂s of the balance.
    stiffness : (4,) array, MPa
    force_derivative : callable
        ∂R/∂θ (k, N) at a displacement (n, 3) mm and a pressure in MPa.
    """
    s = np.cbrt(balance.pressure)
    h = _ALONG * s
    ahead, pressure = balance.displacement + h * slope, (s + h) ** 3
    force = force_derivative(balance.displacement, balance.pressure)
    force_ahead = force_derivative(ahead, pressure)
    value = membrane.spread(balance.factor.solve(-force.T).T)
    # what R_θ + K V, zero at the balance itself, has grown to
    turn = force_ahead + membrane.tangent_product(ahead, pressure, stiffness, value)
    return value, membrane.spread(balance.factor.solve(turn.T / -h).T)


def stiffness_sensitivity(
    membrane: Membrane, balance: Equilibrium, slope: Floats, stiffness: Floats
) -> tuple[Floats, Floats]:
    """∂u/∂(D11, D22, D12, D33) (4, n, 3) mm/MPa, and its slope per MPa^(1/3)."""
    return parameter_sensitivity(
        membrane,
        balance,
        slope,
        stiffness,
        lambda shape, _: membrane.stiffness_force(shape, stiffness),
    )
