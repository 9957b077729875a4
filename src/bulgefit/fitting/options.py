"""Everything that says how a fit is done, in one object that fits, folds and refits share."""

from __future__ import annotations

import numbers
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting.minimise import GAUSS_NEWTON, Limits, check_method
from bulgefit.fitting.multistart import check_starts
from bulgefit.fitting.objective import Objective, check_comparison
from bulgefit.fitting.problem import Prior, Problem
from bulgefit.fitting.uncertainty import check_stated
from bulgefit.model.parameters import as_values, parameters_of
from bulgefit.model.setup import Setup

__all__ = ["FitOptions", "options_from"]


@dataclass(frozen=True)
class FitOptions:
    """How a fit is done.

    Attributes
    ----------
    objective : {"e_w", "e", "e_z", "likelihood"}
        See `bulgefit.fitting.objective`.
    material : {"orthotropic", "isotropic", "isotropic-EG"}
    free : sequence of str
        Freed beyond the moduli: "nu12" or "nu".
    bounds : mapping of name to (lower, upper)
        MPa, or the unit of an effect's parameter; default: from the tests' apex, and what is
        plausible. Equal ones hold a modulus.
    held : mapping of name to value
        nu12 or nu where it is not the tests', and effects' parameters (`effect.parameter`, test i's
        own `effect.parameter@i`) that are not at their null.
    effects : sequence of str
        Effects, or single parameters of them, that are fitted beside the moduli.
    priors : mapping of name to Prior
        What is believed of fitted parameters.
    uncertainty : mapping of name to float
        Stated relative standard deviations of "thickness", "radius" and "pressure" and the
        absolute one of "nu12"; intervals include them.
    weight : float, (3,) sequence or None
        Of dz, or of dx, dy, dz, in e_w; None: from the tests.
    average : {"points", "frames"}
    setup : Setup or None
        Law, mesh, field evaluation.
    starts, seed : int
        Scrambled-Sobol starts; the same seed gives the same result for any number of workers.
    method : str
        "gauss-newton" or a scipy minimiser.
    limits : Limits or None
    """

    objective: str = "e_w"
    material: str = "orthotropic"
    free: Sequence[str] = ()
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    effects: Sequence[str] = ()
    priors: Mapping[str, Prior] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    weight: float | Sequence[float] | None = None
    average: str = "points"
    setup: Setup | None = None
    starts: int = 5
    seed: int = 0
    method: str = GAUSS_NEWTON
    limits: Limits | None = None

    def check(self) -> None:
        """Refuse names and numbers with which no test could be fitted, before any work.

        Raises
        ------
        InputError
        """
        check_comparison(self.objective, self.average)
        parameters_of(self.material)
        check_method(self.method)
        check_starts(self.starts)
        if self.seed < 0:
            raise InputError(f"seed: must be 0 or more, got {self.seed}")
        if self.limits is not None and self.limits.evaluations < 1:
            raise InputError(
                f"limits: evaluations must be 1 or more, got {self.limits.evaluations}"
            )

    def problem(self, tests: Sequence[BulgeTest]) -> Problem:
        """The problem that they pose on given tests; InputError."""
        objective = Objective(
            tests, self.objective, self.setup, weight=self.weight, average=self.average
        )
        problem = Problem(
            objective,
            self.material,
            free=self.free,
            bounds=self.bounds,
            held=self.held,
            effects=self.effects,
            priors=self.priors,
        )
        check_stated(problem, self.uncertainty)
        return problem


#: What an option must be, where all else would fail without a word on it.
_KINDS: Mapping[str, tuple[Any, str]] = {
    **dict.fromkeys(("objective", "material", "average", "method"), (str, "a name")),
    **dict.fromkeys(("bounds", "held", "priors", "uncertainty"), (Mapping, "a dict by name")),
    **dict.fromkeys(("starts", "seed"), (numbers.Integral, "a whole number")),
    **dict.fromkeys(("free", "effects"), (Iterable, "a name or a list of names")),
    "setup": (Setup, "a Setup"),
    "limits": (Limits, "Limits"),
}


def _plain(name: str, value: Any) -> Any:
    """An option's value, of what kind of numbers and lists it was made, as Python's own."""
    kind, words = _KINDS.get(name, (object, ""))
    if not isinstance(value, kind):
        raise InputError(f"{name}: give {words}, not {value!r}")
    if name in ("held", "uncertainty"):
        return as_values(value, name, "numbers by name")
    if name == "bounds":
        what = "a lower and an upper number"
        return {k: _numbers(f"bounds of {k}", ends, what, (2,)) for k, ends in value.items()}
    if name == "weight":
        found = _numbers("weight", value, "one number of dz, or three of dx, dy, dz", (1, 3))
        return found[0] if len(found) == 1 else found
    if name == "priors":
        return {key: _prior(key, prior) for key, prior in value.items()}
    if name in ("starts", "seed"):
        return int(value)
    if name in ("free", "effects"):
        return tuple(filter(None, value.split(",")) if isinstance(value, str) else value)
    return value


def _prior(key: str, prior: Any) -> Prior:
    if not isinstance(prior, Prior):
        raise InputError(f"prior of {key}: give a Prior(mean, deviation), not {prior!r}")
    return Prior(*_numbers(f"prior of {key}", [prior.mean, prior.deviation], "numbers", (2,)))


def _numbers(what: str, given: Any, words: str, counts: Sequence[int]) -> tuple[float, ...]:
    listed = given.tolist() if isinstance(given, np.ndarray) else given
    values = list(listed) if isinstance(listed, Iterable) else [listed]
    real = all(isinstance(v, numbers.Real) and not isinstance(v, bool) for v in values)
    if not real or len(values) not in counts:
        raise InputError(f"{what}: give {words}, not {given!r}")
    return tuple(map(float, values))


def options_from(options: FitOptions | None, changes: Mapping[str, Any]) -> FitOptions:
    """Options with some changed; names that are given as one string count as a list of one.

    Raises
    ------
    InputError
        A name that is no option; the nearest one is told.
    """
    known = [f.name for f in fields(FitOptions)]
    for name in changes:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            raise InputError(
                f"fit has no option {name!r}"
                + (f"; did you mean {near[0]}?" if near else f"; there are {', '.join(known)}")
            )
    if not (options is None or isinstance(options, FitOptions)):
        raise InputError(f"options: give FitOptions, or options by name, not {options!r}")
    given = {name: value for name, value in changes.items() if value is not None}
    asked = replace(options or FitOptions(), **given)
    plain = {name: value for name in known if (value := getattr(asked, name)) is not None}
    chosen = replace(asked, **{name: _plain(name, value) for name, value in plain.items()})
    chosen.check()
    return chosen
