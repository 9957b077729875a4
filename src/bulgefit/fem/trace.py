"""Follow the membrane from light pressure up, in few levels, to a tolerance of the dense output."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause, InputError, SolveError
from bulgefit.fem.elasticity import STIFFNESS_NAMES
from bulgefit.fem.equilibrium import NewtonError, flat_guess, solve
from bulgefit.fem.hermite import STENCIL, combine, hermite_weights, stencil_at
from bulgefit.fem.linear import Factor
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.path import Path
from bulgefit.fem.sensitivity import slope_in_pressure, stiffness_sensitivity
from bulgefit.fem.volume_control import Point, at_volume, highest_pressure

__all__ = ["TOLERANCE", "trace"]

Floats = NDArray[np.float64]

#: Default error of the dense output, mm for a radius of 100 mm.
TOLERANCE = 1e-3

#: Levels whose Hermite polynomial predicts the next one.
_PREDICTOR_LEVELS = 3
#: Steps in s are no shorter than this share of the whole range.
_SMALLEST_STEP = 1e-4
#: Levels closer than this share of the range get none in between.
_CLOSEST = 0.02
#: Factorisations that failed attempts may cost before the path is given up.
_PATIENCE = 80
#: After a failure: shorter steps to try, as shares of the one that failed, and leaps over a
#: singular point, as shares of s.
_SHORTER, _SHORTER_STILL, _LEAPS = (
    (0.6, 0.3),
    (0.3, 0.1, 0.03),
    (0.015, 0.03, 0.05, 0.022, 0.08, 0.04, 0.12),
)
#: A path that stops at soft shear, G12 under this share of D11 + D22, starts anew with tolerances
#: this much coarser: longer steps leap over the singular points that stopped it.
_SOFT_SHEAR, _RESTARTS = 0.05, (1.0, 10.0, 100.0)
#: Levels that predict the next are apart by at least this share of the step.
_APART = 0.25
#: Share of its size by which a level's slope may differ from a parabola's.
_ROUGH = 0.1
#: Levels over the rest of the range once a path has been left for a stable one.
_SETTLED = 6
#: Share of the tolerance that steps aim at, and that no estimate may pass.
_AIM, _SURE = 0.1, 0.8
#: A smooth path takes five to fifteen levels (docs/performance.md). One that takes more has kinks,
#: where cloth that lay loosely draws taut, and where halving a step gains little: after so many
#: levels none are put in between, and steps are as long as it takes to end within the greater
#: number. The path's error estimate says what that leaves.
_MANY, _MOST = 20, 40
#: Growth of the volume in a step by volume: at first, the least that is tried, and the most.
_GROWTH, _LEAST_GROWTH, _MOST_GROWTH = 0.05, 1e-4, 0.2
#: Steps by volume before a branch that still rises is given up.
_BY_VOLUME = 40
#: Pressures that are tried one after another where cloth is too loose at the lowest to be found.
_TAUTER = (10.0, 100.0, 1000.0)
#: The lowest pressure over the one that is tried where cloth is past its loss of ellipticity there.
_LOWER = 100.0
#: Accuracy of the pressure at which ellipticity is lost, relative in s.
_BRACKET = 1e-4
#: Bisection of a volume ends where steps of this share of what is left lead to no shape.
_LEAST_SHARE = 0.01


@dataclass(eq=False)
class _Level:
    """A solved level: what the path keeps of an equilibrium, and its factor for a while."""

    s: float
    displacement: Floats
    slope: Floats
    sensitivity: tuple[Floats, Floats] | None
    wrinkled: int
    stable: bool
    factor: Factor | None


@dataclass(frozen=True, eq=False)
class _Estimate:
    """The dense output halfway between two levels through the levels `knots`, and its error."""

    knots: tuple[float, ...]
    shape: Floats
    error: float


class _BandedError(NewtonError):
    """Descent has come to a shape at which the law is not elliptic, past others that it left.

    Bands of shear may lie in many ways there, and no path tells this one from the others.
    """


class _Tracer:
    """Solved levels in s = p^(1/3), and the work spent on them."""

    def __init__(
        self, membrane: Membrane, stiffness: Floats, sensitivities: bool, *, elliptic: bool
    ) -> None:
        self.membrane, self.stiffness = membrane, stiffness
        self.sensitivities = sensitivities
        #: Whether the path ends where the law loses ellipticity.
        self.elliptic = elliptic
        self.levels: list[_Level] = []
        self.work = 0
        self.wasted = 0
        self.closing_in = False
        #: Descent is long where it fails, so it is not tried again then.
        self.descends = True
        #: Whether the last level was one that no step in pressure had found.
        self.by_volume = False
        self._estimates: dict[tuple[float, float], _Estimate] = {}
        self.failure = NewtonError("steps shrink to nothing", 0, 0.0, 0)
        # blown from the other side, a flat membrane shows its mirror image
        self.mirrored = membrane.fabric.surface is None

    def is_elliptic(self, displacement: Floats) -> bool:
        """Whether the law is elliptic all over a shape."""
        return bool(self.membrane.acoustic_margin(displacement, self.stiffness) >= 0.0)

    def is_sound(self, s: float) -> bool:
        """Whether the shape that is balanced from the dense output is stable, or the law elliptic.

        Of the dense output itself it would not do: where shear is soft, its 3e-4 mm move the
        pressure at which a path turns unstable by a hundredth.
        """
        try:
            balance = solve(
                self.membrane, self.interpolate(s), s**3, self.stiffness, follow=True, exact=True
            )
        except NewtonError as error:
            self.work += error.work
            return False
        self.work += balance.factorisations
        return balance.stable or self.is_elliptic(balance.displacement)

    def solve(
        self, s: float, guess: Floats, *, follow: bool, rough: bool = False, patient: bool = False
    ) -> float:
        """Balance a level and keep it; returns how far (mm) the guess was off.

        The slope of a level that is not `rough` has to fit the level below.
        """
        try:
            balance = solve(
                self.membrane, guess, s**3, self.stiffness,
                thrifty=True, follow=follow, exact=self.sensitivities, patient=patient,
            )  # fmt: skip
        except NewtonError as error:
            self.work += error.work
            self.wasted += error.work
            # a copy: the error itself holds this object by its traceback, in a circle
            self.failure = NewtonError(
                error.reason, error.iteration, error.residual_norm, error.work
            )
            raise
        self.work += balance.factorisations
        if self.elliptic and balance.leapt and not self.is_elliptic(balance.displacement):
            self.wasted += balance.factorisations
            reason = Cause.LOSS_OF_ELLIPTICITY
            raise _BandedError(reason.value, 0, 0.0, 0, reason)
        slope = slope_in_pressure(self.membrane, balance, self.stiffness)
        smooth = follow and not rough and not self.closing_in
        if smooth and self._is_rough(s, balance.displacement, slope):
            self.wasted += balance.factorisations
            raise NewtonError("the tangent is nearly singular", 0, 0.0, 0)
        sensitivity = (
            stiffness_sensitivity(self.membrane, balance, slope, self.stiffness)
            if self.sensitivities
            else None
        )
        level = _Level(
            s,
            balance.displacement,
            slope,
            sensitivity,
            balance.wrinkled,
            balance.stable,
            balance.factor,
        )
        self.levels.insert(bisect([other.s for other in self.levels], s), level)
        return float(np.abs(balance.displacement - guess).max())

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

    def lower(self, shape: Floats, s: float) -> Floats:
        """A shape, or that of the newest level where its potential is less: descent is shorter."""
        shapes = (shape, self.levels[-1].displacement)
        potentials = [
            self.membrane.state(x, s**3, self.stiffness, tangent=False).potential for x in shapes
        ]
        return shapes[int(potentials[1] < potentials[0] or not np.isfinite(potentials[0]))]

    def interpolate(self, s: float) -> Floats:
        """The dense output between the levels."""
        return self._blend(self.levels, s, STENCIL)

    def _is_rough(self, s: float, displacement: Floats, slope: Floats) -> bool:
        """True where a level's slope does not fit the level below it.

        The slope has a pole where the tangent is singular. A level beside the pole would spoil
        the dense output far around it, while the path is mostly smooth on either side.
        """
        below = self.levels[bisect([level.s for level in self.levels], s) - 1]
        fitting = 2.0 * (displacement - below.displacement) / (s - below.s) - below.slope
        return bool(np.abs(slope - fitting).max() > _ROUGH * np.abs(slope).max())

    def error(self, after: int, slight: float) -> float:
        """Error (mm) of the dense output halfway between level `after` and the next.

        Newton's correction of the interpolated shape. The stiffness there lies between those of
        the two levels, so the estimate is the geometric mean of what their factors say. Where
        another level has changed the stencil, the shape's change is added to the error it had; if
        that is `slight` (mm), it is not measured anew.
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
        if error > slight:
            error = self._measured_error(after, middle, shape)
        self._estimates[low.s, high.s] = _Estimate(knots, shape, error)
        return error

    def _measured_error(self, after: int, s: float, shape: Floats) -> float:
        state = self.membrane.state(shape, s**3, self.stiffness, tangent=False)
        if not np.isfinite(state.potential):
            return np.inf
        kept = [level.factor for level in self.levels[after:] if level.factor is not None]
        here = [
            level.factor for level in self.levels[after : after + 2] if level.factor is not None
        ]
        sizes = [float(np.abs(factor.solve(state.residual)).max()) for factor in here or kept[:1]]
        return float(np.prod(sizes)) ** (1.0 / len(sizes))

    def forget(self) -> None:
        """Let go of the factors that no estimate needs any more."""
        for level in self.levels[:-STENCIL]:
            level.factor = None

    def _blend(self, levels: list[_Level], s: float, stencil: int) -> Floats:
        weights = hermite_weights(
            np.array([level.s for level in levels]),
            np.array([s]),
            mirrored=self.mirrored,
            stencil=stencil,
        )
        values = np.array([level.displacement for level in levels])
        return combine(weights, values, np.array([level.slope for level in levels]))[0]


def trace(
    membrane: Membrane,
    stiffness: Floats,
    pressure: tuple[float, float] = (1e-4, 0.3),
    *,
    tolerance: float = TOLERANCE,
    sensitivities: bool = False,
    parameters: Mapping[str, float] | None = None,
    beyond_ellipticity: bool = False,
) -> Path:
    """Balance the membrane from the lower to the upper pressure.

    Steps in s = p^(1/3) are predicted by Hermite extrapolation of the last levels. The error of
    the dense output is measured halfway between levels, as Newton's correction there by the
    factors at hand; it sets the length of the next step, and where it is above the tolerance a
    level is put in between.

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
    beyond_ellipticity : bool
        Go on where the law has lost ellipticity. Equilibria are many there, and which is found
        depends on the mesh; a search learns more from them than from a failure.

    Raises
    ------
    InputError
        Pressures not 0 < low <= high.
    SolveError
        No equilibrium, with its cause and the pressure that was reached.
    """
    low, high = float(pressure[0]), float(pressure[1])
    if not (0.0 < low <= high < np.inf):
        raise InputError(
            f"pressures must satisfy 0 < lowest <= highest, got {10 * low:g} to {10 * high:g} bar"
        )
    shown = dict(parameters or zip(STIFFNESS_NAMES, stiffness.tolist(), strict=True))
    tolerance *= membrane.radius / 100.0
    _check_stiffness(stiffness, low, shown)
    soft = beyond_ellipticity and stiffness[3] < _SOFT_SHEAR * (stiffness[0] + stiffness[1])
    spent = 0
    for coarser in _RESTARTS if soft else (1.0,):
        tracer = _Tracer(membrane, stiffness, sensitivities, elliptic=not beyond_ellipticity)
        tracer.work = spent
        try:
            _start(tracer, np.cbrt(low), np.cbrt(high))
            return _path(tracer, _climb(tracer, np.cbrt(high), coarser * tolerance, leap=soft))
        except _StoppedError as stopped:
            failure = _solve_error(tracer, stopped, shown)
        except NewtonError as error:
            nowhere = _StoppedError(error.reason, error.cause, np.cbrt(low), 0.0, error)
            raise _solve_error(tracer, nowhere, shown) from error
        spent = tracer.work
    if soft:
        try:
            _settle(tracer, np.cbrt(high))
        except NewtonError as error:
            raise failure from error
        return _path(tracer, np.inf)
    raise failure


def _check_stiffness(stiffness: Floats, low: float, shown: Mapping[str, float]) -> None:
    d11, d22, d12, d33 = stiffness
    if not (min(d11, d22, d33) > 0.0 and d11 * d22 > d12**2 and np.isfinite(stiffness).all()):
        raise SolveError(
            f"no equilibrium: {Cause.INADMISSIBLE.value}", cause=Cause.INADMISSIBLE, pressure=low,
            reached=0.0, iteration=0, residual_norm=0.0, parameters=shown,
        )  # fmt: skip


def _start(tracer: _Tracer, low: float, high: float) -> None:
    """Balance the lowest level.

    Uneven or slack cloth lies loosely under a light pressure. Where patience does not find its
    shape, the shape at a pressure that draws it taut leads down to it.
    """
    membrane, stiffness = tracer.membrane, tracer.stiffness
    try:
        guess = flat_guess(membrane, low**3, stiffness)
        tracer.solve(low, guess, follow=False, patient=True)
    except _BandedError as banded:
        _start_lower(tracer, low, banded)
    except NewtonError as error:
        for factor in _TAUTER:
            pressures = low**3 * factor ** np.linspace(1.0, 0.0, 4)
            if pressures[0] > high**3:
                break
            shape = flat_guess(membrane, pressures[0], stiffness)
            try:
                for p in pressures[:-1]:
                    balance = solve(membrane, shape, p, stiffness)
                    tracer.work += balance.factorisations
                    shape = balance.displacement
                tracer.solve(low, shape, follow=False)
                return
            except _BandedError as banded:
                raise _lost_at(tracer, low, 0.0) from banded
            except NewtonError as again:
                tracer.work += again.work
        raise error


def _start_lower(tracer: _Tracer, low: float, banded: _BandedError) -> None:
    """Balance a level below the lowest, from which a path may lead up without a leap.

    Raises
    ------
    _StoppedError
        Where ellipticity is lost from the start.
    """
    p = low**3 / _LOWER
    guess = flat_guess(tracer.membrane, p, tracer.stiffness)
    try:
        tracer.solve(float(np.cbrt(p)), guess, follow=False, patient=True)
    except NewtonError:
        raise _lost_at(tracer, low, 0.0) from banded


def _check_ellipticity(tracer: _Tracer) -> None:
    """Stop a path that is unstable because the law has lost ellipticity.

    A mesh may hold back the bands of shear that a point no longer resists: as long as the tangent
    is positive definite the shape is that of the mesh's least potential, and the path goes on.

    Raises
    ------
    _StoppedError
        With the pressure at which the path is both unstable and not elliptic, by bisection.
    """
    levels = tracer.levels
    if levels[-1].stable or tracer.is_elliptic(levels[-1].displacement):
        return
    sound = [level.stable or tracer.is_elliptic(level.displacement) for level in levels]
    first = sound.index(False)
    if first == 0:
        raise _lost_at(tracer, levels[0].s, 0.0)
    low, high = levels[first - 1].s, levels[first].s
    while high - low > _BRACKET * high:
        middle = 0.5 * (low + high)
        if tracer.is_sound(middle):
            low = middle
        else:
            high = middle
    raise _lost_at(tracer, high, low)


def _lost_at(tracer: _Tracer, s: float, reached: float) -> _StoppedError:
    return _StoppedError(
        Cause.LOSS_OF_ELLIPTICITY.value, Cause.LOSS_OF_ELLIPTICITY, s, reached, tracer.failure
    )


def _settle(tracer: _Tracer, end: float) -> None:
    """Leave a path that cannot be followed for a stable one, by descent of the potential.

    Beyond the loss of ellipticity a soft shear modulus leaves many equilibria. The stable ones
    have bands as wide as a cell; they are equilibria all the same, and tell a search more than a
    failure would. Nothing is claimed of the dense output between them.
    """
    for s in np.linspace(tracer.levels[-1].s, end, _SETTLED + 1)[1:]:
        tracer.solve(s, tracer.levels[-1].displacement, follow=False)
        tracer.forget()


class _StoppedError(ArithmeticError):
    """A path ends at s, for a cause; equilibrium was reached up to another s."""

    def __init__(
        self, reason: str, cause: Cause, s: float, reached: float, error: NewtonError
    ) -> None:
        super().__init__(reason)
        self.reason, self.cause, self.s, self.reached, self.error = reason, cause, s, reached, error


def _climb(tracer: _Tracer, end: float, tolerance: float, *, leap: bool) -> float:
    """Add levels up to s = `end`; returns the largest estimated error (mm) of the dense output."""
    smallest = _SMALLEST_STEP * end
    step = _first_step(tracer.membrane, tracer.stiffness)
    while (s := tracer.levels[-1].s) < end * (1 - 1e-12):
        # equal steps to the end rather than a short last one
        step = end - s if s + 1.01 * step >= end else min(step, 0.5 * (end - s) + 0.01 * step)
        step = max(step, _least_step(tracer, end))
        if leap:
            share = _leap(tracer, step, smallest)
            if tracer.levels[-1].s - s < smallest:
                raise _given_up(tracer, tracer.failure, tracer.levels[-1].s + smallest)
        else:
            share = _advance(tracer, step, end)
        if tracer.elliptic:
            _check_ellipticity(tracer)
        if len(tracer.levels) <= _MANY:
            _refine(tracer, tolerance, _CLOSEST * end)
        error = tracer.error(len(tracer.levels) - 2, _AIM * tolerance)
        wanted = (_AIM * tolerance / max(error, 1e-16)) ** (1 / (2 * STENCIL))
        made = tracer.levels[-1].s - s
        gap = max(0.25 * made, tracer.levels[-1].s - tracer.levels[-2].s)
        # short of the step that was asked for, grow with care
        step = gap * min(2.5 if share == 1.0 else 1.3, max(0.4, wanted))
        tracer.forget()
    intervals = range(len(tracer.levels) - 1)
    return max((tracer.error(after, _AIM * tolerance) for after in intervals), default=0.0)


def _least_step(tracer: _Tracer, end: float) -> float:
    """The length of steps that a path with many levels may not go below."""
    made = len(tracer.levels)
    return (end - tracer.levels[-1].s) / max(1, _MOST - made) if made >= _MANY else 0.0


def _advance(tracer: _Tracer, step: float, end: float) -> float:
    """Add a level about `step` ahead; returns the share of the step that was made.

    Wrinkled cloth has no stiffness across its folds: what a prediction along the path does not
    find there, descent of the potential does. Not where the law has lost ellipticity: it would leap
    into bands of shear, past the point where the path turns unstable. Where steps in pressure fail,
    the branch is followed by its volume until pressure can be stepped again, or its greatest
    pressure is passed. Cloth that is too loose for that is looked for where it is taut. That is a
    descent as well, so where the law is not elliptic the path ends there.

    Raises
    ------
    _StoppedError
    """
    below = tracer.levels[-1]
    last, descend = below.s, tracer.descends and below.stable and below.wrinkled > 0
    if tracer.elliptic and descend:
        descend = tracer.is_elliptic(below.displacement)
    attempts = [(1.0, True), *([(1.0, False)] * descend), *((share, True) for share in _SHORTER)]
    # where the last steps failed the next are likely to
    for share, follow in attempts[-1:] if tracer.by_volume else attempts:
        s = last + share * step
        start = tracer.predict(s)
        try:
            tracer.solve(s, start if follow else tracer.lower(start, s), follow=follow)
            tracer.by_volume = False
            return share
        except NewtonError as error:
            failure = error
            tracer.descends &= follow
    tracer.by_volume = True
    try:
        _go_by_volume(tracer, last + min(_SHORTER) * step, failure)
    except _StoppedError as stopped:
        if stopped.cause is not Cause.NOT_CONVERGED:
            raise
        if not (below.wrinkled and (_creep(tracer, step) or _draw_taut(tracer, end))):
            raise
    return (tracer.levels[-1].s - last) / step


def _creep(tracer: _Tracer, step: float) -> bool:
    """Add a level a part of `step` ahead by descent from the last shape; False: there is none."""
    last = tracer.levels[-1]
    for share in _SHORTER_STILL:
        try:
            s = last.s + share * step
            tracer.solve(s, last.displacement, follow=False, patient=True)
            return True
        except NewtonError:
            continue
    return False


def _draw_taut(tracer: _Tracer, end: float) -> bool:
    """Add a level at a pressure that draws loose cloth taut; False where none is found.

    Raises
    ------
    _StoppedError
        Where that is past the loss of ellipticity.
    """
    low = tracer.levels[-1].s
    for factor in _TAUTER:
        s = min(low * float(np.cbrt(factor)), end)
        try:
            guess = flat_guess(tracer.membrane, s**3, tracer.stiffness)
            tracer.solve(s, guess, follow=False)
            return True
        except _BandedError as banded:
            raise _lost_at(tracer, s, low) from banded
        except NewtonError:
            if s == end:
                break
    return False


def _go_by_volume(tracer: _Tracer, beyond: float, failure: NewtonError) -> None:
    """Add a level beyond an s, reached by growing volumes.

    Raises
    ------
    _StoppedError
        At the limit pressure, where the law loses ellipticity, or where this does not do either.
    """
    last = tracer.levels[-1]
    volume = tracer.membrane.volume(last.displacement)
    points = [Point(last.displacement, last.s**3, volume, last.stable, True, 0)]
    growth = _first_growth(tracer, volume)
    for _ in range(_BY_VOLUME):
        here = points[-1]
        wanted = here.volume + growth * abs(here.volume)
        try:
            point = _at_volume(tracer, points, wanted)
        except NewtonError as error:
            tracer.work, tracer.wasted = tracer.work + error.work, tracer.wasted + error.work
            growth *= 0.5
            if growth < _LEAST_GROWTH:
                break
            continue
        tracer.work += point.work
        points.append(point)
        if tracer.elliptic and not point.stable and not tracer.is_elliptic(point.displacement):
            low, high = _turn(tracer, here, point)
            # one that turned unstable before has passed its limit pressure, if pressure falls next
            if low.stable or not here.stable:
                reached = np.cbrt(low.pressure)
                # what lies behind may be found on a branch of lower pressures
                beyond = max(np.cbrt(high.pressure), reached * (1.0 + _BRACKET))
                raise _lost_at(tracer, beyond, reached)
        # falling pressure, or one that has been higher still
        if point.pressure < here.pressure or not point.rises:
            raise _limit(tracer, points, failure)
        s = np.cbrt(point.pressure)
        if s > beyond:
            try:
                tracer.solve(s, point.displacement, follow=True, rough=True)
                return
            except NewtonError as error:
                failure = error
        growth = min(1.5 * growth, _MOST_GROWTH)
    if tracer.elliptic and not tracer.is_elliptic(points[-1].displacement):
        reached = float(np.cbrt(points[-1].pressure))
        raise _lost_at(tracer, reached * (1.0 + _BRACKET), reached)
    raise _given_up(tracer, failure, last.s)


def _first_growth(tracer: _Tracer, volume: float) -> float:
    """Share of the volume (mm³) of the last level by which a first step goes beyond it.

    By as much as the last step in pressure did: what that closed in on, a longer one may leap over,
    to shapes that no path leads to.
    """
    if len(tracer.levels) < 2:
        return _GROWTH
    grown = volume - tracer.membrane.volume(tracer.levels[-2].displacement)
    return min(_GROWTH, max(_LEAST_GROWTH, grown / abs(volume)))


def _at_volume(tracer: _Tracer, points: list[Point], volume: float) -> Point:
    """The point of a branch at a volume above that of the last of `points`.

    Where shapes are stable, volume grows with pressure: dV/dp = f·K⁻¹f > 0 for a tangent K that is
    positive definite, f = ∂V/∂x. So a stable shape of more volume under less pressure is one of
    another branch, or lies behind a limit and a least pressure too: shorter steps tell. So do they
    where the law is not elliptic and a shape is not the one that the last two lead to: between them
    bands of shear may have come.

    Raises
    ------
    NewtonError
    """
    here = points[-1]
    start = _ahead(points, volume)
    point = at_volume(tracer.membrane, tracer.stiffness, start, here.pressure, volume)
    departs = tracer.elliptic and len(points) > 1 and _departs(start, here, point)
    banded = departs and not tracer.is_elliptic(here.displacement)
    if banded or (point.stable and point.pressure < here.pressure):
        raise NewtonError("the shape is one of another branch", 0, 0.0, point.work)
    return point


def _departs(start: Floats, here: Point, point: Point) -> bool:
    """Whether a shape is `_ROUGH` of its change away from where the branch was heading."""
    change = np.abs(point.displacement - here.displacement).max()
    return bool(np.abs(point.displacement - start).max() > _ROUGH * change)


def _turn(tracer: _Tracer, low: Point, high: Point) -> tuple[Point, Point]:
    """Bisect by volume where a branch becomes both unstable and not elliptic.

    Steps that lead to no shape are halved: the upper shape may be one of another branch.
    """
    share = 0.5
    while high.volume - low.volume > _BRACKET * abs(high.volume) and share > _LEAST_SHARE:
        volume = low.volume + share * (high.volume - low.volume)
        start = low.displacement + share * (high.displacement - low.displacement)
        pressure = low.pressure + share * (high.pressure - low.pressure)
        try:
            middle = at_volume(tracer.membrane, tracer.stiffness, start, pressure, volume)
        except NewtonError as error:
            tracer.work += error.work
            share *= 0.5
            continue
        tracer.work += middle.work
        share = 0.5
        if middle.stable or tracer.is_elliptic(middle.displacement):
            low = middle
        else:
            high = middle
    return low, high


def _ahead(points: list[Point], volume: float) -> Floats:
    """The shape at a volume, on the line through the last two points."""
    here = points[-1]
    if len(points) < 2:
        return here.displacement
    before = points[-2]
    share = (volume - here.volume) / (here.volume - before.volume)
    return here.displacement + share * (here.displacement - before.displacement)


def _limit(tracer: _Tracer, points: list[Point], failure: NewtonError) -> _StoppedError:
    """What ends a path at whose last point more volume takes less pressure."""
    best, work = highest_pressure(tracer.membrane, tracer.stiffness, points)
    tracer.work += work
    s = np.cbrt(best.pressure)
    return _StoppedError(
        Cause.LIMIT_PRESSURE.value, Cause.LIMIT_PRESSURE, s * (1.0 + _BRACKET), s, failure
    )


def _given_up(tracer: _Tracer, error: NewtonError, s: float) -> _StoppedError:
    return _StoppedError(error.reason, error.cause, s, tracer.levels[-1].s, error)


def _leap(tracer: _Tracer, step: float, smallest: float) -> float:
    """Add a level about `step` ahead; returns the share of the step that was made.

    Where the tangent is singular at a point of an otherwise smooth path (soft shear: the law has
    lost ellipticity, see docs/verification.md), another step avoids it or goes on behind it, even
    beyond the end of the range. Where none does, steps close in on the point.

    Raises
    ------
    _StoppedError
    """
    last = tracer.levels[-1].s
    closing = list(step * 0.4 ** np.arange(1, 20))
    detours = [share * step for share in _SHORTER] + [share * last for share in _LEAPS]
    attempts = [step, *closing] if tracer.closing_in else [step, *detours, *closing]
    for attempt, length in enumerate(attempts):
        tracer.closing_in |= attempt > len(detours)
        try:
            tracer.solve(last + length, tracer.predict(last + length), follow=True)
            return length / step
        except NewtonError as error:
            if length < smallest or tracer.wasted > _PATIENCE:
                raise _given_up(tracer, error, last + length) from error
    raise AssertionError("the last attempt is shorter than the smallest step")


def _refine(tracer: _Tracer, tolerance: float, closest: float) -> None:
    """Put levels in between until the dense output is within tolerance.

    The newest level changes the stencils of the intervals below it, so these are looked at too.
    Beside a singular tangent there may be no smooth level, and an error remains.
    """
    singular = set()
    after = len(tracer.levels) - 2
    lowest = max(0, after - STENCIL + 1)
    while after >= lowest:
        low, high = tracer.levels[after].s, tracer.levels[after + 1].s
        error = tracer.error(after, _AIM * tolerance)
        done = error <= _SURE * tolerance or high - low < closest or low in singular
        if not done and tracer.wasted <= _PATIENCE:
            try:
                _put_between(tracer, tracer.levels[after], tracer.levels[after + 1])
                after = min(after + STENCIL, len(tracer.levels) - 1)
            except NewtonError:
                singular.add(low)
        after -= 1


def _put_between(tracer: _Tracer, low: _Level, high: _Level) -> None:
    """Add a level halfway between two.

    In wrinkled cloth the dense output may be too far off for a search along the path: from the
    shape at the higher pressure, which has fewer wrinkles, descent of the potential finds the level
    as it finds the next one in `_advance`; with patience, as the lowest one.

    Raises
    ------
    NewtonError
    """
    s = 0.5 * (low.s + high.s)
    try:
        tracer.solve(s, tracer.interpolate(s), follow=True)
    except NewtonError:
        ends = (low, high)
        wrinkled = any(end.wrinkled for end in ends) and all(end.stable for end in ends)
        if not (wrinkled and all(tracer.is_elliptic(end.displacement) for end in ends)):
            raise
        tracer.solve(s, high.displacement, follow=False, patient=True)
        _check_between(tracer, low, high)


def _check_between(tracer: _Tracer, low: _Level, high: _Level) -> None:
    """Take a level back that lies on another branch: the volumes of one grow with pressure.

    Raises
    ------
    NewtonError
    """
    at = tracer.levels.index(low) + 1
    shapes = [level.displacement for level in (low, tracer.levels[at], high)]
    below, between, above = (tracer.membrane.volume(shape) for shape in shapes)
    if not (tracer.levels[at].stable and below < between < above):
        del tracer.levels[at]
        raise NewtonError("the shape is one of another branch", 0, 0.0, 0)


def _solve_error(
    tracer: _Tracer, stopped: _StoppedError, parameters: Mapping[str, float]
) -> SolveError:
    return SolveError(
        f"no equilibrium: {stopped.reason}",
        cause=stopped.cause,
        pressure=float(stopped.s**3),
        reached=float(stopped.reached**3),
        iteration=stopped.error.iteration,
        residual_norm=stopped.error.residual_norm,
        parameters=parameters,
    )


def _path(tracer: _Tracer, worst: float) -> Path:
    levels = tracer.levels
    pairs = [level.sensitivity for level in levels if level.sensitivity is not None]
    return Path(
        nodes=tracer.membrane.mesh.nodes,
        cells=tracer.membrane.mesh.cells,
        pressure=np.array([level.s for level in levels]) ** 3,
        displacement=np.array([level.displacement for level in levels]),
        slope=np.array([level.slope for level in levels]),
        sensitivity=np.array([value for value, _ in pairs]) if pairs else None,
        sensitivity_slope=np.array([slope for _, slope in pairs]) if pairs else None,
        mirrored=tracer.mirrored,
        factorisations=tracer.work,
        error_estimate=worst,
        wrinkled=np.array([level.wrinkled for level in levels]),
        stable=np.array([level.stable for level in levels]),
    )


def _first_step(membrane: Membrane, stiffness: Floats) -> float:
    """A step in s that is small against (E t/a)^(1/3), the scale on which shapes change."""
    scale = 0.5 * (stiffness[0] + stiffness[1]) * membrane.thickness / membrane.radius
    return 0.08 * float(np.cbrt(scale))
