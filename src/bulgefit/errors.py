"""The errors bulgefit raises on purpose; the command line prints one line and exits with 2."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from enum import Enum
from typing import Any

__all__ = [
    "BulgefitError",
    "Cause",
    "InputError",
    "SolveError",
    "UnsolvedError",
    "kind_of",
    "needed",
    "one_of",
]


class BulgefitError(Exception):
    """Base of every error that bulgefit raises on purpose."""


class InputError(BulgefitError, ValueError):
    """Input that cannot be used: the message says what is wrong, where, and what to do."""


def kind_of(value: Any) -> str:
    """What a value is that was no use, in words."""
    return "None" if value is None else f"a value of type {type(value).__name__}"


def one_of(name: str, known: Collection[str], what: str) -> None:
    """Raise InputError for a name that is none of those known."""
    if name not in known:
        raise InputError(f"{what}: {name!r} is unknown; choose from {', '.join(known)}")


def needed(value: Any, kind: type, what: str) -> Any:
    """The value, where a public function was given what it takes.

    Parameters
    ----------
    value
    kind : type
    what : str
        It in words, with where it comes from: "what bulgefit.measure gives".

    Raises
    ------
    InputError
        It is of another type.
    """
    if not isinstance(value, kind):
        raise InputError(f"{what} is needed, not {kind_of(value)}")
    return value


class Cause(Enum):
    """Why there is no equilibrium, or none was found."""

    LIMIT_PRESSURE = "the material has reached its limit pressure"
    LOSS_OF_ELLIPTICITY = "the law has lost ellipticity"
    INADMISSIBLE = "the stiffness is not positive definite"
    COLLAPSED = "a cell has collapsed"
    NOT_CONVERGED = "the solver did not converge"


class UnsolvedError(BulgefitError):
    """Nothing that was tried has an equilibrium: the same run would end so again."""


class SolveError(UnsolvedError, RuntimeError):
    """No equilibrium was found.

    Parameters
    ----------
    reason : str
        What stopped the solver, in one clause.
    cause : Cause
        The same as a type. Limit pressures and losses of ellipticity are confirmed before they
        are named.
    pressure : float
        Pressure at which it stopped, MPa.
    reached : float
        Highest pressure with an equilibrium, MPa.
    iteration : int
        Newton iteration of the last attempt.
    residual_norm : float
        Largest nodal out-of-balance force of the last attempt, N.
    parameters : mapping of str to float
        Material parameters of the solve (MPa, 1).
    """

    def __init__(
        self,
        reason: str,
        *,
        cause: Cause = Cause.NOT_CONVERGED,
        pressure: float,
        reached: float,
        iteration: int,
        residual_norm: float,
        parameters: Mapping[str, float],
    ) -> None:
        self.reason = reason
        self.cause = cause
        self.pressure = pressure
        self.reached = reached
        self.iteration = iteration
        self.residual_norm = residual_norm
        self.parameters = dict(parameters)
        super().__init__(str(self))

    def __str__(self) -> str:
        shown = ", ".join(
            # moduli are in MPa, ratios have no unit; an effect's parameter has its own
            f"{name} = {value:.6g}" + (" MPa" if name[0] in "EG" else "")
            for name, value in self.parameters.items()
        )
        return (
            f"{self.reason} at {self.pressure * 10:.6g} bar (equilibrium was reached up to "
            f"{self.reached * 10:.6g} bar; iteration {self.iteration}, residual "
            f"{self.residual_norm:.3g} N; {shown})"
        )

    def __reduce__(self) -> tuple[object, ...]:
        # keyword-only arguments do not survive the default pickling of exceptions,
        # and the error has to travel back from worker processes
        return _rebuild_solve_error, (self.reason, dict(self.__dict__))


def _rebuild_solve_error(reason: str, state: dict[str, object]) -> SolveError:
    state = {key: value for key, value in state.items() if key != "reason"}
    return SolveError(reason, **state)  # type: ignore[arg-type]
