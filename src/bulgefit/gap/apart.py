"""What is each part of a model worth? The model without it, and the way up part by part."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.errors import InputError, SolveError
from bulgefit.gap.effects import CREASES, SHEAR
from bulgefit.gap.evidence.coordinates import MATERIAL
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.laplace import laplace
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout, Model, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.explanation import Step
from bulgefit.gap.regress import Regression
from bulgefit.parallel.journal import kept
from bulgefit.parallel.memory import give_back
from bulgefit.parallel.spread import spread
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["refitted", "taken_apart"]

Floats = NDArray[np.float64]

#: Of the misfit: what shares of the gap are told to.
_TOLD = 0.01


def taken_apart(
    weighing: Weighing,
    layout: Layout,
    fit: Fit,
    final: Regression,
    baseline: Regression,
    executor: Executor,
    known: Mapping[Model, Fit],
    *,
    believed: bool,
) -> tuple[list[Owned], dict[Owned, Regression | None], list[Step]]:
    """Groups by what they take off, the model without each, and the way there from the moduli.

    Smaller models that the search has been at, over fewer points, are gone on with from there.
    What is `believed` of the moduli is so without each part, too; the baseline does not heed it.
    """
    names = sorted(name for name, _ in fit.model)

    def begun(model: Model) -> tuple[Model, Floats, object]:
        start = known.get(model, fit)
        return model, start.x, start.here.near

    creased = weighing.offsets is not None
    scattering = [g.id for g in layout.groups.values() if g.always and g.id != MATERIAL]
    more = creased or bool(scattering)
    beside = (weighing, layout)
    alone = baseline
    if names and (more or believed):
        alone = _refit(beside, begun(freeze({}))) or baseline

    rests: list[Regression | None] = [alone] * len(names)
    if len(names) > 1:
        less = [begun(_less(fit.model, [name])) for name in names]
        rests = spread(executor, _refit, beside, less)
    give_back(executor)  # what comes is one after the other, here
    without = dict(zip(names, rests, strict=True))

    def worth(name: Owned) -> float:
        rest = without[name]
        return np.inf if rest is None else rest.held_out()

    names.sort(key=worth, reverse=True)
    # the way up: what is taken out last, and with it all that are worth more, stands first
    last_but_one = [without[names[-1]]] if len(names) > 1 else []
    fits = [*_between(weighing, layout, fit, names), *last_but_one, final]
    steps, last = [], baseline
    if more:
        last = alone if names else final
        creases = [Owned(CREASES)] if creased else []
        steps.append(Step((*scattering, *creases), baseline, last))
    for name, after in zip(names, fits, strict=True) if names else ():
        steps.append(Step((name,), last, after or last))
        last = after or last
    return names, without, steps


def _less(model: Model, names: Iterable[Owned]) -> Model:
    gone = set(names)
    return freeze({name: form for name, form in model if name not in gone})


def _between(
    weighing: Weighing, layout: Layout, fit: Fit, names: Sequence[Owned]
) -> list[Regression | None]:
    """The model with the first of its parts, the first two, ..., but for its last two.

    Each is looked for from where the next larger one stands, since from the whole model's the way
    is long; from there where nothing balances with what the larger one made of its values.
    """
    found, larger = list[Regression | None](), fit
    for count in range(len(names) - 2, 0, -1):
        model = _less(fit.model, names[count:])
        smaller = None
        for start in dict.fromkeys((larger, fit)):
            at = partial(refitted, weighing.afresh(), layout, model, start.x, start.here.near)
            smaller = smaller or kept(at)
        larger = smaller or larger
        found.append(_told(weighing.afresh(), layout, smaller) if smaller is not None else None)
    return found[::-1]


def _refit(
    shared: tuple[Weighing, Layout], begun: tuple[Model, Floats, object]
) -> Regression | None:
    """A smaller model, from where it is begun; None where nothing balances."""
    (weighing, layout), (model, x, near) = shared, begun
    # what a specimen remembers of earlier solves differs from process to process, in the last bits
    weighing = weighing.afresh()
    with one_blas_thread():
        fit = refitted(weighing, layout, model, x, near)
        return _told(weighing, layout, fit) if fit is not None else None


def _told(weighing: Weighing, layout: Layout, fit: Fit) -> Regression:
    """The regression of a smaller model: no one starts from it, so derivatives are let go.

    A per cent of the misfit may be several of a modulus: of a fit that came to its bottom values
    are those that the next step would lead to, which costs no solve. One that did not, and heads
    for softer shear, where frames lose stability as a rule, is `held`.
    """
    found = regression_of(weighing, fit)
    shapes = weighing.lighter(fit.here.near)
    seen = [replace(p, shapes=s) for p, s in zip(found.predictions, shapes, strict=True)]
    every, columns = weighing.coordinates.every, fit.here.columns
    ahead = laplace(fit.here, layout, columns).x
    values = {every[c].key: every[c].value(float(ahead[c])) for c in columns}
    if fit.converged:
        return replace(found, predictions=seen, values=values)
    return replace(found, predictions=seen, held=values[SHEAR] < found.values[SHEAR])


def refitted(
    weighing: Weighing, layout: Layout, model: Model, x: Floats, near: object
) -> Fit | None:
    """A smaller model from where a larger one stands; None where nothing balances.

    Roughly: what it leaves is hundreds of times the noise if its parts matter, and the valleys
    there are long; where they hardly do, the first step leads to the bottom. What a step changes
    by less than a per cent of the misfit is no other figure in a budget of whole per cents.
    """
    with suppress(SolveError, InputError):
        found = descend(weighing, layout, model, x, near, roughly=True, share=_TOLD)
        # a journal keeps it, and the next smaller one starts from it
        return found.rounded(weighing)
    return None
