"""What is a field? An effect of many small parts, that says where in its place something sits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own

__all__ = ["Field", "Sampled", "Typical"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sampled:
    """A field at many places.

    Attributes
    ----------
    values : (m,) array
    where : dict of name to (m,) array
        `x_mm` and `y_mm`, `angle_degree`, `pressure_bar`, `time_share`, or `strain` and
        `from_warp_degree`.
    """

    values: Floats
    where: dict[str, Floats]

    @property
    def rms(self) -> float:
        """Root mean square of the values."""
        return float(np.sqrt((self.values**2).mean()))

    @property
    def largest(self) -> tuple[float, dict[str, float]]:
        """The value that is furthest from zero, and where it is."""
        at = self.at_largest
        return float(self.values[at]), {k: float(v[at]) for k, v in self.where.items()}

    @property
    def at_largest(self) -> int:
        """Which place the largest value has."""
        return int(np.argmax(np.abs(self.values)))


@dataclass(frozen=True, eq=False)
class Typical:
    """What a field multiplies the cloth's moduli by in most places.

    Attributes
    ----------
    value : float
    slopes : mapping of parameter to float
        Derivatives of its logarithm.
    error : float
        Standard error of its logarithm since a specimen is one piece of the cloth.
    """

    value: float = 1.0
    slopes: Mapping[str, float] = field(default_factory=dict)
    error: float = 0.0


class Field(Effect):
    """An effect without a name: of its place, whatever it may be.

    Attributes
    ----------
    quantity : str
        What varies, in a few words.
    unit : str
    pointwise : bool
        True for an offset of every measured point, which has no parameters: offsets are integrated
        out of the likelihood.
    of_several : bool
        True for what one test alone cannot tell from a field of another place.
    """

    quantity: ClassVar[str] = ""
    unit: ClassVar[str] = "1"
    pointwise: ClassVar[bool] = False
    of_several: ClassVar[bool] = False

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """The field over its place.

        Parameters
        ----------
        own : mapping
            Values of its parameters.
        radius : float, mm
        pressure : (frames,) array, MPa
        """
        raise NotImplementedError

    def typical(self, own: Own) -> Typical:
        """What it multiplies the cloth's moduli by in most places: told with them, not with it."""
        return Typical()
