"""Follow the membrane from light pressure up, in few levels, to a tolerance of the dense output."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, SolveError
from bulgefit.fem.elasticity import STIFFNESS_NAMES
from bulgefit.fem.equilibrium import Equilibrium, NewtonError, flat_guess, solve
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.path import PARITY, Path, extrapolate
from bulgefit.fem.sensitivity import slope_in_pressure, stiffness_sensitivity

__all__ = ["TOLERANCE", "trace"]

Floats = NDArray[np.float64]

#: Default error of the dense output, mm for a radius of 100 mm.
TOLERANCE = 1e-3

_PREDICTOR_LEVELS = 3
_SMALLEST_STEP = 1e-4  # of the whole range in s


class _Levels:
    """Solved levels in s = p^(1/3), with the mirror images that a flat membrane has."""

    def __init__(self, mirrored: bool) -> None:
        self.mirrored = mirrored
        self.s: list[float] = []
        self.balance: list[Equilibrium] = []
        self.slope: list[Floats] = []

    def add(self, s: float, balance: Equilibrium, slope: Floats) -> None:
        self.s.append(s)
        self.balance.append(balance)
        self.slope.append(slope)

    def newest(self, count: int) -> tuple[Floats, Floats, Floats]:
        """Knots, values and slopes of the newest levels, images filling up."""
        s = self.s[-count:]
        values = [b.displacement for b in self.balance[-count:]]
        slopes = self.slope[-count:]
        if self.mirrored and len(s) < count:
            images = range(min(len(s), count - len(s)))
            s = [-s[i] for i in images] + s
            values = [values[i] * PARITY for i in images] + values
            slopes = [slopes[i] * -PARITY for i in images] + slopes
        return np.array(s), np.array(values), np.array(slopes)


def trace(
    membrane: Membrane,
    stiffness: Floats,
    pressure: tuple[float, float] = (1e-4, 0.3),
    *,
    tolerance: float = TOLERANCE,
    sensitivities: bool = False,
    parameters: Mapping[str, float] | None = None,
) -> Path:
    """Balance the membrane from the lower to the upper pressure.

    Steps in s = p^(1/3) are predicted by Hermite extrapolation of the last levels. The
    difference between prediction and equilibrium, scaled by the ratio of the error polynomials,
    estimates the error of the dense output over the step and sets the length of the next.

    Parameters
    ----------
    membrane : Membrane
    stiffness : (4,) array, MPa
        D11, D22, D12, D33.
    pressure : (low, high), MPa
        A flat membrane's path also covers 0 to low, by symmetry.
    tolerance : float, mm
        Wanted error of the dense output, for a radius of 100 mm.
    sensitivities : bool
        Also find ∂u/∂D at every level.
    parameters : mapping, optional
        Named in errors; default: the stiffness.

    Raises
    ------
    InputError
        Pressures not 0 < low <= high.
    SolveError
        No equilibrium, with the pressure that was reached.
    """
    low, high = float(pressure[0]), float(pressure[1])
    if not (0.0 < low <= high < np.inf):
        raise InputError(
            f"pressures must satisfy 0 < lowest <= highest, got {10 * low:g} to {10 * high:g} bar"
        )
    shown = dict(parameters or zip(STIFFNESS_NAMES, stiffness.tolist(), strict=True))
    renew = 1e-6 if sensitivities else 1e-4
    levels = _Levels(mirrored=True)
    work = 0

    def fail(error: NewtonError, at: float) -> SolveError:
        reason = f"no equilibrium: {error.reason}"
        if levels.s:
            reason += " (a limit pressure of this material, or compression without relaxation)"
        return SolveError(
            reason,
            pressure=at,
            reached=levels.s[-1] ** 3 if levels.s else 0.0,
            iteration=error.iteration,
            residual_norm=error.residual_norm,
            parameters=shown,
        )

    try:
        balance = solve(
            membrane, flat_guess(membrane, low, stiffness), low, stiffness, renew_above=renew
        )
    except NewtonError as error:
        raise fail(error, low) from error
    work += balance.factorisations
    s, end = np.cbrt(low), np.cbrt(high)
    levels.add(s, balance, slope_in_pressure(membrane, balance))
    step = _first_step(membrane, stiffness)
    worst = 0.0
    while s < end * (1 - 1e-12):
        # equal steps to the end rather than a short last one
        target = end if s + 1.01 * step >= end else s + min(step, 0.5 * (end - s) + 0.01 * step)
        knots, values, slopes = levels.newest(_PREDICTOR_LEVELS)
        guess = extrapolate(knots, values, slopes, target)
        try:
            balance = solve(
                membrane, guess, target**3, stiffness, renew_above=renew, follow=True
            )
        except NewtonError as error:
            work += error.work
            step = 0.4 * (target - s)
            if step < _SMALLEST_STEP * end:
                raise fail(error, target**3) from error
            continue
        work += balance.factorisations
        miss = float(np.abs(balance.displacement - guess).max())
        estimate = miss * _interpolation_ratio(knots, target)
        order = 2 * len(knots)
        unit = membrane.radius / 100.0
        factor = (0.5 * tolerance * unit / max(estimate, 1e-16)) ** (1.0 / order)
        if estimate > tolerance * unit and target - s > 20 * _SMALLEST_STEP * end:
            step = (target - s) * min(0.7, max(0.2, factor))
            continue
        worst = max(worst, estimate)
        step = (target - s) * min(2.5, max(0.4, factor))
        s = target
        levels.add(s, balance, slope_in_pressure(membrane, balance))
    return Path(
        nodes=membrane.mesh.nodes,
        cells=membrane.mesh.cells,
        pressure=np.array(levels.s) ** 3,
        displacement=np.array([b.displacement for b in levels.balance]),
        slope=np.array(levels.slope),
        sensitivity=np.array(
            [stiffness_sensitivity(membrane, b, stiffness) for b in levels.balance]
        )
        if sensitivities
        else None,
        mirrored=levels.mirrored,
        factorisations=work,
        error_estimate=worst,
        wrinkled=np.array([b.wrinkled for b in levels.balance]),
        stable=np.array([b.stable for b in levels.balance]),
    )


def _first_step(membrane: Membrane, stiffness: Floats) -> float:
    """A step in s that is small against (E t/a)^(1/3), the scale on which shapes change."""
    scale = 0.5 * (stiffness[0] + stiffness[1]) * membrane.thickness / membrane.radius
    return 0.08 * float(np.cbrt(scale))


def _interpolation_ratio(knots: Floats, target: float) -> float:
    """Error of interpolation over the newest step, over that of extrapolation to its end.

    Both are a high derivative times the squared node polynomial; interpolation has the new
    level in place of the oldest.
    """
    missed = np.prod((target - knots) ** 2)
    inside = np.linspace(knots[-1], target, 21)[1:-1]
    stencil = np.append(knots[1:], target) if len(knots) > 1 else np.append(knots, target)
    reached = np.prod((inside[:, None] - stencil[None, :]) ** 2, axis=1).max()
    return float(reached / missed) if len(knots) > 1 else 1.0
