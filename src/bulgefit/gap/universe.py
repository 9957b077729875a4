"""Everything that could be freed, at one fit: what each effect would bring costs no solve."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bulgefit.effects.base import Effect
from bulgefit.gap.data import Data
from bulgefit.gap.effects import FIELD_FORMS, MODULI, STEADY
from bulgefit.gap.keys import (
    bounds_of,
    columns_of,
    group_keys,
    is_field,
    names_of,
    null_of,
    specimen_values,
    start_of,
)
from bulgefit.gap.normal import NormalEquations, normal_equations
from bulgefit.gap.regress import Regression
from bulgefit.model.inflation import Shapes
from bulgefit.model.virtual_test import Prediction

__all__ = ["Universe", "forms_in_reach", "observed", "universe"]


@dataclass(eq=False)
class Universe:
    """Normal equations of every parameter of every effect at one fit: forecasts cost nothing.

    Attributes
    ----------
    keys : tuple of str
        Those with derivatives.
    field : tuple of str
        Offsets of every point that are freed.
    normal : NormalEquations
    inflation : float
    data : sequence of Data
    predictions : list of Prediction
        With derivatives by all keys that are the specimen's.
    """

    keys: tuple[str, ...]
    field: tuple[str, ...]
    normal: NormalEquations
    inflation: float
    data: Sequence[Data]
    predictions: list[Prediction]

    def held_out(self, keys: Iterable[str]) -> float:
        """Forecast of the held-out sum of squares over the inflation with `keys` freed.

        By one linear step; the offsets of points are as they are in this universe.
        """
        index = [self.keys.index(key) for key in columns_of(keys)]
        return self.normal.of(index).held_out(realised=False) / self.inflation

    def moved(self, changes: Mapping[str, float]) -> Universe:
        """With parameters changed by so much, to first order; predictions are not moved.

        A change of an offset of every point takes it off.
        """
        gone = {key for key in changes if is_field(key)}
        here = self if not gone else self.with_field(k for k in self.field if k not in gone)
        columns = columns_of(changes)
        index = [self.keys.index(key) for key in columns]
        change = np.array([changes[key] for key in columns])
        return replace(here, normal=here.normal.moved(index, change))

    def with_field(self, field: Iterable[str]) -> Universe:
        """With other offsets of points freed."""
        field = tuple(field)
        normal = normal_equations(self.data, self.predictions, (*self.keys, *field))
        return replace(self, field=field, normal=normal)

    def step(self, keys: Sequence[str]) -> dict[str, float]:
        """Linear step of `keys` to the optimum, all others held."""
        index = [self.keys.index(key) for key in keys]
        return dict(zip(keys, self.normal.of(index).whole.step().tolist(), strict=True))

    def starts(self, freed: Iterable[str], new: Iterable[str]) -> dict[str, float]:
        """Where a fit of `new` keys beside the others that are freed starts.

        Where a start is off the null and both sides are plausible, it is on the linear step's side.
        """
        step = self.step(columns_of(freed))
        out = {}
        for key in new:
            out[key] = start = start_of(key, self.data)
            mirrored = 2.0 * null_of(key, self.data) - start
            if (start - mirrored) * step.get(key, 0.0) < 0.0 and mirrored >= bounds_of(key)[0]:
                out[key] = mirrored
        return out


def universe(data: Sequence[Data], fit: Regression, effects: Sequence[Effect]) -> Universe:
    """Normal equations at a fit, by everything that could be freed."""
    field = tuple(k for k in fit.keys if is_field(k))
    names = []
    for effect in effects:
        forms = [effect.groups()[-1], *(FIELD_FORMS.get(effect.id, ()) if field else ())]
        if not effect.never_separable:
            names += [n for form in forms for n in form if not (field and n in STEADY)]
    keys = columns_of(dict.fromkeys([*fit.columns, *group_keys([*MODULI, *names], len(data))]))
    predictions = []
    for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True)):
        wanted, _ = names_of(keys, index, len(data) > 1)
        predictions.append(d.specimen.predict(specimen_values(fit.values, index), wanted, p.shapes))
    normal = normal_equations(data, predictions, (*keys, *field))
    return Universe(keys, field, normal, fit.inflation, data, predictions)


def observed(
    data: Sequence[Data], shapes: Sequence[Shapes], keys: Sequence[str]
) -> list[Prediction]:
    """Predictions at known shapes, with derivatives by `keys` alone."""
    return [
        d.specimen.observe(s, names_of(keys, index, len(data) > 1)[0])
        for index, (d, s) in enumerate(zip(data, shapes, strict=True))
    ]


def forms_in_reach(current: Regression, effect: Effect, count: int) -> list[tuple[str, ...]]:
    """Keys of the forms that an effect may take beside what is in the model.

    An offset of every point is worth trying once smooth offsets are as fine as they get.
    """
    forms = [group_keys(group, count) for group in effect.groups()]
    before = forms[-1]
    for form in FIELD_FORMS.get(effect.id, ()):
        keys = group_keys(form, count)
        if set(before) <= set(current.keys):
            forms.append(keys)
        before = keys
    return forms
