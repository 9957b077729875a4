"""Do the data say the same as what was believed of a parameter before?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.errors import BulgefitError
from bulgefit.fitting.minimise import descend
from bulgefit.fitting.noise_left import noise_left
from bulgefit.fitting.options import FitOptions
from bulgefit.fitting.problem import Prior, Problem
from bulgefit.fitting.uncertainty import uncertainty_of
from bulgefit.shown import after_value

__all__ = ["Belief", "beliefs_of"]

Floats = NDArray[np.floating]

#: Combined standard errors from which a prior and the data conflict. The difference of two
#: independent estimates of one value has the variance s² + e²; if both are right, a normal one
#: exceeds three of these in one of 370 fits.
CONFLICT = 3.0


@dataclass(frozen=True)
class Belief:
    """What was believed of a parameter, and what the rest says of it.

    Attributes
    ----------
    name : str
    prior : Prior
    alone, stderr : float or None
        The parameter without this prior, and its standard error; None where it cannot be found.
    """

    name: str
    prior: Prior
    alone: float | None
    stderr: float | None

    @property
    def apart(self) -> float | None:
        """Combined standard errors between the prior's mean and what is found without it."""
        if self.alone is None or self.stderr is None:
            return None
        combined = float(np.hypot(self.prior.deviation, self.stderr))
        return abs(self.alone - self.prior.mean) / combined

    @property
    def conflicts(self) -> bool:
        """Whether the prior and the data cannot both be right."""
        return self.apart is not None and self.apart > CONFLICT

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "parameter": self.name,
            "mean": self.prior.mean,
            "deviation": self.prior.deviation,
            "without": self.alone,
            "stderr_without": self.stderr,
            "apart": self.apart,
        }

    def line(self, unit: str) -> str:
        """To read; `unit` is "1" where the parameter has none."""
        shown = after_value(unit)
        said = f"  prior {self.name} = {self.prior.mean:.6g} ± {self.prior.deviation:.3g}{shown}"
        if self.alone is None or self.stderr is None:
            return f"{said}; without it, {self.name} is not found"
        return f"{said}; without it, {self.alone:.6g} ± {self.stderr:.3g}{shown}"


def beliefs_of(problem: Problem, z: Floats, options: FitOptions) -> list[Belief]:
    """Each prior beside the optimum without it, which is looked for from that with it, `z`."""
    return [
        Belief(str(key), prior, *_without(problem, key, z, options))
        for key, prior in problem.priors.items()
    ]


def _without(
    problem: Problem, key: Key, z: Floats, options: FitOptions
) -> tuple[float | None, float | None]:
    """A parameter without its prior and its standard error; None where it is not found."""
    free = problem.without_prior(key)
    best = descend(free.on_all_data(), z, options.method, options.limits).best
    if not np.isfinite(best.value):
        return None, None
    there = free.coordinates(best.values)
    try:
        shapes = free.shapes(there, derivatives=True)
    except BulgefitError:
        return None, None
    noises = noise_left(free.objective, shapes)
    errors = uncertainty_of(free, there, shapes, free.at_bound(there), options.uncertainty, noises)
    name = str(key)
    error = errors.stderr[name]
    return (None, None) if error is None else (best.values[name], error)
