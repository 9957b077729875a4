"""What was found of the models of a problem, and what does it forecast of others?"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.errors import SolveError
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.forecast import Forecast
from bulgefit.gap.evidence.laplace import laplace
from bulgefit.gap.evidence.problem import Layout, Linearised, Model, Problem
from bulgefit.gap.evidence.sides import best_side
from bulgefit.gap.evidence.told import told
from bulgefit.parallel.journal import kept
from bulgefit.parallel.memory import give_back
from bulgefit.parallel.spread import spread
from bulgefit.parallel.threads import pool_of

__all__ = ["GROWN", "REACH", "Search"]

Kind = TypeVar("Kind", bound=Problem)
Shared = TypeVar("Shared")
Item = TypeVar("Item")

Floats = NDArray[np.float64]

#: Of the best model's probability, below which a model is not looked around in, and has no say; and
#: by how much more its -2 ln Z is then.
LEAST_SHARE = 1e-3
REACH = 2.0 * np.log(1.0 / LEAST_SHARE)
#: Of the misfit beyond the noise: what a step gains below it does not say which group comes next,
#: when that takes off many times as much; nor is it worth a solve before units are fixed anew.
GROWN = 0.01


def _nothing(what: str) -> None:
    """Nobody is told; as a process may be sent it."""


@dataclass(eq=False)
class Search(Generic[Kind]):
    """Models of a problem, and what was found of them.

    Attributes
    ----------
    problem : Problem
    layout : Layout
    names : tuple of Owned
        Groups that may be freed.
    say : callable
        Told what is tried.
    before : Model
        That which it was told last.
    fits : dict of Model to Fit
        Every model that was fitted, at its best.
    roughly : bool
        Fit no closer than others may start from.
    share : float
        End fits where a step gains less than this share of the misfit beyond the noise.
    renewed : set of Model
        Those from which one group was tried in the place of several, and other sides of what is
        periodic.
    looked : list of (Problem, names, Fit, Linearised)
        Where the search looked around last, which it is asked for more than once.
    executor : concurrent.futures.Executor, optional
        Of searches that do not wait for each other; default: this process.
    """

    problem: Kind
    layout: Layout
    names: tuple[Owned, ...]
    say: Callable[[str], None] = _nothing
    before: Model = frozenset()
    fits: dict[Model, Fit] = field(default_factory=dict)
    roughly: bool = False
    share: float = 0.0
    renewed: set[Model] = field(default_factory=set)
    looked: list[tuple[Kind, tuple[Owned, ...], Fit, Linearised]] = field(default_factory=list)
    executor: Executor | None = None

    @property
    def best(self) -> Fit:
        """The fitted model with the most evidence."""
        return min(self.fits.values(), key=lambda fit: fit.score)

    def fit(
        self,
        model: Model,
        start: Floats,
        near: object = None,
        *,
        roughly: bool = False,
        hope: float | None = None,
        doubted: bool = False,
    ) -> Fit | None:
        """A model fitted from a start, or as it was fitted before if that was better.

        None where nothing balances. `hope` and `doubted` are what `descend` may be stopped by.
        """
        self.say(told(model, self.before))
        self.before = model

        def work() -> Fit | None:
            try:
                found = descend(
                    self.problem,
                    self.layout,
                    model,
                    start,
                    near,
                    roughly=roughly or self.roughly,
                    share=self.share,
                    hope=hope,
                    doubted=doubted,
                )
            except SolveError:
                return None
            return (
                found.rounded(self.problem) if self._leads(found) else found.lighter(self.problem)
            )

        if (found := kept(work)) is not None:
            self.take(found)
        return self.fits.get(model)

    def take(self, found: Fit) -> None:
        """Keep a fit where none of its model was better."""
        known = self.fits.get(found.model)
        if known is None or found.score < known.score:
            if self.fits and self._leads(found):  # what led does not any more
                self.fits[self.best.model] = self.best.lighter(self.problem)
            self.fits[found.model] = found

    def alone(self, known: Iterable[Model] = ()) -> Search[Kind]:
        """The same from its best model on, with what is known of a few others.

        It has nothing in common with this one, so that it may go on in another process.
        """
        models = {self.best.model, *known} & self.fits.keys()
        return replace(
            self,
            problem=self.problem.afresh(),
            say=_nothing,
            fits={model: self.fits[model] for model in sorted(models, key=sorted)},
            renewed=set(self.renewed),
            looked=[],
            executor=None,
        )

    def abreast(
        self,
        task: Callable[[Shared, Item], list[Fit]],
        shared: Shared,
        items: Sequence[Item],
    ) -> None:
        """Keep the fits that each task found, in their order, whoever did them."""
        some = self.executor if len(items) > 1 else None  # one is no sooner done elsewhere
        if some is not None:
            give_back()  # what is free here is memory that workers need
        with pool_of(1) if some is None else nullcontext(some) as executor:
            for found in spread(executor, task, shared, items):
                for fit in found:
                    self.take(fit)

    def _leads(self, fit: Fit) -> bool:
        """Whether a fit is better than all.

        What only makes a neighbour's solve sooner is kept of it alone, and to the digits that this
        takes: with hundreds of coordinates that is more than all else.
        """
        return not self.fits or fit.score < self.best.score

    def around(self, fit: Fit) -> Linearised:
        """The misfit at a fit by every coordinate that may be freed.

        What is periodic, and means nothing in the model, stands at the side from which its group
        takes off most.

        Raises
        ------
        SolveError
            Nothing balances beside it: a fit may end on the edge of stability.
        """
        for problem, names, of, around in self.looked:
            same = problem is self.problem and names == self.names and of.model == fit.model
            if same and np.array_equal(of.x, fit.x):
                return around
        whole, x = self.layout.whole(self.names), fit.x
        columns = self.layout.columns(whole)
        with self.problem.remembering():
            for _, at in self.layout.turning(whole - self._of(fit.model)):
                x, _ = best_side(self.problem, self.layout, x, at, fit.here.near)
            if x is fit.x and np.array_equal(columns, fit.here.columns):
                return fit.here
            self.looked.clear()  # with all fields free one is as much memory as all else
            found = self.problem.linearise(x, columns, fit.here.near).light()
        found = replace(found, near=self.problem.rounded(found.near))
        self.looked.append((self.problem, self.names, fit, found))
        return found

    def seen_around(self, fit: Fit) -> Linearised | None:
        """`around`, or None where nothing balances beside a fit."""
        with suppress(SolveError):
            return self.around(fit)
        return None

    def _of(self, model: Model) -> Model:
        """The groups of a model in their largest form."""
        return self.layout.whole(dict(model))

    def hoped(self, fit: Fit, model: Model, here: Linearised) -> float:
        """|r|² + Σ((x - n)/s)² by which a model has a thousandth of a fit's probability.

        What does not come down to that has no say, and need not be fitted to its end. With the
        covariance that it has by the misfit `here`, and all of its posterior above the bounds:
        where a linear step leads far below one the optimum is on it.
        """
        volume = laplace(here, self.layout, self.layout.columns(model)).volume
        return fit.score + REACH - volume - self.layout.believed(model)

    def refit(self, model: Model, around: Linearised, fit: Fit) -> Fit | None:
        """In the place of a fit: from where the linear step leads, or from where one stands."""
        columns = self.layout.columns(model)
        known = self.fits.get(model)
        if known is not None:
            return known
        ahead = laplace(around, self.layout, columns)
        hope = self.hoped(fit, model, around)
        found = self.fit(model, ahead.x, around.near, hope=hope)
        return found if found is not None else self.fit(model, around.x, around.near, hope=hope)

    def forecasts(self, around: Linearised, model: Model) -> Callable[[Model], float]:
        """Scores of models near one, by the misfit near a fit."""
        layout = self.layout
        found = Forecast.of(around, layout, layout.columns(model))
        return lambda other: found.score(layout.columns(other)) + layout.believed(other)
