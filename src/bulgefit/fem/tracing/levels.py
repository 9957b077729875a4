"""The solved levels of a path: predicted, balanced, and how far off the dense output is."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from bulgefit.errors import Cause
from bulgefit.fem.equilibrium import NewtonError, solve
from bulgefit.fem.hermite import STENCIL, combine, hermite_weights, stencil_at
from bulgefit.fem.linear import Factor, NotPositiveDefiniteError
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.sensitivity import slope_in_pressure, stiffness_sensitivity
from bulgefit.fem.volume_control import Point

__all__ = ["BandedError", "Level", "Tracer", "are_alike", "is_between", "is_over_kinks"]

Floats = NDArray[np.float64]

#: Levels whose Hermite polynomial predicts the next one.
_PREDICTOR_LEVELS = 3
#: Levels that predict the next are apart by at least this share of the step.
_APART = 0.25
#: Share of its size by which a level's slope may differ from a parabola's, or a pole is near.
_POLE = 0.1
#: Where on the way between two shapes the potential is looked at, as shares of it: a snap that is
#: an eighth of a step has a ridge over a thirteenth of the way.
_LOOKS = 16
_BETWEEN = tuple(k / _LOOKS for k in range(1, _LOOKS))
_TINY = np.finfo(float).tiny


@dataclass(eq=False)
class Level:
    """A solved level: what the path keeps of an equilibrium, and its factor for a while.

    Whether it is `stable` the tangent says that it was balanced with: its own where it is `exact`.
    """

    s: float
    displacement: Floats
    slope: Floats
    sensitivity: tuple[Floats, Floats] | None
    wrinkled: int
    stable: bool
    exact: bool
    factor: Factor | None


@dataclass(frozen=True, eq=False)
class _Estimate:
    """The dense output halfway between two levels through the levels `knots`, and its error."""

    knots: tuple[float, ...]
    shape: Floats
    error: float


class BandedError(NewtonError):
    """Descent has come to a shape at which the law is not elliptic, past others that it left.

    Bands of shear may lie in many ways there, and no path tells this one from the others.
    """


def is_between(change: Floats, before: Floats, after: Floats, apart: float) -> bool:
    """Whether a branch changes (n, 3) as its tangents at both ends say, to a length `apart` (mm).

    Smooth ones do as the first says; over a kink a part f as that and the rest as the second,
    f b + (1 - f) a.
    """
    return bool(np.abs(change - before).max() <= apart) or _left(change, before, after) <= apart


def is_over_kinks(change: Floats, before: Floats, after: Floats) -> bool:
    """Whether tangents at both ends leave no more of a change (n, 3) than kinks may.

    Of kinks at several places each has a part f of its own, so that one for all is half of what it
    is worth off, at most. A leap that is in none of the tangents leaves about itself.
    """
    return 2.0 * _left(change, before, after) <= float(np.abs(before - after).max())


def is_leapless(change: Floats, before: Floats, after: Floats) -> bool:
    """Whether tangents at both ends leave less for a leap than lies between two looks at the way.

    Whatever part of a change (n, 3) is as either of them says, a leap is the rest, so that it is no
    greater than what the worse one is off by.
    """
    off = max(np.abs(change - before).max(), np.abs(change - after).max())
    return bool(_LOOKS * off <= np.abs(change).max())


def are_alike(change: Floats, before: Floats, after: Floats) -> bool:
    """Whether the tangents at both ends of a change (n, 3) differ by less than half of it.

    As a fold comes near one of them turns to the mode that the cloth snaps by, so that a leap may
    lie between them.
    """
    return bool(2.0 * np.abs(before - after).max() <= np.abs(change).max())


def _left(change: Floats, before: Floats, after: Floats) -> float:
    """What is left (mm) of a change by what lies between those that two tangents say."""
    bend, rest = before - after, change - after
    share = np.clip(np.vdot(bend, rest) / max(np.vdot(bend, bend), _TINY), 0.0, 1.0)
    return float(np.abs(rest - share * bend).max())


class Tracer:
    """Solved levels in s = p^(1/3), and the work spent on them."""

    def __init__(
        self,
        membrane: Membrane,
        stiffness: Floats,
        tolerance: float,
        sensitivities: bool,
        *,
        elliptic: bool,
    ) -> None:
        self.membrane, self.stiffness = membrane, stiffness
        #: Wanted error (mm) of the dense output.
        self.tolerance = tolerance
        self.sensitivities = sensitivities
        #: Whether the path ends where the law loses ellipticity.
        self.elliptic = elliptic
        self.levels: list[Level] = []
        #: The last shape that was asked for, as it is over and over, and whether it is elliptic.
        self._looked_at: tuple[Floats, bool] | None = None
        self.work = 0
        self.wasted = 0
        self.closing_in = False
        #: Descent is long where it fails, so it is not tried again then, until a shorter step by it
        #: has led on.
        self.descends, self.creeps = True, True
        #: Whether no step in pressure had found the last level by a search along the path, however
        #: short, or descent had; and whether descent had found the last one between others.
        self.closely, self.by_descent, self.between_by_descent = False, False, False
        #: Whether descent had found the last level in the valley of the one below it, over kinks.
        self.in_valley = False
        self._estimates: dict[tuple[float, float], _Estimate] = {}
        self.failure = NewtonError("steps shrink to nothing", 0, 0.0, 0)
        # blown from the other side, a flat membrane shows its mirror image
        self.mirrored = membrane.fabric.lies_flat

    def is_elliptic(self, displacement: Floats) -> bool:
        """Whether the law is elliptic all over a shape."""
        if self._looked_at is None or self._looked_at[0] is not displacement:
            elliptic = self.membrane.is_elliptic(displacement, self.stiffness)
            self._looked_at = displacement, elliptic
        return self._looked_at[1]

    def is_convex(
        self,
        low: tuple[float, Floats],
        high: tuple[float, Floats],
        tangents: tuple[Floats, Floats],
    ) -> bool:
        """Whether the potential is convex between two balanced shapes, each with its pressure.

        Stable shapes on either side of a snap have a ridge between them, on which a tangent is not
        positive definite. Over kinks of one branch, however many, all are. The straight way may
        lead round a ridge, as may that of the ends' `tangents` (each by all that lies between):
        where these are not alike, both are looked at; where they leave nothing that could be seen
        between two looks, neither is.
        """
        change = high[1] - low[1]
        if is_leapless(change, *tangents):
            return True
        looks = [(share, low[1] + share * change) for share in _BETWEEN]
        if not are_alike(change, *tangents):
            way = CubicHermiteSpline((0.0, 1.0), (low[1], high[1]), tangents)
            looks += [(share, way(share)) for share in _BETWEEN]
        for share, shape in looks:
            pressure = low[0] + share * (high[0] - low[0])
            state = self.membrane.state(shape, pressure, self.stiffness)
            if not np.isfinite(state.potential):  # a cell has collapsed
                return False
            self.work += 1
            try:
                self.membrane.factorise(state, spent=True)
            except NotPositiveDefiniteError:
                return False
        return True

    def is_sound(self, found: Level | Point) -> bool:
        """Whether what was found is stable, or the law elliptic, where that matters."""
        return not self.elliptic or found.stable or self.is_elliptic(found.displacement)

    def look_again(self, level: Level) -> None:
        """Tell whether a level is stable by its own tangent.

        Another shape's does not tell where a path forks into shapes that no longer mirror: these
        take no part in the balance of those that do.
        """
        if level.exact:
            return
        self.work += 1
        state = self.membrane.state(level.displacement, level.s**3, self.stiffness)
        try:
            self.membrane.factorise(state, spent=True)
        except NotPositiveDefiniteError:
            level.stable = False
        level.exact = True

    def sound_from(self, guess: Floats, s: float) -> tuple[Floats, Floats] | None:
        """The shape balanced from a guess, and its ∂u/∂s, where it is stable or the law elliptic.

        Of the dense output itself it would not do: where shear is soft, its 3e-4 mm move the
        pressure at which a path turns unstable by a hundredth.
        """
        try:
            balance = solve(self.membrane, guess, s**3, self.stiffness, follow=True, exact=True)
        except NewtonError as error:
            self.work += error.work
            return None
        self.work += balance.factorisations
        if not (balance.stable or self.is_elliptic(balance.displacement)):
            return None
        return balance.displacement, slope_in_pressure(self.membrane, balance, self.stiffness)

    def solve(
        self,
        s: float,
        guess: Floats,
        *,
        follow: bool,
        rough: bool = False,
        patient: bool = False,
        convex: bool = False,
    ) -> None:
        """Balance a level and keep it.

        The slope of a level that is not `rough` has to fit the level below. Where the law is not
        elliptic, descent may leap into bands of shear; a level that is `convex` is one that it has
        come to in the valley of the newest one.

        Raises
        ------
        NewtonError
        """
        # over a singular point, as paths go that do not end there, leaps may end anywhere
        near = follow and not rough and self.elliptic
        within = self._step_to(s, guess) if near else np.inf
        try:
            balance = solve(
                self.membrane, guess, s**3, self.stiffness,
                thrifty=True, follow=follow, exact=self.sensitivities or convex, patient=patient,
                convex=convex, within=within,
            )  # fmt: skip
        except NewtonError as error:
            self.work += error.work
            self.wasted += error.work
            # a copy: the error itself holds this object by its traceback, in a circle
            self.failure = NewtonError(
                error.reason, error.iteration, error.residual_norm, error.work, error.cause
            )
            raise
        self.work += balance.factorisations
        if self.elliptic and balance.leapt and not self.is_elliptic(balance.displacement):
            self.wasted += balance.factorisations
            reason = Cause.LOSS_OF_ELLIPTICITY
            raise BandedError(reason.value, 0, 0.0, 0, reason)
        slope = slope_in_pressure(self.membrane, balance, self.stiffness)
        if convex and not self._is_near(s, balance.displacement, slope):
            self.wasted += balance.factorisations
            raise NewtonError("the shape is one of another branch", 0, 0.0, 0)
        smooth = follow and not rough and not self.closing_in
        if smooth and self._is_rough(s, balance.displacement, slope):
            self.wasted += balance.factorisations
            raise NewtonError("the tangent is nearly singular", 0, 0.0, 0)
        sensitivity = (
            stiffness_sensitivity(self.membrane, balance, slope, self.stiffness)
            if self.sensitivities
            else None
        )
        level = Level(
            s,
            balance.displacement,
            slope,
            sensitivity,
            balance.wrinkled,
            balance.stable,
            balance.exact,
            balance.factor,
        )
        self.levels.insert(bisect([other.s for other in self.levels], s), level)

    def _step_to(self, s: float, guess: Floats) -> float:
        """The length (mm) of the step to a guess, beyond which a correction tells it was wrong."""
        below = self.levels[bisect([level.s for level in self.levels], s) - 1]
        return float(np.abs(guess - below.displacement).max())

    def _is_near(self, s: float, shape: Floats, slope: Floats) -> bool:
        """Whether a shape and its ∂u/∂s are in the valley of the newest level."""
        below = self.levels[-1]
        tangents = ((s - below.s) * below.slope, (s - below.s) * slope)
        return is_over_kinks(shape - below.displacement, *tangents) and self.is_convex(
            (below.s**3, below.displacement), (s**3, shape), tangents
        )

    def predict(self, s: float) -> Floats:
        """Extrapolation of the newest levels, or of their mirror images where they are few.

        Levels much closer together than the step is long would only lend it their noise.
        """
        levels = [self.levels[-1]]
        apart = _APART * (s - levels[0].s)
        for level in reversed(self.levels):
            if level.s <= levels[0].s - apart and len(levels) < _PREDICTOR_LEVELS:
                levels.insert(0, level)
        return self._blend(levels, s, _PREDICTOR_LEVELS)

    def lowest(self, shapes: Sequence[Floats], s: float) -> Floats:
        """Of several shapes (n, 3) mm that whose potential is least: from there descent is short.

        One that has a collapsed cell is none.
        """
        potentials = [
            self.membrane.state(x, s**3, self.stiffness, tangent=False).potential for x in shapes
        ]
        return shapes[int(np.argmin(np.where(np.isfinite(potentials), potentials, np.inf)))]

    def interpolate(self, s: float) -> Floats:
        """The dense output between the levels."""
        return self._blend(self.levels, s, STENCIL)

    def _is_rough(self, s: float, displacement: Floats, slope: Floats) -> bool:
        """True where a level's slope does not fit the level below it.

        The slope has a pole where the tangent is singular. A level beside the pole would spoil
        the dense output far around it, while the path is mostly smooth on either side. Where the
        law is not elliptic the branch may have folded, so that the level is one of another.
        """
        below = self.levels[bisect([level.s for level in self.levels], s) - 1]
        change, before = displacement - below.displacement, (s - below.s) * below.slope
        after = (s - below.s) * slope
        if np.abs(after - 2.0 * change + before).max() > _POLE * np.abs(after).max():
            return True
        folds = self.elliptic and not are_alike(change, before, after)
        return folds and not self.is_elliptic(below.displacement)

    def error(self, after: int, slight: float) -> float:
        """Error (mm) of the dense output halfway between level `after` and the next.

        Newton's correction of the interpolated shape. The stiffness there lies between those of
        the two levels, so the estimate is the geometric mean of what their factors say. Where
        another level has changed the stencil, the shape's change is added to the error it had; if
        that is `slight` (mm), or their factors are gone, it is not measured anew.
        """
        low, high = self.levels[after], self.levels[after + 1]
        middle = 0.5 * (low.s + high.s)
        knots = stencil_at(
            np.array([level.s for level in self.levels]), middle, mirrored=self.mirrored
        )
        known = self._estimates.get((low.s, high.s))
        if known is not None and known.knots == knots:
            return known.error
        shape = self.interpolate(middle)
        error = np.inf
        if known is not None:
            error = known.error + float(np.abs(shape - known.shape).max())
        factors = [level.factor for level in (low, high) if level.factor is not None]
        if error > slight and (factors or known is None):
            above = (level.factor for level in self.levels[after:] if level.factor is not None)
            error = self._measured_error(factors or [next(above)], middle, shape)
        self._estimates[low.s, high.s] = _Estimate(knots, shape, error)
        return error

    def _measured_error(self, factors: list[Factor], s: float, shape: Floats) -> float:
        state = self.membrane.state(shape, s**3, self.stiffness, tangent=False)
        if not np.isfinite(state.potential):
            return np.inf
        sizes = [float(np.abs(factor.solve(state.residual)).max()) for factor in factors]
        return float(np.prod(sizes)) ** (1.0 / len(sizes))

    def errors(self, slight: float) -> Floats:
        """Errors (levels - 1,) mm of the dense output between the levels (see `error`)."""
        return np.array([self.error(after, slight) for after in range(len(self.levels) - 1)])

    def judge(self) -> None:
        """Estimate the error below the newest level while there is a factor to do so by."""
        if len(self.levels) > 1:
            self.error(len(self.levels) - 2, 0.0)
        self.forget()

    def forget(self) -> None:
        """Let go of the factors that no estimate needs any more."""
        for level in self.levels[:-STENCIL]:
            level.factor = None

    def _blend(self, levels: list[Level], s: float, stencil: int) -> Floats:
        weights = hermite_weights(
            np.array([level.s for level in levels]),
            np.array([s]),
            mirrored=self.mirrored,
            stencil=stencil,
        )
        values = np.array([level.displacement for level in levels])
        return combine(weights, values, np.array([level.slope for level in levels]))[0]
