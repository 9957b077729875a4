"""Which change of a model raises the evidence? Drops, growths, additions and swaps.

Every change is forecast in the normal equations of all coordinates (`laplace`), where it costs no
solve; what looks best is refitted, and what was refitted is what counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.hidden import handed_over
from bulgefit.gap.evidence.neighbours import larger, neighbours, smaller
from bulgefit.gap.evidence.problem import Linearised, Model
from bulgefit.gap.evidence.search import Search

__all__ = ["improved", "promise"]

#: Refits, best forecast first, that may fail to raise the evidence before no change is held to.
TRIES = 3


def improved(
    search: Search[Any],
    fit: Fit,
    fewer: int | None = None,
    *,
    to_noise: bool = False,
    keep: Owned | None = None,
) -> Fit:
    """A fit from which no drop, growth, addition or swap that was tried raises the evidence.

    Parameters
    ----------
    search : Search
    fit : Fit
        Where it begins.
    fewer : int, optional
        Go no further by models of so many groups, unless one is the best of all; nor where as
        many changes as are left, the best of them together, lead to no better one. What one
        change gains after another falls, as a rule (Das and Kempe, 2011, "Submodular meets
        spectral").
    to_noise : bool
        The better one is one that leaves the noise alone, whatever the best one leaves.
    keep : Owned, optional
        Only by models that have this group, in one of its forms.
    """
    noise = search.problem.noise if to_noise else np.inf
    while fewer is None or len(fit.model) < fewer or fit is search.best:
        if (less := _thinned(search, fit, keep)) is not None:
            fit = less
            continue
        if (around := search.seen_around(fit)) is None:
            break
        ahead = fewer - len(fit.model) if fewer is not None else None
        if fit is search.best and not to_noise:
            ahead = None
        better = _changed(search, fit, around, ahead, noise, keep)
        better = better or _renewed(search, fit, around)
        if better is None:
            break
        fit = better
    return fit


def promise(search: Search[Any], fit: Fit) -> float:
    """Score of what is left when all is taken out that the forecast can do without."""
    return _path(search, fit)[1]


def _thinned(search: Search[Any], fit: Fit, keep: Owned | None = None) -> Fit | None:
    """With all that the forecast can do without taken out; with less if that was wrong.

    But for a group that is to be kept in one of its forms. The fit's own coordinates tell that: it
    is looked around in, which costs a solve, where nothing is to go.
    """
    path = _path(search, fit, keep)[0]
    reach = len(path) - 1
    while reach > 0:
        found = search.refit(path[reach], fit.here, fit)
        if found is not None and found.score < fit.score:
            return found
        reach //= 2
    return None


def _path(search: Search[Any], fit: Fit, keep: Owned | None = None) -> tuple[list[Model], float]:
    """Ever smaller models, as long as the forecast evidence rises, and that of the last."""
    path = [fit.model]
    while True:
        forecast = search.forecasts(fit.here, path[-1])
        score = forecast(path[-1])
        less = smaller(search.layout, path[-1])
        options = [(forecast(m), m) for m in less if keep is None or keep in dict(m)]
        if not options or (best := min(options, key=lambda o: o[0]))[0] >= score:
            return path, score
        path.append(best[1])


def _changed(
    search: Search[Any],
    fit: Fit,
    around: Linearised,
    changes: int | None = None,
    goal: float = np.inf,
    keep: Owned | None = None,
) -> Fit | None:
    """With the change that raises the evidence, of those that are forecast to do so most.

    Where several specimens are to change, the best change of each at once, if that does. None,
    too, where so many `changes` of the forecast gain reach neither the best model nor the goal
    below it.
    """
    forecast_of = search.forecasts(around, fit.model)
    here = forecast_of(fit.model)
    options = []
    for model in neighbours(search.layout, search.names, fit.model):
        if keep is not None and keep not in dict(model):
            continue
        if (known := search.fits.get(model)) is not None:
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
        most = _most_gained(fit.model, [(here - score, model) for score, model in options], changes)
        if fit.score - most > min(search.best.score, goal):
            return None
    together = _of_each_specimen(fit.model, options)
    if together is not None and (changes is None or len(together) - len(fit.model) <= changes):
        forecast = forecast_of(together)
        tried = [(forecast, together)] * (forecast < tried[0][0]) + tried
    for _, model in tried:
        found = search.refit(model, around, fit)
        if found is not None and found.score < fit.score:
            return found
    return None


def _most_gained(model: Model, options: Iterable[tuple[float, Model]], changes: int) -> float:
    """What so many changes of a model gain at most, of other groups each, by what each gains alone.

    None gains more after others than before them, as a rule.
    """
    best = dict[Owned, float]()
    for gain, other in options:
        name = min(other - model or model - other)[0]  # of two forms either one
        best[name] = max(gain, best.get(name, 0.0))
    return sum(sorted(best.values(), reverse=True)[:changes])


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


def _renewed(search: Search[Any], fit: Fit, around: Linearised) -> Fit | None:
    """What the best model is changed to by more than one change, once for each model."""
    if fit is not search.best or fit.model in search.renewed:
        return None
    search.renewed.add(fit.model)
    turned = _replaced(search, fit, around) or _turned(search, fit, around)
    return turned or _uncovered(search, fit, around)


def _replaced(search: Search[Any], fit: Fit, around: Linearised) -> Fit | None:
    """With one group, or a larger form of one, in the place of several that stand for it.

    Beside them it gains nothing, and in the place of one of them it loses: that it is let go itself
    would be the best of all drops.
    """
    forecast_of = search.forecasts(around, fit.model)
    found = dict[Model, float]()
    for grown in larger(search.layout, search.names, fit.model):
        new = grown - fit.model
        model, score = grown, forecast_of(grown)
        while options := [(forecast_of(m), m) for m in smaller(search.layout, model) if new <= m]:
            best = min(options, key=lambda o: o[0])
            if best[0] >= score:
                break
            score, model = best
        if len(set(dict(fit.model)) - set(dict(model))) > 1 and model not in search.fits:
            found[model] = score
    here = forecast_of(fit.model)
    for model in sorted(found, key=lambda m: found[m])[:TRIES]:
        if found[model] < here:
            better = search.refit(model, around, fit)
            if better is not None and better.score < fit.score:
                return better
    return None


def _turned(search: Search[Any], fit: Fit, around: Linearised) -> Fit | None:
    """The best model, if it does better from another side of what is periodic.

    What a group does from one side others may do beside what it does from the opposite one,
    and every step between is worse. In its largest form: of two sides that do as well in a
    smaller one, the larger one tells the right one.
    """
    for name, at in search.layout.turning(fit.model):
        whole = search.layout.whole([name]) | {(n, f) for n, f in fit.model if n != name}
        hope = search.hoped(fit, whole, around)
        for start in search.layout.sides(fit.x, at, (4, 2, 6)):
            # what it does from there, be it no better than from where it was fitted before: noise
            # decides which of two sides leaves less, and the right one needs fewer groups beside
            found = replace(search, fits={}).fit(whole, start, hope=hope)
            if found is not None and promise(search, found) < fit.score:
                better = _rid(search, found)
                if better.score < fit.score:
                    search.take(better)
                    return better
    return None


def _uncovered(search: Search[Any], fit: Fit, around: Linearised) -> Fit | None:
    """The best model with a group in the place of what one of its own does like it.

    Where that one hides it no forecast sees it, since its second order alone is its own; but
    that may be what others in the model stand for.
    """
    for name, by in search.layout.hidden(fit.model):
        if name not in search.names:
            continue
        whole = fit.model | search.layout.whole([name])
        own = search.layout.own(by, dict(fit.model)[by])
        start = handed_over(around, search.layout, own, name)
        found = search.fit(whole, start, fit.here.near)
        if found is not None:
            better = _rid(search, found, keep=name)
            if better.score < fit.score:
                return better
    return None


def _rid(search: Search[Any], fit: Fit, keep: Owned | None = None) -> Fit:
    """A fit, or the better one that is rid of what it does not need."""
    return _thinned(search, fit, keep) or fit
