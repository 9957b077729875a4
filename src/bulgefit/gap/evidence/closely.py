"""The best model as near as can be, and without each of its groups: would another do?"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.improve import improved
from bulgefit.gap.evidence.laplace import laplace
from bulgefit.gap.evidence.neighbours import larger, smaller
from bulgefit.gap.evidence.problem import Layout, Linearised, Model, Problem, freeze
from bulgefit.gap.evidence.search import GROWN, Search
from bulgefit.parallel.journal import kept
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["closely"]

Kind = TypeVar("Kind", bound=Problem)

#: Smaller models that are fitted before it is seen whether one of them is the best: as many as
#: machines have cores, whatever the number of workers.
_ABREAST = 8


def closely(
    search: Search[Kind], instead: Collection[Owned] | None = None, *, without_each: bool = True
) -> None:
    """The best model as near as can be, and what raises the evidence from there.

    Forecasts from a rough fit see to the bottom of a valley that is straight: parameters that are
    at their nulls at the bottom of a bent one may look needed.

    Parameters
    ----------
    search : Search
    instead : collection of Owned, optional
        Groups that are tried in the place of one that is gone; default: all.
    without_each : bool
        Fit it without each of its groups as well.
    """
    problem, layout = search.problem, search.layout
    close, fit = replace(search, roughly=False), search.best
    settled, last = False, None  # whether `fit` is the best model as near as can be
    tried = set[Model]()
    while True:
        best = search.best
        if not settled or (best.model, best.score) != (fit.model, fit.score):
            found = kept(partial(descend, problem, layout, best.model, best.x, best.here.near))
            # a rough fit of a model may promise more than is there
            known = settled and found.model == fit.model and fit.score <= found.score
            search.fits[found.model] = fit if known else found
            if search.best is found:
                fit, settled, tried = found, True, set()
                improved(close, fit)
            continue
        search.fits[fit.model] = fit
        left = [m for m in _drops(search.layout, fit, last) if m not in tried]
        if not (without_each and left):
            break
        tried.update(some := left[:_ABREAST])
        last = _changed(fit, some[-1])
        search.say(f"without {len(tried)} of its parts or forms, {len(left) - len(some)} to come")
        own = {*(search.names if instead is None else instead), *dict(fit.model)}
        names = tuple(n for n in search.names if n in own)
        rough = replace(search, roughly=True, share=GROWN, names=names, looked=[])
        search.abreast(_without, (rough.alone(some), fit), some)


def _drops(layout: Layout, fit: Fit, last: Owned | None) -> list[Model]:
    """Smaller models than a fit's, to be fitted.

    They go round by name, from the group on that was the last to go: what was tried from the model
    before comes after what was not.

    A group may hold the others in a valley that none of them would stay in: what they would do
    without it is on the other side, and no forecast sees it. Nor does one see what would do in the
    place of a group far from where that is absent.
    """
    return sorted(
        smaller(layout, fit.model), key=lambda m: last is not None and _changed(fit, m) <= last
    )


def _changed(fit: Fit, model: Model) -> Owned:
    """The group that a smaller model lacks, or has in a smaller form."""
    return next(iter(fit.model - model))[0]


def _without(shared: tuple[Search[Any], Fit], model: Model) -> list[Fit]:
    """What is found of a smaller model than a fit's, and in the place of what it lacks."""
    begun, fit = shared
    search = begun.alone([model])
    with one_blas_thread():
        less = search.fit(model, fit.x, fit.here.near, hope=search.hoped(fit, model, fit.here))
        led = search.best.model != fit.model
        if not led and less is not None and len(model) < len(fit.model):
            instead = _unforeseen(search, less, _changed(fit, model), fit)
            _in_place(replace(search, names=instead), less, fit)
    return [found for of, found in search.fits.items() if of != fit.model]


def _unforeseen(search: Search[Kind], less: Fit, gone: Owned, fit: Fit) -> tuple[Owned, ...]:
    """Groups whose worth in the place of one that is gone no forecast from the fit tells.

    All, where that cost twice or half as much as was forecast; else what is periodic. Those of the
    specimen that it was of, and what was left.
    """
    layout, left = search.layout, dict(less.model)
    told = laplace(fit.here, layout, layout.columns(less.model)).score
    told += layout.believed(less.model) - fit.score
    foreseen = 0.5 * told < less.score - fit.score < 2.0 * told
    turning = {name for name, _ in layout.turning(layout.whole(search.names))}

    def is_open(name: Owned) -> bool:
        of_same = name != gone and name.specimen in (None, gone.specimen)
        return of_same and (name in turning or not foreseen)

    return tuple(name for name in search.names if name in left or is_open(name))


def _in_place(search: Search[Kind], less: Fit, fit: Fit) -> None:
    """What takes most off the misfit of a fit without one of its groups, fitted beside it.

    Unless twice of that would not do: the best of eight sides of what is periodic is a sixteenth of
    a turn from the right one, at most, and takes off half as much as that, at least, even where the
    opposite side would do as well.
    """
    layout = search.layout
    more = [m for m in larger(layout, search.names, less.model) if len(m) > len(less.model)]
    if not more or (around := search.seen_around(less)) is None:
        return
    forecast = search.forecasts(around, less.model)
    score, model = min(((forecast(m), m) for m in more), key=lambda found: found[0])
    gain = forecast(less.model) - score
    if less.score - 2.0 * gain < fit.score:
        model = _awake(layout, around, model, less.model)
        start = laplace(around, layout, layout.columns(model)).x
        search.fit(model, start, around.near, hope=search.hoped(fit, model, around))


def _awake(layout: Layout, around: Linearised, model: Model, less: Model) -> Model:
    """A model with the group that it has beyond a smaller one in the largest form alike to it.

    What further coordinates of a group mean nothing where it is absent, as how a lift bends, no
    forecast tells: without them it may do less than what it is to replace.
    """
    ((name, form),) = model - less
    asleep = around.columns[np.diag(around.hessian) == 0.0]
    own = layout.own(name, form)
    for larger_form in reversed(range(len(layout.groups[name].shapes))):
        whole = layout.own(name, larger_form)
        if np.isin(own, whole).all() and np.isin(np.setdiff1d(whole, own), asleep).all():
            return less | freeze({name: larger_form})
    return model
