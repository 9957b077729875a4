"""What every step of the search for effects shares: candidates, and what an effect must bring."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from bulgefit.gap.data import Data
from bulgefit.gap.effects import STEADY, Effect
from bulgefit.gap.keys import effect_of, is_field
from bulgefit.gap.regress import Regression
from bulgefit.gap.universe import Universe, universe

__all__ = [
    "GAIN",
    "GAIN_PER_PARAMETER",
    "TIE",
    "TIE_SHARE",
    "Candidate",
    "Groups",
    "Search",
]

#: Effect id to its freed keys.
Groups = dict[str, tuple[str, ...]]

#: Held-out improvement (sum of squares in noise units, correlation allowed for) that an effect
#: must bring, and more for each of its parameters.
GAIN, GAIN_PER_PARAMETER = 14.0, 2.5
#: Effects within this of the best, or within this share of its gain, are not told apart.
TIE, TIE_SHARE = 8.0, 0.01


@dataclass(eq=False)
class Candidate:
    """An effect freed beside what is already in the model.

    Attributes
    ----------
    effect : str
    keys : tuple of str
        The group that was freed.
    fit : Regression
    held_out : float
        Held-out sum of squares over the inflation.
    size : float
        How many parameters the group has.
    """

    effect: str
    keys: tuple[str, ...]
    fit: Regression
    held_out: float
    size: float

    @property
    def score(self) -> float:
        """Held-out misfit with the cost of its parameters."""
        return self.held_out + GAIN_PER_PARAMETER * self.size


@dataclass(frozen=True, eq=False)
class Search:
    """What all rounds share."""

    data: Sequence[Data]
    effects: Sequence[Effect]
    say: Callable[[str], None]

    def candidate(
        self, effect: str, keys: tuple[str, ...], fit: Regression, *, realised: bool = True
    ) -> Candidate:
        """Judge a fit; after first steps alone by where the next would take it."""
        held_out = fit.held_out(realised=realised)
        return Candidate(effect, keys, fit, held_out, self.size(keys))

    def size(self, keys: Iterable[str]) -> float:
        """How many parameters keys stand for.

        An offset of every point has as many as the points have components, less where they are
        correlated.
        """
        total = 0.0
        for key in keys:
            owner = key.partition("@")[2]
            d = self.data[int(owner) if owner else 0]
            total += d.used.any(axis=0).sum() / d.inflation if is_field(key) else 1.0
        return total

    def freed(self, current: Regression, effect: str, keys: Sequence[str]) -> tuple[str, ...]:
        """What is freed once an effect takes a form, in the place of any form it has.

        An offset of every point takes the place of what is the same in every frame.
        """
        freed = (*(k for k in current.keys if effect_of(k) != effect), *keys)
        if not any(is_field(k) for k in freed):
            return freed
        return tuple(k for k in freed if k.partition("@")[0] not in STEADY)

    def grows(self, current: Regression, effect: str, keys: Sequence[str]) -> bool:
        """Whether a form of an effect is larger than the one in the model."""
        return self.size(keys) > self.size(k for k in current.keys if effect_of(k) == effect)

    def universe(self, fit: Regression) -> Universe:
        """Normal equations of everything that could be freed at a fit."""
        return universe(self.data, fit, self.effects)
