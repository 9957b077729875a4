"""A parameter: its name, unit, range and null, what is believed of it, and how fits step in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

from bulgefit.errors import InputError

__all__ = ["Key", "Owned", "Parameter", "as_wide_as", "by_key", "ends_about", "of_specimen"]

Value = TypeVar("Value")

#: Length (mm) below which one that acts through its square steps as if it were that long: at none
#: at all its derivative is nothing, and a fit would never leave it.
_LEAST_LENGTH = 0.5
#: Coordinate from which on the exponential is no number: ln of the largest double is 709.8.
_LARGEST = 709.0
#: Half a step over the value, at least: the root of the double's spacing, so that of a difference
#: as many digits are left as are lost.
_LEAST_STEP = 1.5e-8


class Key(NamedTuple):
    """Whose parameter is it: of which effect ("" for the material) and of which specimen.

    `specimen` is None for what all specimens share, and where there is only one.
    """

    effect: str
    parameter: str
    specimen: int | None = None

    @property
    def name(self) -> str:
        """As commands and JSON write it, without the specimen: `effect.parameter`, or `E1`."""
        return f"{self.effect}.{self.parameter}" if self.effect else self.parameter

    @classmethod
    def of(cls, name: str, specimen: int | None = None) -> Key:
        """The key of a name."""
        effect, dot, parameter = name.partition(".")
        return cls(effect, parameter, specimen) if dot else cls("", name, specimen)

    @classmethod
    def read(cls, text: str) -> Key:
        """The key that was written as `effect.parameter`, or `effect.parameter@i` of specimen i.

        Raises
        ------
        InputError
            What stands behind the @ is no specimen's number.
        """
        return cls.of(*_apart(text))

    def __str__(self) -> str:
        return _written(self.name, self.specimen)


class Owned(NamedTuple):
    """An effect, and of which specimen; None for what all share, and where there is only one."""

    effect: str
    specimen: int | None = None

    @classmethod
    def read(cls, text: str) -> Owned:
        """What was written as `effect`, or `effect@i` of specimen i; InputError as `Key.read`."""
        return cls(*_apart(text))

    def __str__(self) -> str:
        return _written(self.effect, self.specimen)


def _written(name: str, specimen: int | None) -> str:
    return name if specimen is None else f"{name}@{specimen}"


def _apart(text: str) -> tuple[str, int | None]:
    name, at, specimen = text.partition("@")
    if at and not (specimen.isascii() and specimen.isdigit()):
        raise InputError(f"{text!r}: behind the @ stands the number of a test, 0 for the first")
    return name, int(specimen) if at else None


def of_specimen(values: Mapping[Key, Value], specimen: int | None) -> dict[str, Value]:
    """By `effect.parameter`, what is a specimen's own or shared; of no specimen: what is shared."""
    return {k.name: v for k, v in values.items() if k.specimen in (None, specimen)}


def by_key(values: Mapping[str, Value]) -> dict[Key, Value]:
    """What was said of parameters by name; InputError as `Key.read`."""
    return {Key.read(name): value for name, value in values.items()}


@dataclass(frozen=True)
class Parameter:
    """One parameter of a material or of an effect.

    Attributes
    ----------
    name, unit : str
        The unit is "1" where there is none.
    lower, upper : float
        What is plausible; for a modulus the bounds that a fit uses unless told otherwise.
    null : float or None
        Where the effect is absent; None: what the test states.
    prior : float
        Standard deviation of what is believed of it about its null before any measurement.
    reason : str
        Why the prior is as wide as it is.
    step : float
        Half of the step of a difference, in the parameter's unit.
    start : float or None
        Where a fit starts; None: at the null. Off the null where the effect is of second order
        there, on either side of it where both are plausible.
    coordinate : {"linear", "log", "square"}
        What fits step in: what multiplies a stiffness is more nearly linear in the logarithm of its
        distance from `origin`, and a length that acts through its square in that.
    origin : float or None
        Where it would take a stiffness that it multiplies to nothing; None: it multiplies none, and
        logarithms are of the value.
    governor : str or None
        Another of the effect's parameters, where which is at its null this one means nothing: a
        lift's amplitude governs its direction.
    period : float or None
        What values may differ by and be the same; None: each is another. Before any measurement
        each value within it is as likely, and the prior as wide as that says (`as_wide_as`).
    above : float or None
        Which a value must exceed to mean anything, where no other attribute says so: a gauge whose
        gain is -1 reads nothing whatever the pressure.
    """

    name: str
    unit: str
    lower: float
    upper: float
    null: float | None = 0.0
    prior: float = math.inf
    reason: str = ""
    step: float = 1e-5
    start: float | None = None
    coordinate: Literal["linear", "log", "square"] = "linear"
    origin: float | None = None
    governor: str | None = None
    period: float | None = None
    above: float | None = None

    @property
    def begins_at_null(self) -> bool:
        """Whether the plausible range begins where the effect is absent: no edge to be held at."""
        return self.null == self.lower

    def require(self, value: float, where: str) -> None:
        """Raise InputError for a value that means nothing, as a clamp that gives by less than none.

        What is plausible (`lower`, `upper`) is no such limit, but where it begins at the null.
        """
        if not math.isfinite(value):
            raise InputError(f"{where} must be finite, got {value:g}")
        above = (self.origin or 0.0) if self.coordinate == "log" else self.above
        if above is not None and value <= above:
            raise InputError(f"{where} must be above {above:g}, got {value:g}")
        if self.begins_at_null and value < self.lower:
            raise InputError(f"{where} must be {self.lower:g} or more, got {value:g}")

    def from_origin(self, value: float) -> float:
        """How far a value is from the origin."""
        return value - (self.origin or 0.0)

    def to_coordinate(self, value: float) -> float:
        """The coordinate of a value."""
        if self.coordinate == "log":
            return math.log(self.from_origin(value))
        return value * abs(value) if self.coordinate == "square" else value

    def from_coordinate(self, coordinate: float) -> float:
        """The value at a coordinate; infinite where no number is as large."""
        if self.coordinate == "log":
            far = math.exp(coordinate) if coordinate < _LARGEST else math.inf
            return (self.origin or 0.0) + far
        if self.coordinate == "square":
            return math.copysign(math.sqrt(abs(coordinate)), coordinate)
        return coordinate

    def slope(self, value: float) -> float:
        """∂(what the model differentiates by)/∂coordinate.

        Its derivatives are by values, but by squares where the coordinate is one.
        """
        return self.from_origin(value) if self.coordinate == "log" else 1.0

    def by_value(self, value: float) -> float:
        """∂(what the model differentiates by)/∂value; of squares also from none at all on."""
        return 2.0 * max(value, _LEAST_LENGTH) if self.coordinate == "square" else 1.0


def as_wide_as(period: float) -> float:
    """Standard deviation of a Gaussian as dense in its middle as what is alike all round."""
    return period / math.sqrt(2.0 * math.pi)


def ends_about(value: float, step: float) -> tuple[float, float]:
    """Values a step below and above one, which its digits tell apart whatever it is."""
    step = max(step, _LEAST_STEP * abs(value))
    return value - step, value + step
