"""An objective over the free parameters of a material, in coordinates that suit a minimiser."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.l1 import Rows
from bulgefit.fitting.objective import Objective
from bulgefit.model.parameters import Material, Parameter, free_parameters, parameters_of
from bulgefit.model.virtual_test import Fields

__all__ = ["Evaluation", "Problem", "stated_ratio"]

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """One point of the search.

    Attributes
    ----------
    values : dict of str to float
        Free parameters in their units.
    value : float, mm
        The objective; NaN where the solve failed.
    error : str
        Why it failed, else "".
    slope : (free,) array or None
        Derivative of the objective by the coordinates, if asked for.
    fields : list of Fields or None
        With derivatives if they were asked for.
    """

    values: dict[str, float]
    value: float
    error: str = ""
    slope: Floats | None = None
    fields: list[Fields] | None = None


class Problem:
    """Objective, material kind, and what is free.

    Coordinates run from 0 to 1 between the bounds, in the logarithm of a modulus and linearly
    in a Poisson ratio: displacements are far more linear in log E than in E.

    Parameters
    ----------
    objective : Objective
    kind : str
        A key of `bulgefit.model.parameters.MATERIALS`.
    free : iterable of str
        Freed beyond the moduli.
    bounds : mapping of name to (lower, upper), optional
    held : mapping of name to value, optional
        Values of parameters that are not free; default the tests' Poisson ratio.
    """

    def __init__(
        self,
        objective: Objective,
        kind: str = "orthotropic",
        *,
        free: Iterable[str] = (),
        bounds: Mapping[str, tuple[float, float]] | None = None,
        held: Mapping[str, float] | None = None,
    ) -> None:
        self.objective = objective
        self.kind = kind
        self.free: tuple[Parameter, ...] = free_parameters(kind, free, bounds)
        names = [p.name for p in self.free]
        self.held = {
            p.name: _held_value(p, objective, held or {})
            for p in parameters_of(kind)
            if p.name not in names
        }
        self._lower = np.array([p.lower for p in self.free])
        self._upper = np.array([p.upper for p in self.free])
        self._is_log = np.array([p.unit == "MPa" for p in self.free])

    def with_objective(self, objective: Objective) -> Problem:
        """The same parameters and bounds with another objective."""
        other = copy(self)
        other.objective = objective
        return other

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return len(self.free)

    def values(self, z: Floats) -> dict[str, float]:
        """Free parameters at coordinates z in [0, 1]."""
        ratio = self._upper / np.where(self._is_log, self._lower, 1.0)
        logarithmic = self._lower * np.where(self._is_log, ratio, 1.0) ** z
        linear = self._lower + (self._upper - self._lower) * z
        found = np.clip(np.where(self._is_log, logarithmic, linear), self._lower, self._upper)
        return {p.name: float(v) for p, v in zip(self.free, found, strict=True)}

    def coordinates(self, values: Mapping[str, float]) -> Floats:
        """Coordinates of given free parameters."""
        given = np.array([values[p.name] for p in self.free])
        safe = np.where(self._is_log, self._lower, 1.0)
        return np.where(
            self._is_log,
            np.log(np.where(self._is_log, given, 1.0) / safe)
            / np.log(np.where(self._is_log, self._upper, np.e * safe) / safe),
            (given - self._lower) / (self._upper - self._lower),
        )

    def material(self, z: Floats) -> Material:
        """The material at coordinates z (not checked for admissibility)."""
        values = {**self.held, **self.values(z)}
        return Material(self.kind, {p.name: values[p.name] for p in parameters_of(self.kind)})

    def columns(self, z: Floats) -> Floats:
        """∂(all parameters)/∂z, (parameters, free)."""
        names = [p.name for p in parameters_of(self.kind)]
        values = self.values(z)
        out = np.zeros((len(names), self.size))
        for j, p in enumerate(self.free):
            out[names.index(p.name), j] = (
                values[p.name] * np.log(p.upper / p.lower) if self._is_log[j] else p.upper - p.lower
            )
        return out

    def evaluate(self, z: Floats, *, derivatives: bool = False) -> Evaluation:
        """The objective at z; a failed solve is an evaluation whose value is NaN."""
        values = self.values(z)
        try:
            fields = self.objective.virtual.fields(self.material(z), derivatives=derivatives)
        except (SolveError, InputError) as error:
            return Evaluation(values, float("nan"), str(error))
        if not derivatives:
            return Evaluation(values, self.objective.from_fields(fields), fields=fields)
        value, slope = self.objective.slope(fields)
        return Evaluation(values, value, slope=slope @ self.columns(z), fields=fields)

    def rows(self, at: Evaluation, z: Floats) -> Rows:
        """The objective linearised in the coordinates at an evaluation with derivatives."""
        assert at.fields is not None
        return self.objective.rows(at.fields, self.columns(z))

    def worst(self) -> float:
        """The objective of a model that does not deform, mm: worse than any that does."""
        return self.objective.from_fields(self.objective.resting())


def _held_value(parameter: Parameter, objective: Objective, held: Mapping[str, float]) -> float:
    if parameter.name in held:
        return float(held[parameter.name])
    return stated_ratio(objective.tests)


def stated_ratio(tests: Sequence[BulgeTest]) -> float:
    """Poisson's ratio that the tests state.

    Raises
    ------
    InputError
        They state different ones.
    """
    ratios = sorted({test.poisson_ratio for test in tests})
    if len(ratios) > 1:
        raise InputError(
            f"the tests state different Poisson ratios ({', '.join(f'{r:g}' for r in ratios)}); "
            "say which one holds for all (--nu12, or --nu of an isotropic material)"
        )
    return float(ratios[0])
