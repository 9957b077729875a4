"""How is each frame of a description balanced by itself, and its shape differentiated?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.equilibrium import Equilibrium
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.quarter import Quarter
from bulgefit.model.description import Description
from bulgefit.model.forces import Forces
from bulgefit.model.frame import solved, unsolved

__all__ = ["LEAST_PRESSURE", "Balanced", "Found", "Frames", "at_rest", "of_frame"]

Floats = NDArray[np.float64]

#: Frames with pressure are balanced at this (MPa) or more; one without shows the fabric at rest.
LEAST_PRESSURE = 1e-6
#: Part of the highest pressure that is left of a gauge's readings where they cancel, by rounding.
_CANCELLED = 1e-12


@dataclass(frozen=True, eq=False)
class Found:
    """What was found of a frame of a description, from a guess (n, 3)."""

    given: Description
    guess: Floats
    balance: Equilibrium

    def serves(self, given: Description, frame: int, guess: Floats) -> bool:
        """Whether the same would be found, to the last bit, of another description and guess."""
        return (
            self.given.law_parameters == given.law_parameters
            and self.given.lies_as(given)
            and self.given.load.balanced[frame] == given.load.balanced[frame]
            and np.array_equal(self.guess, guess)
        )


@dataclass(frozen=True, eq=False)
class Balanced:
    """A frame's shape (n, 3) mm from the stress-free surface, and what is told of it."""

    displacement: Floats
    stable: bool
    wrinkled: int
    factorisations: int


@dataclass(frozen=True, eq=False)
class Frames:
    """The frames of a description, of the whole membrane or of its quarter.

    Parameters
    ----------
    given : Description
    values : dict
        Its parameters, which errors name.
    membrane : Membrane
    quarter : Quarter or None
        Where all shapes mirror.
    forces : Forces or None
        Of the membrane or the quarter; None: nothing is differentiated.
    starts : (k, frames, n, 3) array, mm
        Displacements near balance, the likeliest first.
    derivative : (changes, frames, n, 3) array
        Filled with the derivatives of each frame that is balanced.
    loose : bool
        The starts are of a path of cloth that lies loosely.
    known : dict or None
        What was found of frames; kept up to date.
    """

    given: Description
    values: dict[str, float]
    membrane: Membrane
    quarter: Quarter | None
    forces: Forces | None
    starts: Floats
    derivative: Floats
    loose: bool
    known: dict[int, Found] | None

    @property
    def part(self) -> Membrane:
        """What is balanced: the membrane or its quarter."""
        return self.membrane if self.quarter is None else self.quarter.even

    def balanced(self, frame: int) -> Balanced:
        """A frame at its pressure, differentiated in its place; raises SolveError."""
        loads = np.asarray(self.given.load.balanced, dtype=float)
        if at_rest(loads)[frame]:
            self.derivative[:, frame] = 0.0
            return Balanced(np.zeros_like(self.starts[0, frame]), True, 0, 0)
        pressure = max(float(loads[frame]), LEAST_PRESSURE)
        # in the error of the first frame that fails: those before it are balanced
        reached = float(loads[:frame].max(initial=0.0))
        balance = self._found(frame, pressure, reached)
        if self.forces is not None:
            try:
                self._differentiate(self.forces, balance, frame)
            except ArithmeticError as error:
                # a law of large softening may have a wrinkled point that no stress balances
                reason = f"the shape has no derivatives: {error}"
                raise unsolved(reason, pressure, reached, self.values) from error
        return self._whole(balance)

    def _found(self, frame: int, pressure: float, reached: float) -> Equilibrium:
        """From the starts, unless it was found from there before."""
        start = self.starts[:, frame]
        if self.quarter is not None:
            start = start[:, self.quarter.kept]
        known = None if self.known is None else self.known.get(frame)
        if known is not None and known.serves(self.given, frame, start[0]):
            balance = known.balance
        else:
            balance = solved(
                of_frame(self.part, self.given, frame), start, pressure,
                self.given.stiffness, self.values, loose=self.loose, reached=reached,
            )  # fmt: skip
        if self.known is not None:
            self.known[frame] = Found(self.given, start[0], balance)
        return balance

    def _differentiate(self, forces: Forces, balance: Equilibrium, frame: int) -> None:
        """Fill a frame's derivatives."""
        if self.quarter is None:
            forces.fields(balance, frame, self.derivative[:, frame])
            return
        rates = self.derivative[:, frame, self.quarter.kept]
        forces.fields(balance, frame, rates)
        self.derivative[:, frame] = self.quarter.whole(rates)

    def _whole(self, balance: Equilibrium) -> Balanced:
        """A balance of what is balanced, told of the membrane."""
        quarter, shape, pressure = self.quarter, balance.displacement, balance.pressure
        stable, wrinkled, spent = balance.stable, balance.wrinkled, balance.factorisations
        if quarter is None:
            return Balanced(shape, stable, wrinkled, spent)
        stable = stable and quarter.keeps(shape, pressure, self.given.stiffness)
        whole = quarter.whole(shape)
        if wrinkled:
            state = self.membrane.state(whole, pressure, self.given.stiffness, tangent=False)
            wrinkled = state.wrinkled
        return Balanced(whole, stable, wrinkled, spent + len(quarter.odd))


def at_rest(loads: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Frames (k,) that no pressure inflates, of loads (k,) in MPa."""
    return np.asarray(loads <= _CANCELLED * max(float(loads.max(initial=0.0)), 0.0))


def of_frame(membrane: Membrane, given: Description, frame: int) -> Membrane:
    """The membrane in its clamp as that gives, and is moved, in a frame."""
    own = membrane if given.eased is None else membrane.eased(float(given.eased[frame]))
    return own if given.edge is None else own.pulled_at(given.edge[frame, :, :2])
