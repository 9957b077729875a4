"""Where pressure cannot be stepped: the same branch of equilibria by its volume.

Beneath a membrane the volume V goes on to grow where the pressure has its greatest value, so there
the tangent bordered by ∂V/∂x is regular while the tangent itself is singular:

    K δu - f δp = -R,      f·δu = V_wanted - V,      f = ∂V/∂x

(Riks, 1979, Int. J. Solids Struct. 15, 529-551, with the volume for the arc length). A branch on
which more volume takes less pressure has passed its limit pressure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause
from bulgefit.fem.equilibrium import CORRECTION, NewtonError
from bulgefit.fem.linear import Factor, NotPositiveDefiniteError
from bulgefit.fem.membrane import Membrane, State

__all__ = ["Point", "at_volume", "highest_pressure"]

Floats = NDArray[np.float64]

#: Newton's method converges quadratically from a shape near by, or not at all. Where wrinkles come
#: and go, a correction may be as long as the one before it, or longer; where two are, it does not
#: contract. Over a kink it may go to and fro for ever, by lengths that are alike within a tenth.
_ITERATIONS, _AS_LONG, _NEVER_SHORTER = 10, 0.9, 2
#: Corrections (mm, for a radius of 100 mm) after which the factor at hand serves for the next: they
#: change ∂u/∂V by less than what any test of it asks for.
_RENEWED_ABOVE = 1e-5
#: What a correction of wrinkled cloth may be, over one that counts, to be the last: steps go on
#: from the shape, and levels are balanced from it.
_WRINKLED = 1e3
#: Parabolas through the pressures about the greatest one: each squares its error.
_PARABOLAS = 3


@dataclass(frozen=True, eq=False)
class Point:
    """An equilibrium of a branch.

    Attributes
    ----------
    displacement : (n, 3) array, mm
    pressure : float, MPa
    volume : float, mm³
    stable : bool
        Under a given pressure: the tangent is positive definite.
    wrinkled : int
        Gauss points in tension-field relaxation.
    rate : float, MPa/mm³
        dp/dV along the branch, 1/(f·K⁻¹f): above zero where more volume takes more pressure.
    slope : (n, 3) array, mm/mm³
        ∂u/∂V along the branch, K⁻¹f / f·K⁻¹f.
    work : int
        Factorisations spent.
    """

    displacement: Floats
    pressure: float
    volume: float
    stable: bool
    wrinkled: int
    rate: float
    slope: Floats
    work: int


def at_volume(
    membrane: Membrane,
    stiffness: Floats,
    start: Floats,
    pressure: float,
    volume: float,
    *,
    within: float = np.inf,
) -> Point:
    """The equilibrium with this volume, from a shape and a pressure near by.

    Parameters
    ----------
    within : float, mm
        What the first correction may be. Shapes of volumes near by lie within the radius at least;
        far from any, a factor may fill up without end.

    Raises
    ------
    NewtonError
    """
    displacement, unit = membrane.tied(start), membrane.radius / 100.0
    close, size, as_long, work = CORRECTION * unit, np.inf, 0, 0
    within = min(within, membrane.radius)
    for iteration in range(1, _ITERATIONS + 1):
        before, renewed = size, size > _RENEWED_ABOVE * unit
        state = membrane.state(displacement, pressure, stiffness, tangent=renewed)
        if not np.isfinite(state.potential):
            raise NewtonError("a cell has collapsed", iteration, np.inf, work, Cause.COLLAPSED)
        force = membrane.pressure_force(displacement)
        if renewed:
            work += 1
            try:
                factor, stable = _factor(membrane, state)
            except NotPositiveDefiniteError as error:
                residual = float(np.abs(state.residual).max())
                raise NewtonError(
                    f"the tangent is singular ({error})", iteration, residual, work
                ) from error
            back, ahead = factor.solve(np.array([state.residual, force]).T).T
        else:
            back = factor.solve(state.residual)
        growth = float(force @ ahead)
        rate = (volume - membrane.volume(displacement) + force @ back) / growth
        correction = rate * ahead - back
        size = float(np.abs(correction).max())
        if not size <= (within if iteration == 1 else membrane.radius):
            break
        displacement = displacement + membrane.spread(correction)
        pressure += float(rate)
        # what follows a correction is of the order of its square; where there are wrinkles, which
        # come and go, of its own at most
        settled = size < 1e-3 * before and size * size <= close * membrane.radius
        if size <= close or (settled and (state.wrinkled == 0 or size <= _WRINKLED * close)):
            slope = membrane.spread(ahead) / growth
            return Point(
                displacement, pressure, volume, stable, state.wrinkled, 1.0 / growth, slope, work
            )
        as_long += size >= _AS_LONG * before
        if as_long == _NEVER_SHORTER:
            break
    residual = float(np.abs(state.residual).max())
    raise NewtonError("no convergence at a given volume", iteration, residual, work)


def _factor(membrane: Membrane, state: State) -> tuple[Factor, bool]:
    """Factor of a tangent, and whether it is positive definite.

    Raises
    ------
    NotPositiveDefiniteError
        It is singular: there is no factor.
    """
    try:
        return membrane.factorise(state), True
    except NotPositiveDefiniteError:
        assert state.tangent is not None
        return membrane.linear.factorise_indefinite(state.tangent), False


def highest_pressure(
    membrane: Membrane, stiffness: Floats, points: Sequence[Point]
) -> tuple[Point, int]:
    """The limit pressure of a branch that has passed it.

    Parameters
    ----------
    points : two of Point or more
        By volume; pressure rises up to the last but one, and falls at the last.

    Returns
    -------
    highest : Point
    work : int
        Factorisations spent.
    """
    low, best, high = points[-3:] if len(points) > 2 else (points[0], *points)
    work = 0
    for _ in range(_PARABOLAS):
        known = low is not best
        volume = _vertex(low, best, high) if known else 0.5 * (low.volume + high.volume)
        if not low.volume < volume < high.volume:
            break
        try:
            new = at_volume(membrane, stiffness, best.displacement, best.pressure, volume)
        except NewtonError as error:
            work += error.work
            break
        work += new.work
        if new.pressure > best.pressure:
            low, high = (low, best) if new.volume < best.volume else (best, high)
            best = new
        elif known:
            break
        else:
            high = new
    return max(best, points[-1], key=lambda point: point.pressure), work


def _vertex(a: Point, b: Point, c: Point) -> float:
    """Volume at the top of the parabola through three points."""
    left = (b.volume - a.volume) * (b.pressure - c.pressure)
    right = (b.volume - c.volume) * (b.pressure - a.pressure)
    top = (b.volume - a.volume) * left - (b.volume - c.volume) * right
    return b.volume - 0.5 * top / (left - right) if left != right else b.volume
