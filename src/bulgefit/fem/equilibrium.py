"""Newton's method for the shape that balances one pressure."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import Cause
from bulgefit.fem.linear import Factor, NotPositiveDefiniteError
from bulgefit.fem.membrane import Membrane, State
from bulgefit.fem.relaxation import BALANCED

__all__ = ["Equilibrium", "NewtonError", "RunAwayError", "flat_guess", "solve"]

Floats = NDArray[np.float64]

#: Corrections (mm, for a radius of 100 mm) below which a shape counts as balanced.
CORRECTION = 1e-9
#: Corrections (mm, for a radius of 100 mm) above which the factor is renewed.
RENEWED_ABOVE = 1e-6
#: Corrections by one factor that cost less than another factorisation.
CORRECTIONS = 3
#: Iterations from the prediction of a path, from a rough guess, and of a patient search. Cloth that
#: lies loosely has all but no stiffness: each step from afar lowers its potential, but the last may
#: be late. Of 858 random fabrics under 0.001 bar half take 6 steps, one in a hundred 130, the
#: slowest 180; on a finer mesh 338.
FROM_NEAR, FROM_AFAR, PATIENT = 12, 60, 400
#: Corrections by a factor that has served before are made where they are shorter than this share
#: of the step before: they cost a tenth of a factorisation.
AGAIN_BELOW = 0.25
#: Radii beyond which a shape runs away, as descent lets it above a limit pressure, where the
#: potential has no bottom: a cap as high has a hundred times the area of its disc.
RUN_AWAY = 10.0
#: How many times as far as a step by a shifted tangent the potential is looked at, at a time, and
#: the share of the radius up to which: at a rise of a tenth the next shape has little of the last.
_LONGER, _FAR = 10.0, 0.1
#: Newton's method converges quadratically: a step whose successor, by this rule and this factor of
#: safety, is below `CORRECTION` is the last. The second is of curves, whose slopes have kinks: the
#: rule may be another beyond one.
SAFETY, SAFER = 10.0, 100.0


class NewtonError(ArithmeticError):
    """Newton's method stopped short of equilibrium."""

    def __init__(
        self,
        reason: str,
        iteration: int,
        residual_norm: float,
        work: int,
        cause: Cause = Cause.NOT_CONVERGED,
    ) -> None:
        super().__init__(reason)
        self.cause = cause
        self.reason = reason
        self.iteration = iteration
        self.residual_norm = residual_norm
        self.work = work


class RunAwayError(NewtonError):
    """Descent goes on without end, as above a limit pressure: nothing stable balances there."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A balanced shape and the factor of its tangent.

    Attributes
    ----------
    pressure : float, MPa
    displacement : (n, 3) array, mm
    factor : Factor
        Of the tangent at the shape before the last full step, a step so short that the next
        correction was below `RENEWED_ABOVE`; or of a farther one that the search made do with; or
        of the tangent at this very shape.
    exact : bool
        The factor is that of the tangent at this very shape.
    slope : (n, 3) array, mm/MPa^(1/3)
        ∂u/∂s, s = p^(1/3), as far as a search along a path found it by the way, else zero.
    slope_change : float
        What its last correction was, relative to it; infinite where none was made.
    factorisations : int
        Spent on finding it.
    wrinkled : int
        Gauss points in tension-field relaxation.
    stable : bool
        False where the tangent is not positive definite: the branch goes on, but the fabric
        could leave it (a soft shear modulus lets the law localise).
    leapt : bool
        A tangent on the way was not positive definite: of several stable shapes, descent has taken
        one, and another start might have led to another.
    """

    pressure: float
    displacement: Floats
    factor: Factor
    exact: bool
    slope: Floats
    slope_change: float
    factorisations: int
    wrinkled: int
    stable: bool
    leapt: bool


def flat_guess(membrane: Membrane, pressure: float, stiffness: Floats) -> Floats:
    """Displacement (n, 3) mm that a flat disc is close to at a light pressure.

    Hencky's problem: w = W0 (p a/(E t))^(1/3) a (1 - r²/a²) with W0 = 0.65 (nu about 0.3) and
    the mean of the moduli along warp and fill; higher for a slack fabric, and no higher than
    p a²/4T under a pretension T.
    """
    modulus = 0.5 * (stiffness[0] + stiffness[1]) * (1 - 0.3**2)
    a = membrane.radius
    height = 0.65 * a * np.cbrt(pressure * a / (modulus * membrane.thickness))
    slack = 0.5 * sum(membrane.fabric.slack)
    if slack > 0.0:
        # a paraboloid of this height is longer than the disc by the slack and the stretch
        height = np.sqrt(height**2 + 1.5 * slack * a**2)
    elif slack < 0.0:
        tension = -slack * modulus * membrane.thickness
        height = min(height, pressure * a**2 / (4.0 * tension))
    guess = np.zeros_like(membrane.reference)
    guess[:, 2] = height * (1 - (membrane.mesh.nodes**2).sum(axis=1) / a**2)
    # cloth that hangs below its clamp turns up first
    guess[:, 2] += 2.0 * np.maximum(-membrane.reference[:, 2], 0.0)
    guess[membrane.fixed] = 0.0
    return guess


def solve(
    membrane: Membrane,
    start: Floats,
    pressure: float,
    stiffness: Floats,
    *,
    thrifty: bool = False,
    follow: bool = False,
    exact: bool = False,
    patient: bool = False,
    convex: bool = False,
    within: float = np.inf,
) -> Equilibrium:
    """Balance `pressure` from the displacement `start`.

    Newton steps on the exact tangent while corrections are large, each followed by one more
    correction with the same factor; once they are small the last factor serves for the rest. A
    step counts as progress where the next correction by the same
    factor is smaller (the natural monotonicity test of Deuflhard, 2004, eq. 3.31), or where it
    lowers the potential of a stable shape; else it is halved.

    From afar, a tangent that is not positive definite gets its diagonal raised until it is, so
    the steps descend to a stable shape. Close to a path (`follow`), it is factorised as it is, so
    the path is followed through unstable stretches. Either way nothing artificial is left in the
    shape that is returned.

    Parameters
    ----------
    start : (n, 3) array, mm
    pressure : float, MPa
    stiffness : (4,) array, MPa
    thrifty : bool
        Return the factor of a shape that is farther off, if it serves to balance this one: half
        the factorisations, for those who can do with such a factor.
    follow : bool
        The start is a prediction along a path.
    exact : bool
        Once the shape is balanced, factorise its own tangent: derivatives ask for it. Near a
        singular tangent they are off by a thousandth with the factor of a shape 1e-5 mm away.
    patient : bool
        From afar, allow the steps that cloth may take which lies loosely.
    convex : bool
        From afar, but only as far as tangents are positive definite: into no other valley.
    within : float, mm
        What the first correction of a prediction may be.

    Raises
    ------
    NewtonError
    """
    watch = thrifty and follow and not exact
    search = _Search(
        membrane, pressure, stiffness, follow, watch=watch, convex=convex, within=within
    )
    # copies that are extrapolated from level to level would drift away, by rounding at first
    displacement = membrane.tied(start)
    unit = membrane.radius / 100.0
    state = search.look(displacement, tangent=True)
    if not np.isfinite(state.potential):
        raise NewtonError("the starting shape has a collapsed cell", 0, np.inf, 0, Cause.COLLAPSED)
    most = FROM_NEAR if follow else PATIENT if patient else FROM_AFAR
    for iteration in range(1, most + 1):
        if state.tangent is None:
            state = search.look(displacement, tangent=True)
        factor, stable = search.factor(displacement, state, iteration)
        if search.shift == 0.0 and search.is_noise(state):
            return search.found(displacement, state, factor, exact=True, stable=stable)
        before = displacement
        displacement, state, correction = search.step(displacement, state, factor, iteration)
        if np.abs(displacement).max() > RUN_AWAY * membrane.radius:
            reason = f"the shape runs away, beyond {RUN_AWAY:g} radii"
            raise RunAwayError(reason, iteration, _norm(state), search.work)
        step = float(np.abs(displacement - before).max())
        ahead = float(np.abs(correction).max())
        enough = RENEWED_ABOVE * unit
        if thrifty and stable:
            enough = max(enough, search.within_reach(step))
        if ahead <= enough and search.shift == 0.0:
            polished = search.polish(displacement, state, factor, correction, step)
            if polished is not None:
                if exact:
                    factor, stable = search.own_factor(polished, iteration)
                return search.found(polished, state, factor, exact=exact, stable=stable)
            # what stalls does not converge as the last step let hope
            search.rate = np.inf
        elif ahead <= AGAIN_BELOW * step:
            displacement = displacement + membrane.spread(correction)
            state = replace(state, tangent=None)
    raise NewtonError(
        f"no convergence in {iteration} iterations", iteration, _norm(state), search.work
    )


def _norm(state: State) -> float:
    return float(np.abs(state.residual).max())


class _Search:
    """The moving parts of one Newton search."""

    def __init__(
        self,
        membrane: Membrane,
        pressure: float,
        stiffness: Floats,
        follow: bool,
        *,
        watch: bool,
        convex: bool,
        within: float,
    ) -> None:
        self.membrane, self.pressure, self.stiffness = membrane, pressure, stiffness
        self.follow, self.convex, self.within = follow, convex, within
        self.shift = 0.0
        self.leapt = False
        self.work = 0
        #: What follows a full step over its size squared, 1/mm; known after the first.
        self.rate = np.inf
        #: The slope of the path is corrected along with the shape: the forces that it takes come
        #: with the residual, and a second substitution with the first.
        self.watch = watch
        self.slope = np.zeros_like(membrane.reference)
        self.slope_change = np.inf

    def look(self, displacement: Floats, *, tangent: bool = False) -> State:
        """Assemble at a shape."""
        along = (self.slope, 3.0 * np.cbrt(self.pressure) ** 2) if self.watch else None
        return self.membrane.state(
            displacement, self.pressure, self.stiffness, tangent=tangent, along=along
        )

    def correct(self, factor: Factor, state: State) -> Floats:
        """Correction (N,) of a shape by a factor; the slope is corrected by the way."""
        if state.change is None:
            return -factor.solve(state.residual)
        found = -factor.solve(np.array([state.residual, state.change]).T)
        turn = self.membrane.spread(found[:, 1])
        self.slope = self.slope + turn
        self.slope_change = float(np.abs(turn).max() / np.abs(self.slope).max())
        return found[:, 0]

    def factor(self, displacement: Floats, state: State, iteration: int) -> tuple[Factor, bool]:
        """A factor to step with, and whether the tangent itself is positive definite."""
        tangent = state.tangent
        self.shift = 0.0 if self.shift < 1e-6 else 0.1 * self.shift
        for _ in range(12):
            self.work += 1
            try:
                assert tangent is not None
                linear = self.membrane.linear
                return linear.factorise(tangent, self.shift, spent=True), self.shift == 0.0
            except NotPositiveDefiniteError:
                if self.follow:
                    return self._indefinite_factor(displacement, iteration), False
                if self.convex:
                    break
                # the attempt has used it up
                tangent = self._tangent(displacement)
                self.leapt = True
                self.shift = max(1e-4, 5.0 * self.shift)
        raise NewtonError(
            "the tangent is not positive definite", iteration, _norm(state), self.work
        )

    def own_factor(self, balanced: Floats, iteration: int) -> tuple[Factor, bool]:
        """Factor of the tangent at a balanced shape as it is; whether it is positive definite."""
        self.work += 1
        try:
            return self.membrane.linear.factorise(self._tangent(balanced), spent=True), True
        except NotPositiveDefiniteError:
            return self._indefinite_factor(balanced, iteration), False

    def _indefinite_factor(self, displacement: Floats, iteration: int) -> Factor:
        """Factor of a tangent that is not positive definite; slack cloth may have none at all."""
        self.work += 1
        state = self.membrane.state(displacement, self.pressure, self.stiffness)
        assert state.tangent is not None
        try:
            return self.membrane.linear.factorise_indefinite(state.tangent)
        except NotPositiveDefiniteError as error:
            raise NewtonError(
                f"the tangent is singular ({error})", iteration, _norm(state), self.work
            ) from error

    def _tangent(self, displacement: Floats) -> Floats:
        tangent = self.membrane.state(displacement, self.pressure, self.stiffness).tangent
        assert tangent is not None
        return tangent

    def step(
        self, displacement: Floats, state: State, factor: Factor, iteration: int
    ) -> tuple[Floats, State, Floats]:
        """A step that makes progress; the new shape, its state, and the next correction (N,).

        A step that will be the last is not looked at again, unless there are wrinkles: where they
        come and go the tangent jumps, and convergence is not quadratic. To find them takes most of
        the time that a look does; so the tangent is then made by the way.
        """
        step = self.correct(factor, state)
        size = float(np.abs(step).max())
        smooth = self.shift == 0.0 and state.wrinkled == 0
        safety = SAFETY if self.membrane.fabric.curve is None else SAFER
        if smooth and safety * self.rate * size**2 <= CORRECTION * self._unit:
            last = displacement + self.membrane.spread(step)
            return last, replace(state, tangent=None), np.zeros_like(step)
        if iteration == 1 and size > self.within:
            raise NewtonError("the prediction is far off", iteration, _norm(state), self.work)
        slope = float(state.residual @ step)
        fraction = 1.0
        # between all but collapsed cells a search takes steps in the last digits, and goes nowhere
        lost = size <= 10.0 * np.finfo(float).eps * self.membrane.radius
        stuck = lost and self.shift > 0.0 and self._pushes(state)
        for _ in range(0 if stuck else 6 if self.follow else 25):
            trial = displacement + self.membrane.spread(fraction * step)
            new = self.look(trial, tangent=state.wrinkled > 0)
            if np.isfinite(new.potential):
                correction = self.correct(factor, new)
                ahead = float(np.abs(correction).max())
                natural = ahead <= (1 - 0.5 * fraction) * size
                lower = new.potential <= state.potential + 1e-4 * fraction * slope
                if natural or (lower and not self.follow) or size <= self._rounding:
                    self.rate = ahead / size**2 if fraction == 1.0 else np.inf
                    found = trial, new, correction
                    if self.shift == 0.0 or fraction < 1.0 or not lower:
                        return found
                    return self._lengthened(displacement, step, slope, factor, found)
            fraction *= 0.5
        raise NewtonError("no step makes progress", iteration, _norm(state), self.work)

    def _lengthened(
        self,
        displacement: Floats,
        step: Floats,
        slope: float,
        factor: Factor,
        found: tuple[Floats, State, Floats],
    ) -> tuple[Floats, State, Floats]:
        """What a `step` by a shifted tangent has `found`, or what lies farther along it.

        Such a tangent is too stiff, and the step too short. The potential's `slope` at its start
        and the one at its end make a parabola: where that is least at twice the step or beyond, its
        least value is looked for there, up to ten times as far, since the next shift is a tenth.
        """
        length, most = 1.0, _FAR * self.membrane.radius / float(np.abs(step).max())
        while length < most and 2.0 * (left := float(found[1].residual @ step)) <= slope:
            longer = slope / (slope - left) if left > slope else _LONGER
            length = min(length * min(longer, _LONGER), most)
            trial = displacement + self.membrane.spread(length * step)
            new = self.look(trial, tangent=found[1].wrinkled > 0)
            if not new.potential < found[1].potential:
                break
            found = trial, new, self.correct(factor, new)
        return found

    def polish(
        self, displacement: Floats, state: State, factor: Factor, correction: Floats, step: float
    ) -> Floats | None:
        """Correct with the factor at hand until nothing moves; None where that stalls early.

        Corrections by one factor shrink at a steady rate, twice that of the first one after a
        Newton step: what the next one will be is known from this one and the `step` before. Not
        where there are wrinkles: the next one may be as large as the last there, and is looked at.
        """
        size = step
        for _ in range(15):
            previous, size = size, float(np.abs(correction).max())
            if size > 0.5 * previous:
                settled = previous <= self._rounding and not self._jumps(state)
                return displacement if settled else None
            displacement = displacement + self.membrane.spread(correction)
            rate = 1.0 if state.wrinkled else min(1.0, 2.0 * size / previous)
            if size * rate <= CORRECTION * self._unit:
                return displacement
            state = self.look(displacement)
            correction = self.correct(factor, state)
        return None

    def _jumps(self, state: State) -> bool:
        """Whether wrinkles that come and go, and not rounding, keep corrections from shrinking."""
        return state.wrinkled > 0 and self._pushes(state)

    def _pushes(self, state: State) -> bool:
        """Whether more is out of balance than the least correction that counts would take.

        Rounding leaves less.
        """
        force = CORRECTION * self._unit * float(self.stiffness[:2].max()) * self.membrane.thickness
        return _norm(state) > force

    def is_noise(self, state: State) -> bool:
        """Whether what is out of balance is no more than wrinkles leave.

        They are found to `BALANCED` of D11 + D22, as a stress, which by the thickness and the size
        of a cell is a force; four cells meet at a node. Where Poisson's ratio is all but what it
        may be, D11 and D22 are thousands of times the moduli, and it takes more than `CORRECTION`.
        """
        mesh = self.membrane.mesh
        size = self.membrane.radius * np.sqrt(np.pi / len(mesh.cells))
        stress = BALANCED * float(self.stiffness[:2].sum())
        return state.wrinkled > 0 and _norm(state) <= 4.0 * stress * self.membrane.thickness * size

    def found(
        self, displacement: Floats, state: State, factor: Factor, *, exact: bool, stable: bool
    ) -> Equilibrium:
        """What the search ends with."""
        return Equilibrium(
            self.pressure, displacement, factor, exact, self.slope, self.slope_change,
            self.work, state.wrinkled, stable, self.leapt,
        )  # fmt: skip

    def within_reach(self, step: float) -> float:
        """Correction (mm) after a step of this size that `CORRECTIONS` more would make vanish.

        They shrink by a rate of about twice the first: c (2 c/step)^n = `CORRECTION`.
        """
        n = CORRECTIONS
        return float((CORRECTION * self._unit * (0.5 * step) ** n) ** (1.0 / (n + 1)))

    @property
    def _unit(self) -> float:
        """Lengths are given for a radius of 100 mm."""
        return self.membrane.radius / 100.0

    @property
    def _rounding(self) -> float:
        """Corrections (mm) that rounding may keep from shrinking any further."""
        return 1e-9 * self.membrane.radius
