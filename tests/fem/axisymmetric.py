"""An independent reference: the inflated isotropic disc as a boundary-value problem in the radius.

A ring at radius R moves to (r, z). With the meridian stretch λ = √(r'² + z'²), the hoop stretch
μ = r/R and the nominal forces per reference length N = t0 P1, H = t0 P2 (P = ∂W/∂λ, ∂W/∂μ),
balance along r and under the follower pressure of the cap above (radius r) reads

    d(R N r'/λ)/dR = H - p r z'        [z' < 0: the pressure pushes outwards]
    R N z'/λ = -p r²/2                 (force on the cap)

W is ½ e:D:e, in principal stretches e = ln λ (hencky) or (λ² - 1)/2 (svk). Unknowns are r and
T = R N cos φ; λ follows from |(T, p r²/2)| = R N(λ, μ) by Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

Floats = NDArray[np.float64]


def _strain(stretch: Floats, law: str) -> tuple[Floats, Floats]:
    """Strain and its derivative by the stretch."""
    if law == "hencky":
        return np.log(stretch), 1.0 / stretch
    return 0.5 * (stretch**2 - 1.0), stretch


def _forces(
    along: Floats, hoop: Floats, law: str, modulus: float, nu: float, thickness: float
) -> tuple[Floats, Floats]:
    """Nominal forces N, H per reference length (N/mm)."""
    scale = thickness * modulus / (1.0 - nu**2)
    e1, d1 = _strain(along, law)
    e2, d2 = _strain(hoop, law)
    return scale * (e1 + nu * e2) * d1, scale * (e2 + nu * e1) * d2


def _stretch(
    force: Floats, hoop: Floats, law: str, modulus: float, nu: float, thickness: float
) -> Floats:
    """λ with N(λ, μ) = force on the rising branch."""
    along = np.ones_like(force)
    h = 1e-7
    for _ in range(80):
        value = _forces(along, hoop, law, modulus, nu, thickness)[0] - force
        up = _forces(along + h, hoop, law, modulus, nu, thickness)[0]
        down = _forces(along - h, hoop, law, modulus, nu, thickness)[0]
        step = value / ((up - down) / (2 * h))
        along = np.clip(along - step, 0.7, 1.8)
        if np.abs(step).max() < 1e-14:
            break
    return along


def inflated(
    pressure: float,
    *,
    law: str,
    modulus: float,
    nu: float,
    thickness: float = 0.81,
    radius: float = 100.0,
) -> Callable[[Floats], dict[str, Floats]]:
    """The clamped disc under `pressure` (MPa), as a function of the reference radius (mm).

    It gives r, z (mm), both stretches, and both forces per deformed length (N/mm); radii from a
    thousandth of the disc's on.
    """
    start = 1e-3 * radius  # the centre is regular: r = μ R, T = R N

    def slopes(at: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        r, tension = y[0], y[1]
        vertical = 0.5 * pressure * r**2
        hoop = r / at
        along = _stretch(np.hypot(tension, vertical) / at, hoop, law, modulus, nu, thickness)
        size = np.hypot(tension, vertical)
        return along * tension / size, -along * vertical / size, along, hoop

    def right(at: Floats, y: Floats) -> Floats:
        dr, dz, along, hoop = slopes(at, y)
        ring = _forces(along, hoop, law, modulus, nu, thickness)[1]
        return np.vstack([dr, ring + pressure * y[0] * dz, dz])

    def ends(inner: Floats, outer: Floats) -> Floats:
        # near the centre N = H at λ = μ, to third order in the radius
        hoop = np.array([inner[0] / start])
        tension = start * _forces(hoop, hoop, law, modulus, nu, thickness)[0][0]
        return np.array([inner[1] - tension, outer[0] - radius, outer[2]])

    at = start + (radius - start) * np.linspace(0, 1, 200) ** 1.5
    strain = 0.3 * (pressure * radius / (modulus * thickness)) ** (2 / 3)
    force = modulus * thickness / (1 - nu) * strain
    height = 0.65 * radius * np.cbrt(pressure * radius / (modulus * thickness))
    guess = np.vstack([at * (1 + strain * (1 - (at / radius) ** 2)), at * force,
                       height * (1 - (at / radius) ** 2)])  # fmt: skip
    found = solve_bvp(right, ends, at, guess, tol=1e-9, max_nodes=100_000)
    if not found.success:
        raise ArithmeticError(found.message)

    def solution(at: Floats) -> dict[str, Floats]:
        y = found.sol(at)
        _, dz, along, hoop = slopes(at, y)
        meridian, ring = _forces(along, hoop, law, modulus, nu, thickness)
        return {
            "r": y[0], "z": y[2], "dz": dz, "along": along, "hoop": hoop,
            "meridian_tension": meridian / hoop, "hoop_tension": ring / along,
        }  # fmt: skip

    return solution


def apex(pressure: float, *, radius: float = 100.0, **material: Any) -> float:
    """Apex height (mm) of the clamped disc under `pressure` (MPa)."""
    start = 1e-3 * radius
    found = inflated(pressure, radius=radius, **material)(np.array([start]))
    return float(found["z"][0] - 0.5 * start * found["dz"][0])
