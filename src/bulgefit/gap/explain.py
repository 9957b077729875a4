"""Which unmodelled effects explain the gap? All freed at once under priors, weighed by evidence."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bulgefit.effects.base import Effect
from bulgefit.effects.parameter import Key, Owned
from bulgefit.gap.apart import refitted, taken_apart
from bulgefit.gap.course import most_probable
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CREASES, MODULI
from bulgefit.gap.evidence.coordinates import Coordinates, is_field, with_fields
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.outcome import posterior, regression_of
from bulgefit.gap.evidence.probability import SURE, Weighed, weighed
from bulgefit.gap.evidence.problem import Layout, Model
from bulgefit.gap.evidence.search import Search
from bulgefit.gap.evidence.shares import scores
from bulgefit.gap.evidence.temper import taken_up, temper
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.explanation import Evidence, Explanation, FoundField, Known
from bulgefit.gap.found_fields import creases_found, field_found
from bulgefit.gap.keys import offsets_of_points
from bulgefit.gap.pace import Pace, Stage
from bulgefit.gap.prepare import Prepared
from bulgefit.gap.regress import Regression, regress, starting_moduli
from bulgefit.gap.residual.structure import structure
from bulgefit.parallel.memory import give_back

__all__ = ["explain"]

Floats = NDArray[np.float64]


def explain(
    prepared: Sequence[Prepared],
    effects: Sequence[Effect],
    baseline: Regression,
    executor: Executor,
    say: Callable[[str], None] = lambda _: None,
    pace: Pace | None = None,
    *,
    thorough: bool = False,
    same_rig: bool = False,
    priors: Mapping[str, tuple[float, float]] | None = None,
) -> Explanation:
    """Free all effects at once, take out what the evidence lets go, and weigh what is left.

    The best model is found (`most_probable`); the model without each of its parts and the baseline
    are then fitted again, with the mesh's error as it is there.

    Parameters
    ----------
    prepared : sequence of Prepared
    effects : sequence of Effect
        Candidates.
    baseline : Regression
        The moduli alone.
    executor : concurrent.futures.Executor
        Fits without each group, and with each field alone, side by side.
    say : callable
        Told what is tried.
    pace : Pace, optional
        Told which stage begins.
    thorough : bool
        Search by every way, also where the first leaves nothing but noise.
    same_rig : bool
        Whether clamp and cameras are the same for all specimens.
    priors : mapping of modulus to (MPa, MPa), optional
        Centre and standard deviation that are better known.
    """
    pace = pace or Pace()
    whole = [p.data for p in prepared]
    usable = with_fields(effects, [d.specimen.test for d in whole], several=len(whole) > 1)
    nulls = [d.specimen.nulls() for d in whole]
    coordinates = Coordinates.of(usable, nulls, priors, same_rig=same_rig)
    null = np.concatenate([g.null for g in coordinates.groups])
    first = starting_moduli(whole)
    start, origin = (_with_moduli(null, moduli) for moduli in (first, baseline.values))
    best = most_probable(
        prepared, coordinates, start, origin, say, pace, executor, thorough=thorough
    )
    search, weighing, fit = best.search, best.weighing, best.fit
    layout, coordinates, offsets = search.layout, search.problem.coordinates, weighing.offsets
    baseline = regress(whole, MODULI, baseline.values, [p.shapes for p in baseline.predictions])
    final = regression_of(weighing, fit, posterior(weighing, fit))
    bare = Weighing(whole, coordinates, offsets)
    tempered = temper(whole, final.predictions, taken_up(bare, fit, layout))
    # beside a misfit of its own covariance nothing of it is left
    left = tempered if search.problem.misfits is None else 1.0
    chances = weighed(scores(search, left), search.names)
    known = _known(search)
    search.looked.clear()  # it is memory that workers need
    give_back()
    pace.begins(Stage.PARTS)
    say("the model without each of its parts")
    groups, without, steps = taken_apart(
        weighing, layout, fit, final, baseline, executor, search.fits, believed=bool(priors)
    )
    evidence = {g: _evidence(chances, coordinates, layout, fit, g, without[g]) for g in groups}
    keys = {g: _keys(coordinates, layout, fit.model, g) for g in groups}
    found_fields = [
        field_found(g, _values(coordinates, layout, fit, g), whole, final)
        for g in groups
        if is_field(g)
    ]
    if offsets is not None:
        say("the model without offsets")
        chance = float(expit(0.5 * best.creases_worth / tempered))
        for key, told, field in _offsets_found(weighing, layout, fit, whole, final, chance):
            creases = Owned(CREASES, key.specimen)
            keys[creases], evidence[creases] = (key,), told
            found_fields.append(field)
    return Explanation(
        baseline=baseline,
        final=final,
        known=known,
        groups=keys,
        evidence=evidence,
        others={g: p for g, p in chances.groups.items() if g not in groups and p > 0.0},
        fields=found_fields,
        steps=steps,
        start=structure(whole, baseline),
        remainder=structure(whole, final),
        temper=tempered,
    )


def _offsets_found(
    weighing: Weighing,
    layout: Layout,
    fit: Fit,
    whole: Sequence[Data],
    final: Regression,
    chance: float,
) -> Iterator[tuple[Key, Evidence, FoundField]]:
    """Offsets of each specimen's points, as a field; all together have a probability."""
    smooth = weighing.smooth()
    rest = refitted(smooth, layout, fit.model, fit.x, fit.here.near)
    evidence = Evidence(chance, (), None if rest is None else regression_of(smooth, rest), {})
    for key in offsets_of_points(len(whole)):
        index = key.specimen or 0
        offset, error = final.offsets[index], final.offset_errors[index]
        if offset is not None and error is not None:
            creases = Owned(CREASES, key.specimen)
            yield key, evidence, creases_found(creases, whole[index], offset, error)


def _with_moduli(null: Floats, moduli: Mapping[Key, float]) -> Floats:
    """Every group at its null, but the moduli (MPa)."""
    x = np.array(null)
    x[: len(MODULI)] = np.log([moduli[m] for m in MODULI])
    return x


def _keys(coordinates: Coordinates, layout: Layout, model: Model, group: Owned) -> tuple[Key, ...]:
    part, columns = layout.part(group), layout.columns(model)
    return tuple(coordinates.every[c].key for c in columns if part.start <= c < part.stop)


def _evidence(
    chances: Weighed,
    coordinates: Coordinates,
    layout: Layout,
    fit: Fit,
    group: Owned,
    without: Regression | None,
) -> Evidence:
    part, columns = layout.part(group), layout.columns(fit.model)
    columns = columns[(part.start <= columns) & (columns < part.stop)]
    away = layout.away(columns, fit.x[columns]).tolist()
    pulls = {coordinates.every[c].key: pull for c, pull in zip(columns, away, strict=True)}
    probability = chances.groups.get(group, 0.0)
    rivals = chances.rivals(group) if probability < SURE else ()
    return Evidence(probability, rivals, without, pulls)


def _values(coordinates: Coordinates, layout: Layout, fit: Fit, group: Owned) -> dict[Key, float]:
    """Of a group's parameters, those at their null among them."""
    part = layout.part(group)
    every = [(coordinates.every[c], float(fit.x[c])) for c in range(part.start, part.stop)]
    return {coordinate.key: coordinate.value(x) for coordinate, x in every}


def _known(search: Search[Weighing]) -> Known:
    """By every coordinate of the catalogue, at the best model; by its own where that has no way."""
    names = (name for name in search.names if not is_field(name))
    around = search.seen_around(search.best) or search.best.here
    columns = np.intersect1d(search.layout.columns(search.layout.whole(names)), around.columns)
    around = around.of(columns)
    every = search.problem.coordinates.every
    return Known(tuple(every[c].key for c in columns), around.hessian)
