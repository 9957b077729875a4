"""Everything that could be freed, at one fit: what each effect would bring costs no solve."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.effects import CATALOGUE, MODULI, Effect
from bulgefit.gap.regress import (
    Blocks,
    Data,
    Regression,
    names_of,
    normal_equations,
    own_key,
    specimen_values,
)
from bulgefit.model.specimen import Prediction

__all__ = ["Universe", "all_folds", "effect_of", "group_keys", "universe"]

Floats = NDArray[np.float64]


@dataclass(eq=False)
class Universe:
    """Normal equations of every parameter of every effect at one fit: forecasts cost nothing.

    Attributes
    ----------
    keys : tuple of str
    hessian : (cells, K, K) array
    gradient : (cells, K) array
    square : (cells,) array
    predictions : list of Prediction
        With derivatives by all keys that are the specimen's.
    """

    keys: tuple[str, ...]
    hessian: Floats
    gradient: Floats
    square: Floats
    predictions: list[Prediction]

    def held_out(self, keys: Sequence[str], folds: Sequence[NDArray[np.int64]]) -> float:
        """Forecast of the held-out sum of squares with `keys` freed, by one linear step."""
        index = [self.keys.index(key) for key in keys]
        part = Regression(
            tuple(keys),
            {},
            self.hessian[:, index][:, :, index],
            self.gradient[:, index],
            self.square,
            np.zeros(len(self.square), dtype=np.int64),
            [],
            1.0,
            True,
        )
        return part.held_out(folds, realised=False)

    def moved(self, changes: Mapping[str, float]) -> Universe:
        """With parameters changed by so much, to first order; predictions are not moved."""
        index = [self.keys.index(key) for key in changes]
        change = np.array(list(changes.values()))
        pull = self.hessian[:, :, index] @ change
        square = self.square - 2.0 * self.gradient[:, index] @ change + pull[:, index] @ change
        return replace(self, gradient=self.gradient - pull, square=square)

    def at(self, keys: Sequence[str]) -> list[Prediction]:
        """The predictions with derivatives by `keys` alone."""
        several, out = len(self.predictions) > 1, []
        for index, p in enumerate(self.predictions):
            names, _ = names_of(self.keys, index, several)
            wanted, _ = names_of(keys, index, several)
            rows = [names.index(name) for name in wanted]
            out.append(Prediction(p.displacement, p.derivative[rows], p.shapes))
        return out


def all_folds(data: Sequence[Data]) -> list[NDArray[np.int64]]:
    """Folds over the cells of all specimens."""
    folds: list[list[NDArray[np.int64]]] = [[] for _ in Blocks.folds(data[0].blocks)]
    first = 0
    for d in data:
        for fold, cells in zip(folds, d.blocks.folds(), strict=True):
            fold.append(cells + first)
        first += d.blocks.count
    return [np.concatenate(fold) for fold in folds]


def group_keys(names: Iterable[str], count: int) -> tuple[str, ...]:
    """Keys of a group of model parameters over `count` specimens."""
    keys: dict[str, None] = {}
    for name in names:
        for index in range(count):
            keys[own_key(name, index, count > 1)] = None
    return tuple(keys)


def universe(
    data: Sequence[Data], fit: Regression, effects: Sequence[Effect], *, fine: bool = False
) -> Universe:
    """Normal equations at a fit, by everything that could be freed.

    With `fine` also by the finest stages, where most of what is left is constant in pressure.
    """
    usable = [e for e in effects if not e.never_separable]
    constant = fine and _is_constant(data, fit)
    names = [n for e in usable for n in e.within_reach(_freed(e, fit.keys), constant=constant)[-1]]
    keys = tuple(dict.fromkeys([*fit.keys, *group_keys([*MODULI, *names], len(data))]))
    predictions = []
    for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True)):
        wanted, _ = names_of(keys, index, len(data) > 1)
        predictions.append(d.specimen.predict(specimen_values(fit.values, index), wanted, p.shapes))
    h, g, square, _ = normal_equations(data, predictions, keys)
    return Universe(keys, h, g, square, predictions)


def _is_constant(data: Sequence[Data], fit: Regression) -> bool:
    """Whether most of the residual is the same in every frame."""
    same, whole = 0.0, 0.0
    for d, p in zip(data, fit.predictions, strict=True):
        residual = d.residual(p)
        frames = np.maximum(d.used.sum(axis=0), 1)
        same += float((residual.sum(axis=0) ** 2 / frames).sum())
        whole += float((residual**2).sum())
    return same > 0.5 * whole


def _freed(effect: Effect, keys: Sequence[str]) -> int:
    """How many of an effect's parameters are among the keys."""
    bare = {key.partition("@")[0] for key in keys}
    return sum(name in bare for name in effect.all_keys)


def effect_of(key: str) -> str:
    """Effect that a freed key belongs to, "" for a modulus."""
    name = key.partition("@")[0].partition(".")[0]
    return name if name in CATALOGUE else ""
