"""How sure is each group? From the evidence of all models that were visited.

A model's probability is exp(-score/2T) over the sum of the same, its score being -2 ln Z and T the
temper: what the residual's smooth modes hold over what correlated noise would (`temper`). A model
that misses by more than the noise is thus as sure as the noise that it leaves lets it be.
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
        Sum over the models that hold the group, in any form.
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


def weighed(scores: Mapping[Model, float], temper: float, names: Iterable[Owned]) -> Weighed:
    """Probabilities of models by their scores, -2 ln Z.

    Parameters
    ----------
    scores : mapping of Model to float
        Fitted, or forecast where they were not.
    temper : float
        1 or more.
    names : iterable of Owned
        Groups that were candidates; those in no model have probability 0.
    """
    order = sorted(scores, key=lambda model: scores[model])
    raw = np.exp(-0.5 * (np.array([scores[m] for m in order]) - scores[order[0]]) / temper)
    models = dict(zip(order, (raw / raw.sum()).tolist(), strict=True))
    return Weighed(models, {**dict.fromkeys(names, 0.0), **_shares(models)})


def _shares(models: Mapping[Model, float]) -> dict[Owned, float]:
    """Sum of probabilities over the models that hold each group."""
    out: dict[Owned, float] = {}
    for model, share in models.items():
        for name, _ in sorted(model):
            out[name] = min(out.get(name, 0.0) + share, 1.0)
    return out
