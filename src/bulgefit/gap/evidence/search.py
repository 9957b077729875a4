"""Which model near one has more evidence? Drops, growths, additions and swaps.

Every change is forecast in the normal equations of all coordinates (`laplace`), where it costs no
solve; what looks best is refitted, and what was refitted is what counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.errors import SolveError
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.forecast import Forecast
from bulgefit.gap.evidence.hidden import handed_over
from bulgefit.gap.evidence.laplace import laplace
from bulgefit.gap.evidence.neighbours import larger, neighbours, smaller, swapped
from bulgefit.gap.evidence.problem import Layout, Linearised, Model, Problem
from bulgefit.parallel.journal import kept

__all__ = ["GROWN", "Search"]

Kind = TypeVar("Kind", bound=Problem)

Floats = NDArray[np.float64]

#: Refits, best forecast first, that may fail to raise the evidence before no change is held to.
TRIES = 3
#: Of the best model's probability, below which a model is not looked around in, and has no say; and
#: by how much more its -2 ln Z is then.
LEAST_SHARE = 1e-3
_REACH = 2.0 * np.log(1.0 / LEAST_SHARE)
#: Models of a generation beyond which they are not looked around in: with sixty groups and more
#: that would take tens of thousands of forecasts.
MOST_ALIKE = 300
#: Of the misfit beyond the noise: what a step gains below it does not say which group comes next,
#: when that takes off many times as much; nor is it worth a solve before units are fixed anew.
GROWN = 0.01


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
    """

    problem: Kind
    layout: Layout
    names: tuple[Owned, ...]
    say: Callable[[str], None] = lambda _: None
    fits: dict[Model, Fit] = field(default_factory=dict)
    roughly: bool = False
    share: float = 0.0
    renewed: set[Model] = field(default_factory=set)
    looked: list[tuple[Kind, tuple[Owned, ...], Fit, Linearised]] = field(default_factory=list)

    @property
    def best(self) -> Fit:
        """The fitted model with the most evidence."""
        return min(self.fits.values(), key=lambda fit: fit.score)

    @property
    def noise(self) -> float:
        """What noise alone leaves of |r|²/v."""
        return self.problem.count / self.problem.inflation

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
        self.say(" + ".join(str(name) for name, _ in sorted(model)) or "the moduli alone")
        try:
            found = kept(
                lambda: descend(
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
            )
        except SolveError:
            return self.fits.get(model)
        known = self.fits.get(model)
        if known is None or found.score < known.score:
            before = self.best if self.fits else found
            self.fits[model] = found
            self._let_go(before if found.score < before.score else found)
        return self.fits[model]

    def _let_go(self, fit: Fit) -> None:
        """What only makes a neighbour's solve sooner, of a fit that is not the best of all."""
        if fit is not self.best and self.fits.get(fit.model) is fit:
            self.fits[fit.model] = fit.lighter(self.problem)

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
        for _, at in self.layout.turning(whole - self._of(fit.model)):
            x = min(self.layout.sides(x, at), key=partial(self._left, fit, int(at)))
        columns = self.layout.columns(whole)
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

    def _left(self, fit: Fit, at: int, x: Floats) -> float:
        """What a coordinate's governor takes off the misfit from one side, less than nothing."""
        governor = self.layout.governor[[at]]
        try:
            here = self.problem.linearise(x, governor, fit.here.near)
        except SolveError:
            return 0.0
        return -float(np.maximum(here.gradient[0], 0.0) ** 2 / here.hessian[0, 0])

    def improved(self, fit: Fit, fewer: int | None = None, *, to_noise: bool = False) -> Fit:
        """A fit from which no drop, growth, addition or swap that was tried raises the evidence.

        Parameters
        ----------
        fewer : int, optional
            Go no further by models of so many groups, unless one is the best of all; nor where as
            many changes as are left, each as good as the next one, lead to no better one. What one
            change gains after another falls, as a rule (Das and Kempe, 2011, "Submodular meets
            spectral").
        to_noise : bool
            The better one is one that leaves the noise alone, whatever the best one leaves.
        """
        noise = self.noise if to_noise else np.inf
        while fewer is None or len(fit.model) < fewer or fit is self.best:
            if (around := self.seen_around(fit)) is None:
                break
            ahead = fewer - len(fit.model) if fewer is not None else None
            if fit is self.best and not to_noise:
                ahead = None
            better = self._thinned(fit, around) or self._changed(fit, around, ahead, noise)
            better = better or self._renewed(fit, around)
            if better is None:
                break
            fit = better
        return fit

    def hoped(self, fit: Fit, model: Model, here: Linearised) -> float:
        """|r|²/v + Σ((x - n)/s)² by which a model has a thousandth of a fit's probability.

        What does not come down to that has no say, and need not be fitted to its end. With the
        covariance that it has by the misfit `here`, and all of its posterior above the bounds:
        where a linear step leads far below one the optimum is on it.
        """
        columns, inflation = self.layout.columns(model), self.problem.inflation
        volume = laplace(here, self.layout, columns, inflation).volume
        return fit.score + _REACH - volume - self.layout.believed(model)

    def scores(self, temper: float) -> dict[Model, float]:
        """Of every model that was fitted, and of those whose share counts by forecast.

        -2 ln of its probability, but for what is common to all.

        Looked around in is what holds more than a thousandth of the best one's probability: drops
        from it, generation by generation, swaps in it, then a growth of each of these, and of what
        that leads to. (Where one group may stand for another, neither that one's drop nor a growth
        has a share.) A generation is gone through as a whole or not at all, so that its growths are
        there with and without each group. Where differences count for little (a large temper) there
        would be no end of them, by groups that have no say. What is only forecast counts for no
        more than the best of what was fitted.

        Parameters
        ----------
        temper : float
            By which differences of the evidence are divided (`temper`): what the residual's smooth
            modes hold over what correlated noise would. A model that misses by more than the noise
            is thus as sure as the noise that it leaves lets it be.
        """
        best = self.best

        def tempered(model: Model, score: float) -> float:
            before = self.layout.believed(model)
            return (score - before) / temper + before

        known = {model: tempered(model, fit.score) for model, fit in self.fits.items()}
        if (around := self.seen_around(best)) is None:
            return known
        forecast = self.forecasts(around, best.model)
        reach = known[best.model] + _REACH

        def within(models: Iterable[Model]) -> list[Model]:
            new = [m for m in dict.fromkeys(models) if m not in gone]
            gone.update(new)
            for m in new:
                if m not in known:
                    known[m] = max(tempered(m, forecast(m)), known[best.model])
            return [m for m in new if known[m] < reach]

        gone = {best.model}
        parts, last = list[Model](), [best.model]
        while 0 < len(last) <= MOST_ALIKE:
            parts += last
            last = within(m for model in last for m in smaller(self.layout, model))
        others = within(swapped(self.layout, self.names, best.model))
        parts += others if len(others) <= MOST_ALIKE else []
        grown = within(m for model in parts for m in larger(self.layout, self.names, model))
        while 0 < len(grown) <= MOST_ALIKE:
            grown = within(m for model in grown for m in larger(self.layout, self.names, model))
        return known

    def _thinned(self, fit: Fit, around: Linearised, keep: Owned | None = None) -> Fit | None:
        """With all that the forecast can do without taken out; with less if that was wrong.

        But for a group that is to be kept in one of its forms.
        """
        path = self._path(fit.model, around, keep)[0]
        reach = len(path) - 1
        while reach > 0:
            found = self._refit(path[reach], around, fit)
            if found is not None and found.score < fit.score:
                return found
            reach //= 2
        return None

    def promise(self, fit: Fit) -> float:
        """Score of what is left when all is taken out that the forecast can do without."""
        around = self.seen_around(fit)
        return fit.score if around is None else self._path(fit.model, around)[1]

    def _path(
        self, model: Model, around: Linearised, keep: Owned | None = None
    ) -> tuple[list[Model], float]:
        """Ever smaller models, as long as the forecast evidence rises, and that of the last."""
        path = [model]
        while True:
            forecast = self.forecasts(around, path[-1])
            score = forecast(path[-1])
            less = smaller(self.layout, path[-1])
            options = [(forecast(m), m) for m in less if keep is None or keep in dict(m)]
            if not options or (best := min(options, key=lambda o: o[0]))[0] >= score:
                return path, score
            path.append(best[1])

    def _changed(
        self, fit: Fit, around: Linearised, changes: int | None = None, goal: float = np.inf
    ) -> Fit | None:
        """With the change that raises the evidence, of those that are forecast to do so most.

        Where several specimens are to change, the best change of each at once, if that does. None,
        too, where so many `changes` of the forecast gain reach neither the best model nor the goal
        below it.
        """
        forecast_of = self.forecasts(around, fit.model)
        here = forecast_of(fit.model)
        options = []
        for model in neighbours(self.layout, self.names, fit.model):
            if (known := self.fits.get(model)) is not None:
                if known.score < fit.score:
                    return known
                continue
            forecast = forecast_of(model)
            if forecast < here:
                options.append((forecast, model))
        if not options:
            return None
        tried = sorted(options, key=lambda o: o[0])[:TRIES]
        if changes is not None:
            gain = here - tried[0][0]
            if fit.score - changes * gain > min(self.best.score, goal):
                return None
        elif (together := _of_each_specimen(fit.model, options)) is not None:
            forecast = forecast_of(together)
            tried = [(forecast, together)] * (forecast < tried[0][0]) + tried
        for _, model in tried:
            found = self._refit(model, around, fit)
            if found is not None and found.score < fit.score:
                return found
        return None

    def _renewed(self, fit: Fit, around: Linearised) -> Fit | None:
        """What the best model is changed to by more than one change, once for each model."""
        if fit is not self.best or fit.model in self.renewed:
            return None
        self.renewed.add(fit.model)
        turned = self._replaced(fit, around) or self._turned(fit, around)
        return turned or self._uncovered(fit, around)

    def _replaced(self, fit: Fit, around: Linearised) -> Fit | None:
        """With one group in the place of several that stand for it.

        Beside them it gains nothing, and in the place of one of them it loses.
        """
        forecast_of = self.forecasts(around, fit.model)
        found = dict[Model, float]()
        for grown in larger(self.layout, self.names, fit.model):
            model, score = grown, forecast_of(grown)
            while options := [(forecast_of(m), m) for m in smaller(self.layout, model)]:
                best = min(options, key=lambda o: o[0])
                if best[0] >= score:
                    break
                score, model = best
            if len(set(dict(fit.model)) - set(dict(model))) > 1 and model not in self.fits:
                found[model] = score
        here = forecast_of(fit.model)
        for model in sorted(found, key=lambda m: found[m])[:TRIES]:
            if found[model] < here:
                better = self._refit(model, around, fit)
                if better is not None and better.score < fit.score:
                    return better
        return None

    def _turned(self, fit: Fit, around: Linearised) -> Fit | None:
        """The best model, if it does better from another side of what is periodic.

        What a group does from one side others may do beside what it does from the opposite one,
        and every step between is worse. In its largest form: of two sides that do as well in a
        smaller one, the larger one tells the right one.
        """
        for name, at in self.layout.turning(fit.model):
            whole = self.layout.whole([name]) | {(n, f) for n, f in fit.model if n != name}
            hope = self.hoped(fit, whole, around)
            for start in list(self.layout.sides(fit.x, at))[1:]:
                # what it does from there, be it no better than from where it was fitted before
                found = replace(self, fits={}).fit(whole, start, hope=hope)
                if found is not None and found.here.square <= fit.here.square:
                    better = self._rid(found)
                    if better.score < fit.score:
                        return better
        return None

    def _uncovered(self, fit: Fit, around: Linearised) -> Fit | None:
        """The best model with a group in the place of what one of its own does like it.

        Where that one hides it no forecast sees it, since its second order alone is its own; but
        that may be what others in the model stand for.
        """
        for name, by in self.layout.hidden(fit.model):
            if name not in self.names:
                continue
            whole = fit.model | self.layout.whole([name])
            own = self.layout.own(by, dict(fit.model)[by])
            start = handed_over(around, self.layout, own, name, self.problem.inflation)
            found = self.fit(whole, start, fit.here.near)
            if found is not None:
                better = self._rid(found, keep=name)
                if better.score < fit.score:
                    return better
        return None

    def _rid(self, fit: Fit, keep: Owned | None = None) -> Fit:
        """A fit, or the better one that is rid of what it does not need."""
        around = self.seen_around(fit)
        return (None if around is None else self._thinned(fit, around, keep)) or fit

    def _refit(self, model: Model, around: Linearised, fit: Fit) -> Fit | None:
        """In the place of a fit: from where the linear step leads, or from where one stands."""
        columns = self.layout.columns(model)
        known = self.fits.get(model)
        if known is not None:
            return known
        ahead = laplace(around, self.layout, columns, self.problem.inflation)
        hope = self.hoped(fit, model, around)
        found = self.fit(model, ahead.x, around.near, hope=hope)
        return found if found is not None else self.fit(model, around.x, around.near, hope=hope)

    def forecasts(self, around: Linearised, model: Model) -> Callable[[Model], float]:
        """Scores of models near one, by the misfit near a fit."""
        layout = self.layout
        found = Forecast.of(around, layout, layout.columns(model), self.problem.inflation)
        return lambda other: found.score(layout.columns(other)) + layout.believed(other)


def _of_each_specimen(model: Model, options: Iterable[tuple[float, Model]]) -> Model | None:
    """A model with the best change of each specimen's groups, of some with their forecast scores.

    None where one specimen alone has any. Specimens are told by data of their own: but for what
    they share, gains of their changes add up.
    """
    best = dict[int | None, Model]()
    for _, other in sorted(options, key=lambda o: o[0]):
        change = model ^ other
        owners = {name.specimen for name, _ in change}
        if len(owners) == 1:
            best.setdefault(owners.pop(), change)
    if len(best) < 2:
        return None
    return model ^ frozenset(chain.from_iterable(best.values()))
