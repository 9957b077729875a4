"""What every step of the search for effects shares: candidates, and what an effect must bring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.effects import Effect
from bulgefit.gap.regress import Data, Regression
from bulgefit.gap.universe import Universe, universe

__all__ = [
    "GAIN",
    "GAIN_PER_PARAMETER",
    "TIE",
    "TIE_SHARE",
    "Candidate",
    "Groups",
    "Run",
    "Search",
]

#: Effect id to its freed keys.
Groups = dict[str, tuple[str, ...]]
#: Maps a task over items, in order.
Run = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]

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
    """

    effect: str
    keys: tuple[str, ...]
    fit: Regression
    held_out: float

    @property
    def score(self) -> float:
        """Held-out misfit with the cost of its parameters."""
        return self.held_out + GAIN_PER_PARAMETER * len(self.keys)


@dataclass(frozen=True, eq=False)
class Search:
    """What all rounds share; `thorough` searches try the finest stages of flexible effects."""

    data: Sequence[Data]
    effects: Sequence[Effect]
    folds: Sequence[NDArray[np.int64]]
    say: Callable[[str], None]
    run: Run
    thorough: bool = False

    def candidate(
        self, effect: str, keys: tuple[str, ...], fit: Regression, *, realised: bool = True
    ) -> Candidate:
        """Judge a fit; after first steps alone by where the next would take it."""
        held_out = fit.held_out(self.folds, realised=realised) / fit.inflation
        return Candidate(effect, keys, fit, held_out)

    def universe(self, fit: Regression) -> Universe:
        """Normal equations of everything that could be freed at a fit."""
        return universe(self.data, fit, self.effects, fine=self.thorough)
