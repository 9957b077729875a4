"""How sure is each group? From the evidence of all models that were visited.

A model's probability is its evidence times what it was before any data (`Layout.believed`) over the
sum of the same.

Not all models are visited. Where many groups have no say there would be no end of them, and those
that lack one of the best model's are then missing as those that lack two, three and more of them
are: next to the many others that hold it, it would look sure. So a group is weighed by models that
were visited both with and without it. Of the best model's, what lacks it counts in any case: of
what makes a cause sure nothing may be left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.problem import Model

__all__ = ["SURE", "Weighed", "weighed"]

#: Probability from which a group is sure.
SURE = 0.95


@dataclass(frozen=True, eq=False)
class Weighed:
    """Models and groups with their probabilities.

    Attributes
    ----------
    models : dict of Model to float
        Most probable first.
    groups : dict of Owned to float
        Share of the models that hold the group, in any form.
    """

    models: dict[Model, float]
    groups: dict[Owned, float]

    @property
    def best(self) -> Model:
        """The most probable model."""
        return next(iter(self.models))

    def rivals(self, name: Owned) -> tuple[Owned, ...]:
        """Groups that stand in for one of the best model's that is not sure.

        The fewest, most probable first, of which models without the group hold one, that with it
        make a sure set; none where no such set is sure.
        """
        reached = self.groups[name]
        found: list[Owned] = []
        rest = {model: p for model, p in self.models.items() if name not in dict(model)}
        left = sum(rest.values())
        rest = {model: p * (1.0 - reached) / left for model, p in rest.items()} if left else rest
        while reached < SURE:
            shares = _shares(rest)
            shares = {k: p for k, p in shares.items() if k not in dict(self.best)}
            if not shares:
                return ()
            rival = max(shares, key=lambda k: shares[k])
            found.append(rival)
            reached += shares[rival]
            rest = {model: p for model, p in rest.items() if rival not in dict(model)}
        return tuple(found)


def weighed(scores: Mapping[Model, float], names: Iterable[Owned]) -> Weighed:
    """Probabilities of models by their scores.

    Parameters
    ----------
    scores : mapping of Model to float
        -2 ln of what is in proportion to them (`Search.scores`).
    names : iterable of Owned
        Groups that were candidates; those in no model have probability 0.
    """
    order = sorted(scores, key=lambda model: scores[model])
    raw = np.exp(-0.5 * (np.array([scores[m] for m in order]) - scores[order[0]]))
    models = dict(zip(order, (raw / raw.sum()).tolist(), strict=True))
    found = {*names, *(name for model in models for name, _ in model)}
    return Weighed(models, {name: _paired(models, order[0], name) for name in sorted(found)})


def _paired(models: Mapping[Model, float], best: Model, name: Owned) -> float:
    """Share of a group among models that were visited with and without it."""
    holding, without = 0.0, dict[Model, None]()  # in order: sums are to the same bits
    for model, share in models.items():
        smaller = frozenset(part for part in model if part[0] != name)
        if smaller != model and smaller in models:
            holding += share
            without[smaller] = None
    if name in dict(best):
        lacking = sum(share for model, share in models.items() if name not in dict(model))
    else:
        lacking = sum(models[model] for model in {**without, best: None})
    # without some groups nothing balances
    return holding / (holding + lacking) if holding + lacking else 1.0


def _shares(models: Mapping[Model, float]) -> dict[Owned, float]:
    """Sum of probabilities over the models that hold each group."""
    out: dict[Owned, float] = {}
    for model, share in models.items():
        for name, _ in sorted(model):
            out[name] = min(out.get(name, 0.0) + share, 1.0)
    return out
