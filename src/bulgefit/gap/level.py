"""How stiff is the cloth in most places, where its stiffness varies, and how sure is that?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import hypot, prod

import numpy as np

from bulgefit.effects.fields.base import Field
from bulgefit.effects.parameter import Key
from bulgefit.gap.effects import MODULI
from bulgefit.gap.regress import Regression
from bulgefit.gap.scatter import modulus_errors

__all__ = ["Level"]


@dataclass(frozen=True, eq=False)
class Level:
    """A factor of the moduli.

    Attributes
    ----------
    value : float
    slopes : mapping of Key to float
        Derivatives of its logarithm.
    error : float
        Standard error of its logarithm beside that of the parameters.
    """

    value: float = 1.0
    slopes: Mapping[Key, float] = field(default_factory=dict)
    error: float = 0.0

    @classmethod
    def of(cls, kind: Field, values: Mapping[Key, float]) -> Level:
        """That of a field, by its parameters."""
        found = kind.typical({key.parameter: value for key, value in values.items()})
        slopes = {k: found.slopes[k.parameter] for k in values if k.parameter in found.slopes}
        return cls(found.value, slopes, found.error)

    @classmethod
    def of_all(cls, levels: Iterable[Level]) -> Level:
        """Of several fields."""
        every = list(levels)
        slopes = {key: slope for level in every for key, slope in level.slopes.items()}
        return cls(prod(level.value for level in every), slopes, hypot(*(e.error for e in every)))

    def errors(self, fit: Regression) -> dict[Key, float]:
        """Standard errors (MPa) of the moduli times the level, by the delta method."""
        if not self.slopes:
            return {m: self.value * error for m, error in modulus_errors(fit).items()}
        covariance, row = fit.covariance, np.zeros(len(fit.columns))
        for key, slope in self.slopes.items():
            row[fit.columns.index(key)] = slope
        out = {}
        for m in MODULI:
            own = np.array(row)
            own[fit.columns.index(m)] = 1.0 / fit.values[m]
            relative = hypot(float(np.sqrt(own @ covariance @ own)), self.error)
            out[m] = self.value * fit.values[m] * relative
        return out
