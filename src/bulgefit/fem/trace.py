"""Follow the membrane from light pressure up, in few levels, to a tolerance of the dense output."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause, InputError, SolveError
from bulgefit.fem.elasticity import STIFFNESS_NAMES
from bulgefit.fem.equilibrium import NewtonError, flat_guess, solve
from bulgefit.fem.hermite import STENCIL
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.path import Path
from bulgefit.fem.tracing.advance import TAUTER, advance, leap
from bulgefit.fem.tracing.between import AIM, fill
from bulgefit.fem.tracing.ends import StoppedError, given_up, lost_at, solve_error
from bulgefit.fem.tracing.levels import BandedError, Tracer
from bulgefit.fem.tracing.settle import settle
from bulgefit.fem.tracing.sound import check_ellipticity

__all__ = ["TOLERANCE", "Traced", "trace", "traced"]

Floats = NDArray[np.float64]

#: Default error of the dense output, mm for a radius of 100 mm.
TOLERANCE = 1e-3
#: Steps in s are no shorter than this share of the whole range.
_SMALLEST_STEP = 1e-4
#: Levels closer than this share of the range get none in between.
_CLOSEST = 0.02
#: G12 under this share of D11 + D22 is soft shear: beyond ellipticity steps leap over the singular
#: points of the path.
_SOFT_SHEAR = 0.05
#: A smooth path takes five to fifteen levels (docs/performance.md). One that takes more has kinks,
#: where cloth that lay loosely draws taut, and where halving a step gains little: after so many
#: levels steps are as long as it takes to end within the greater number, and no more are put in
#: between than that; nor any after so many factorisations, three times what smooth ones may take.
#: The path's error estimate says what that leaves.
_MANY, _MOST = 15, 30
_SMOOTH = 6 * _MANY
#: The lowest pressure over the one that is tried where cloth is past its loss of ellipticity there.
_LOWER = 100.0
#: The pressure that is tried where nothing balances the lowest one, which may lie beyond the limit
#: pressure of soft cloth, over E t/a, at about which cloth strains by one.
_LIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Traced:
    """How far a path came.

    Attributes
    ----------
    path : Path or None
        Of the levels that were balanced; None where there is none.
    error : SolveError or None
        Why it ends before the upper pressure.
    last : (n, 3) array or None, mm
        The shape at the pressure that `error` names as reached, where it is known.
    """

    path: Path | None
    error: SolveError | None = None
    last: Floats | None = None

    def whole(self) -> Path:
        """The path; raises its error where it ends early."""
        if self.error is not None:
            raise self.error
        assert self.path is not None
        return self.path


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
        The path of a membrane that lies flat without pressure also covers 0 to low, by symmetry.
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
        Pressures not 0 < low <= high, or a tolerance that is not above zero.
    SolveError
        No equilibrium, with its cause and the pressure that was reached.
    """
    return traced(
        membrane, stiffness, pressure, tolerance=tolerance, sensitivities=sensitivities,
        parameters=parameters, beyond_ellipticity=beyond_ellipticity,
    ).whole()  # fmt: skip


def traced(
    membrane: Membrane,
    stiffness: Floats,
    pressure: tuple[float, float] = (1e-4, 0.3),
    *,
    tolerance: float = TOLERANCE,
    sensitivities: bool = False,
    parameters: Mapping[str, float] | None = None,
    beyond_ellipticity: bool = False,
    begun: Sequence[tuple[float, Floats]] = (),
) -> Traced:
    """As `trace`, with what there is of a path that ends early.

    Parameters
    ----------
    begun : sequence of (MPa, (n, 3) array), optional
        Levels to go on from, at which the membrane balances.

    Raises
    ------
    InputError
        Pressures not 0 < low <= high, or a tolerance that is not above zero.
    """
    low, high = float(pressure[0]), float(pressure[1])
    if not (0.0 < low <= high < np.inf):
        raise InputError(
            f"pressures must satisfy 0 < lowest <= highest, got {10 * low:g} to {10 * high:g} bar"
        )
    if not tolerance > 0.0:
        raise InputError(f"tolerance must be above 0 mm, got {tolerance:g}")
    shown = dict(parameters or zip(STIFFNESS_NAMES, stiffness.tolist(), strict=True))
    if (refused := _refused(stiffness, low, shown)) is not None:
        return Traced(None, refused)
    asked = _Asked(membrane, stiffness, low, high, tolerance, sensitivities, shown)
    if beyond_ellipticity and stiffness[3] < _SOFT_SHEAR * (stiffness[0] + stiffness[1]):
        return _leapt(asked, begun)
    return _followed(asked, begun, elliptic=not beyond_ellipticity)


@dataclass(frozen=True, eq=False)
class _Asked:
    """What is asked of a path: see `traced`."""

    membrane: Membrane
    stiffness: Floats
    low: float
    high: float
    tolerance: float
    sensitivities: bool
    shown: Mapping[str, float]

    def tracer(self, *, elliptic: bool, work: int = 0) -> Tracer:
        """A path without levels, on which so many factorisations were spent."""
        allowed = self.tolerance * self.membrane.radius / 100.0
        tracer = Tracer(
            self.membrane, self.stiffness, allowed, self.sensitivities, elliptic=elliptic
        )
        tracer.work = work
        return tracer

    def upwards(self, tracer: Tracer, begun: Sequence[tuple[float, Floats]], leaps: bool) -> Path:
        """All levels, from those that are begun."""
        if not _go_on(tracer, begun):
            _start(tracer, np.cbrt(self.low), np.cbrt(self.high))
        return _path(tracer, _climb(tracer, np.cbrt(self.high), leaps=leaps))

    def unbalanced(self, tracer: Tracer, error: NewtonError) -> Traced:
        """A path that ends where an iteration does."""
        reached = tracer.levels[-1].s if tracer.levels else 0.0
        at = max(reached, np.cbrt(self.low))
        stopped = StoppedError(error.reason, error.cause, at, reached, error)
        return _ended(tracer, stopped, self.shown)


def _followed(asked: _Asked, begun: Sequence[tuple[float, Floats]], *, elliptic: bool) -> Traced:
    """By steps that are predicted; where there are no more the path ends."""
    tracer = asked.tracer(elliptic=elliptic)
    try:
        return Traced(asked.upwards(tracer, begun, leaps=False))
    except StoppedError as stopped:
        return _ended(tracer, stopped, asked.shown)
    except NewtonError as error:
        return asked.unbalanced(tracer, error)


def _leapt(asked: _Asked, begun: Sequence[tuple[float, Floats]]) -> Traced:
    """Past the singular points of soft shear; where no leap leads on, by descent."""
    within, spent = None, 0
    if not begun and asked.membrane.fabric.lies_loosely:
        # descents find what no leap does, and are sound as far as the law is elliptic
        within = _followed(asked, begun, elliptic=True)
        if within.error is None:
            return within
        begun, spent = _reached(within), _work(within)
    tracer = asked.tracer(elliptic=False, work=spent)
    try:
        return Traced(asked.upwards(tracer, begun, leaps=True))
    except NewtonError as error:
        return asked.unbalanced(tracer, error)
    except StoppedError:
        within = within or _followed(asked, begun, elliptic=True)
    return _settled(asked, tracer, within)


def _settled(asked: _Asked, leapt: Tracer, within: Traced) -> Traced:
    """Where leaps stop: the path as far as the law is elliptic, and from there on by descent."""
    if within.error is None or within.error.cause is Cause.LIMIT_PRESSURE:
        return within
    tracer = asked.tracer(elliptic=False, work=leapt.work + _work(within))
    if _go_on(tracer, _reached(within)):
        last = tracer.levels[-1]
        s, shape = last.s, last.displacement
        if within.last is not None:
            s, shape = np.cbrt(within.error.reached), within.last
    elif not leapt.levels:
        return within
    else:
        tracer = leapt
        s, shape = tracer.levels[-1].s, tracer.levels[-1].displacement
    try:
        settle(tracer, s, shape, np.cbrt(asked.high))
    except StoppedError as stopped:
        return _ended(tracer, stopped, asked.shown)
    return Traced(_path(tracer, tracer.errors(0.0)))


def _ended(tracer: Tracer, stopped: StoppedError, shown: Mapping[str, float]) -> Traced:
    """The levels that were found, and why there are no more."""
    path = _path(tracer, _unknown(tracer)) if tracer.levels else None
    return Traced(path, solve_error(stopped, shown), stopped.shape)


def _refused(stiffness: Floats, low: float, shown: Mapping[str, float]) -> SolveError | None:
    """What is said of a stiffness that no cloth has."""
    d11, d22, d12, d33 = stiffness
    if min(d11, d22, d33) > 0.0 and d11 * d22 > d12**2 and np.isfinite(stiffness).all():
        return None
    return SolveError(
        f"no equilibrium: {Cause.INADMISSIBLE.value}", cause=Cause.INADMISSIBLE, pressure=low,
        reached=0.0, iteration=0, residual_norm=0.0, parameters=shown,
    )  # fmt: skip


def _reached(found: Traced) -> list[tuple[float, Floats]]:
    """Levels (MPa, (n, 3) array) of a path that ends, up to the pressure that was reached."""
    if found.path is None or found.error is None:
        return []
    levels = zip(found.path.pressure.tolist(), found.path.displacement, strict=True)
    return [(p, shape) for p, shape in levels if p <= found.error.reached]


def _work(found: Traced) -> int:
    """Factorisations spent."""
    return 0 if found.path is None else found.path.factorisations


def _go_on(tracer: Tracer, begun: Sequence[tuple[float, Floats]]) -> bool:
    """Take up levels; False, and none, where there are none or one does not balance."""
    try:
        for p, shape in begun:
            tracer.solve(float(np.cbrt(p)), shape, follow=True, rough=True)
            tracer.judge()
    except NewtonError as error:
        tracer.work += error.work
        tracer.levels.clear()
    return bool(tracer.levels)


def _start(tracer: Tracer, low: float, high: float) -> None:
    """Balance the lowest level, or one below it.

    Uneven or slack cloth lies loosely under a light pressure. Where patience does not find its
    shape, the shape at a pressure that draws it taut leads down to it. Soft cloth may have none
    there, but at a pressure that is light for it.

    Raises
    ------
    StoppedError
        Where ellipticity is lost from the start.
    NewtonError
    """
    try:
        guess = flat_guess(tracer.membrane, low**3, tracer.stiffness)
        tracer.solve(low, guess, follow=False, patient=True)
    except BandedError as banded:
        _start_lower(tracer, low, banded)
    except NewtonError:
        if not (_start_taut(tracer, low, high) or _start_light(tracer, low)):
            raise


def _start_taut(tracer: Tracer, low: float, high: float) -> bool:
    """Balance the lowest level from a pressure that draws it taut; False where none leads to it.

    One that still has the bands of shear that were come to where it is taut is none: they may lie
    in many ways there. Whether patience ends in such bands or nowhere may hang by last digits.

    Raises
    ------
    StoppedError
        Where all that is found has bands.
    """
    membrane, stiffness = tracer.membrane, tracer.stiffness
    lost = False
    for factor in TAUTER:
        pressures = low**3 * factor ** np.linspace(1.0, 0.0, 4)
        if pressures[0] > high**3:
            break
        shape, banded = flat_guess(membrane, pressures[0], stiffness), False
        try:
            for p in pressures[:-1]:
                balance = solve(membrane, shape, p, stiffness, patient=True)
                tracer.work += balance.factorisations
                shape = balance.displacement
                leapt = tracer.elliptic and (banded or balance.leapt)
                banded = leapt and not tracer.is_elliptic(shape)
            tracer.solve(low, shape, follow=False)
        except BandedError:
            lost = True
        except NewtonError as again:
            tracer.work += again.work
            lost |= banded
        else:
            if not banded or tracer.is_elliptic(tracer.levels[-1].displacement):
                return True
            tracer.levels.clear()
            lost = True
    if lost:
        raise lost_at(tracer, low, 0.0)
    return False


def _start_light(tracer: Tracer, low: float) -> bool:
    """Balance a level at a pressure that strains no cloth by much.

    False where that is no lower than the lowest one, or has no shape either.
    """
    p = _LIGHT * _scale(tracer.membrane, tracer.stiffness)
    if p >= low**3:
        return False
    try:
        guess = flat_guess(tracer.membrane, p, tracer.stiffness)
        tracer.solve(float(np.cbrt(p)), guess, follow=False, patient=True)
    except NewtonError:
        return False
    return True


def _start_lower(tracer: Tracer, low: float, banded: BandedError) -> None:
    """Balance a level below the lowest, from which a path may lead up without a leap.

    Raises
    ------
    StoppedError
        Where ellipticity is lost from the start.
    """
    p = low**3 / _LOWER
    guess = flat_guess(tracer.membrane, p, tracer.stiffness)
    try:
        tracer.solve(float(np.cbrt(p)), guess, follow=False, patient=True)
    except NewtonError:
        raise lost_at(tracer, low, 0.0) from banded


def _climb(tracer: Tracer, end: float, *, leaps: bool) -> Floats:
    """Add levels up to s = `end`; returns the errors (mm) of the dense output between them."""
    smallest, begun, aim = _SMALLEST_STEP * end, tracer.work, AIM * tracer.tolerance
    step = _first_step(tracer.membrane, tracer.stiffness)
    top = end * (1 - 1e-12)
    while (s := tracer.levels[-1].s) < top:
        # equal steps to the end rather than a short last one
        step = end - s if s + 1.01 * step >= end else min(step, 0.5 * (end - s) + 0.01 * step)
        step = max(step, _least_step(tracer, end))
        if leaps:
            share = leap(tracer, step, smallest)
            if tracer.levels[-1].s - s < smallest:
                raise given_up(tracer, tracer.failure, tracer.levels[-1].s + smallest)
        else:
            share = advance(tracer, step, end)
        if tracer.elliptic:
            check_ellipticity(tracer, ended=False)
        if len(tracer.levels) <= _MANY:
            fill(tracer, _CLOSEST * end, (_MANY, _MOST), begun + _SMOOTH)
        if tracer.elliptic:  # what was put between others may not be sound either
            check_ellipticity(tracer, ended=tracer.levels[-1].s >= top)
        error = tracer.error(len(tracer.levels) - 2, aim)
        wanted = (aim / max(error, 1e-16)) ** (1 / (2 * STENCIL))
        made = tracer.levels[-1].s - s
        gap = max(0.25 * made, tracer.levels[-1].s - tracer.levels[-2].s)
        # short of the step that was asked for, grow with care; over kinks a shorter one gains
        # little, and takes as many looks at the way
        least = 1.0 if tracer.in_valley else 0.4
        step = gap * min(2.5 if share == 1.0 else 1.3, max(least, wanted))
        tracer.forget()
    return tracer.errors(aim)


def _least_step(tracer: Tracer, end: float) -> float:
    """The length of steps that a path with many levels may not go below."""
    made = len(tracer.levels)
    return (end - tracer.levels[-1].s) / max(1, _MOST - made) if made >= _MANY else 0.0


def _first_step(membrane: Membrane, stiffness: Floats) -> float:
    """A step in s that is small against that of the scale on which shapes change."""
    return 0.08 * float(np.cbrt(_scale(membrane, stiffness)))


def _scale(membrane: Membrane, stiffness: Floats) -> float:
    """E t/a, MPa: the pressure at about which cloth strains by one."""
    return float(0.5 * (stiffness[0] + stiffness[1])) * membrane.thickness / membrane.radius


def _unknown(tracer: Tracer) -> Floats:
    """What is told of errors between levels that were not filled up."""
    return np.full(max(0, len(tracer.levels) - 1), np.inf)


def _path(tracer: Tracer, errors: Floats) -> Path:
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
        errors=errors,
        wrinkled=np.array([level.wrinkled for level in levels]),
        stable=np.array([level.stable for level in levels]),
    )
