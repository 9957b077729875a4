"""What every step of the search for effects shares: candidates, and what an effect must bring."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from bulgefit.effects.base import Effect
from bulgefit.errors import InputError, SolveError
from bulgefit.gap.data import Data
from bulgefit.gap.effects import STEADY
from bulgefit.gap.keys import effect_of, is_field, null_of
from bulgefit.gap.regress import MAX_ITERATIONS, Regression, regress
from bulgefit.gap.universe import Universe, universe
from bulgefit.model.inflation import Shapes
from bulgefit.parallel.spread import spread
from bulgefit.parallel.threads import one_blas_thread

__all__ = [
    "GAIN",
    "GAIN_PER_PARAMETER",
    "TIE",
    "TIE_SHARE",
    "Candidate",
    "Groups",
    "Search",
    "Trial",
]

#: Effect id to its freed keys.
Groups = dict[str, tuple[str, ...]]

#: Values of a fit's parameters, and its shapes without derivatives.
_End = tuple[Mapping[str, float], Sequence[Shapes]]

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
class Trial:
    """A fit to be tried: what it is called, and the parameters that it frees, from where.

    Attributes
    ----------
    name : str
    keys : tuple of str
    start : mapping
    sure : bool
        The start is next to the optimum: it begins there, wherever a fit of these keys ended.
    """

    name: str
    keys: tuple[str, ...]
    start: Mapping[str, float]
    sure: bool = False


@dataclass(frozen=True, eq=False)
class Search:
    """What all rounds share: tests, candidates, who refits side by side, and who is told.

    Where a fit of some keys ended is remembered: the next one of the same keys starts there.
    """

    data: Sequence[Data]
    effects: Sequence[Effect]
    executor: Executor
    say: Callable[[str], None]
    _ends: dict[frozenset[str], _End] = field(default_factory=dict)

    def fits(
        self, near: Regression, trials: Sequence[Trial], steps: int = MAX_ITERATIONS
    ) -> list[Regression | None]:
        """Trials fitted to the end, or so many steps, beginning near another fit.

        None where nothing balances.
        """
        found = spread(
            self.executor,
            _fit,
            (self.data, [p.shapes for p in near.predictions], steps),
            [
                (t.keys, t.start, None if t.sure else self._ends.get(frozenset(t.keys)))
                for t in trials
            ],
            lambda index, _: self.say(trials[index].name),
        )
        for fit in found:
            if fit is not None:
                self.remember(fit)
        return found

    def remember(self, fit: Regression) -> None:
        """The next fit of these keys starts where this one ended."""
        shapes = [replace(p.shapes, derivative={}) for p in fit.predictions]
        self._ends[frozenset(fit.keys)] = fit.values, shapes

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

    def loss_without(self, fit: Regression, dropped: Collection[str]) -> float:
        """What a fit would lose on held-out data without some of its keys, by one linear step."""
        if any(is_field(k) for k in dropped):
            return np.inf
        gone = [k for k in fit.columns if k in dropped]
        change = np.array([null_of(k, self.data) - fit.values[k] for k in gone])
        without = fit.normal.moved([fit.columns.index(k) for k in gone], change).of(
            [place for place, k in enumerate(fit.columns) if k not in dropped]
        )
        return without.held_out(realised=False) / fit.inflation - fit.held_out()

    def universe(self, fit: Regression) -> Universe:
        """Normal equations of everything that could be freed at a fit."""
        return universe(self.data, fit, self.effects)


def _fit(
    here: tuple[Sequence[Data], Sequence[Shapes], int],
    item: tuple[Sequence[str], Mapping[str, float], _End | None],
) -> Regression | None:
    """Keys fitted from a start, or from where such a fit ended before.

    With the data, the shapes of a fit near the start, and how many steps.
    """
    data, near, steps = here
    keys, start, end = item
    try:
        with one_blas_thread():
            return regress(data, keys, *(end or (start, near)), steps)
    except (SolveError, InputError):
        return None
