"""Exact derivatives of a balanced shape: one back-substitution each, no new factorisation.

At equilibrium R(u, p, D) = 0, so K ∂u/∂θ = -∂R/∂θ at fixed shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.equilibrium import Equilibrium
from bulgefit.fem.membrane import Membrane

__all__ = ["slope_in_pressure", "stiffness_sensitivity"]

Floats = NDArray[np.float64]


def slope_in_pressure(membrane: Membrane, balance: Equilibrium) -> Floats:
    """∂u/∂s, s = p^(1/3): (n, 3) mm/MPa^(1/3)."""
    by_pressure = balance.factor.solve(membrane.pressure_force(balance.displacement))
    return membrane.spread(3.0 * np.cbrt(balance.pressure) ** 2 * by_pressure)


def stiffness_sensitivity(
    membrane: Membrane, balance: Equilibrium, stiffness: Floats
) -> Floats:
    """∂u/∂(D11, D22, D12, D33) at fixed pressure: (4, n, 3) mm/MPa."""
    forces = membrane.stiffness_force(balance.displacement, stiffness)
    return membrane.spread(-balance.factor.solve(np.asfortranarray(forces.T)).T)
