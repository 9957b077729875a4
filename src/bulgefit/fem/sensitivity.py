"""Exact derivatives of balanced shapes: back-substitutions with a factor that is there already.

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

#: Half the span of the difference along the path, relative to s. The truncation error is its
#: square, the rounding error 1e-16 over it.
_ALONG = 1e-4


def slope_in_pressure(membrane: Membrane, balance: Equilibrium) -> Floats:
    """∂u/∂s, s = p^(1/3): (n, 3) mm/MPa^(1/3)."""
    by_pressure = balance.factor.solve(membrane.pressure_force(balance.displacement))
    return membrane.spread(3.0 * np.cbrt(balance.pressure) ** 2 * by_pressure)


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
    slope : (n, 3) array, mm/MPa^(1/3)
        ∂u/∂s of the balance.
    stiffness : (4,) array, MPa
    force_derivative : callable
        ∂R/∂θ (k, N) at a displacement (n, 3) mm and a pressure in MPa.
    """
    s = np.cbrt(balance.pressure)
    h = _ALONG * s

    def beside(sign: float) -> tuple[Floats, Floats]:
        shape, pressure = balance.displacement + sign * h * slope, (s + sign * h) ** 3
        tangent = membrane.state(shape, pressure, stiffness).tangent
        assert tangent is not None
        return force_derivative(shape, pressure).T, tangent

    force_before, tangent_before = beside(-1.0)
    force_after, tangent_after = beside(1.0)
    linear, factor = membrane.linear, balance.factor
    force = force_derivative(balance.displacement, balance.pressure).T
    value = factor.solve(np.asfortranarray(-force))
    # The factor belongs to a shape slightly off. One refinement with the mean of the two
    # tangents, which is the tangent here to second order, squares the error that this leaves.
    middle = 0.5 * (tangent_before + tangent_after)
    value -= factor.solve(np.asfortranarray(force + linear.multiply(middle, value)))
    turn = (force_after - force_before) + linear.multiply(tangent_after - tangent_before, value)
    turn = np.asfortranarray(turn / (-2.0 * h))
    value_slope = factor.solve(turn)
    value_slope += factor.solve(np.asfortranarray(turn - linear.multiply(middle, value_slope)))
    return membrane.spread(value.T), membrane.spread(value_slope.T)


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
