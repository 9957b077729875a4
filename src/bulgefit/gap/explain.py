"""Which unmodelled effects explain the gap? All freed at once under priors, weighed by evidence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bulgefit.effects.base import Effect
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Key, Owned
from bulgefit.effects.registry import fields, scatter
from bulgefit.gap.apart import refitted, taken_apart
from bulgefit.gap.course import rough_fit, searched
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CREASES, MODULI
from bulgefit.gap.evidence.coordinates import Coordinates, is_field
from bulgefit.gap.evidence.creases import on_points
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.outcome import regression_of, seen_by
from bulgefit.gap.evidence.probability import SURE, Weighed, weighed
from bulgefit.gap.evidence.problem import Layout, Model
from bulgefit.gap.evidence.search import Search
from bulgefit.gap.evidence.temper import taken_up, temper
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.explanation import Evidence, Explanation, FoundField, Known
from bulgefit.gap.keys import offsets_of_points
from bulgefit.gap.level import Level
from bulgefit.gap.pace import Pace, Stage
from bulgefit.gap.prepare import Prepared, correct_anew, fix_units
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.residual.structure import structure
from bulgefit.parallel.journal import kept

__all__ = ["START", "explain"]

Floats = NDArray[np.float64]

#: Where descents start (MPa): a coated fabric with stiff shear, which is stable everywhere.
START = dict(zip(MODULI, (320.0, 210.0, 20.0), strict=True))


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

    Noise, the mesh's error and the values in use are fixed by the fit of everything, before any
    models are compared. The mesh's error is found once more at the best model; that, the model
    without each of its parts and the baseline are then fitted again.

    Parameters
    ----------
    prepared : sequence of Prepared
    effects : sequence of Effect
        Candidates.
    baseline : Regression
        The moduli alone.
    executor : concurrent.futures.Executor
        Refits without each group, side by side.
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
    usable = [e for e in effects if not e.never_separable]
    whole = [p.data for p in prepared]
    several = len(whole) > 1
    usable += [f for f in _stepped_fields(whole) if several or not f.of_several]
    if several:
        usable += scatter().values()
    nulls = [d.specimen.nulls() for d in whole]
    coordinates = Coordinates.of(usable, nulls, priors, same_rig=same_rig)
    layout = Layout.of(coordinates.groups)
    start = np.array(layout.null)
    start[: len(MODULI)] = np.log([START[m] for m in MODULI])

    pace.begins(Stage.TOGETHER)
    say("everything at once")
    rough = rough_fit(whole, coordinates, layout, start, baseline)
    for index, p in enumerate(prepared):
        fix_units(p, rough.here.near[index])

    origin = np.array(layout.null)
    origin[: len(MODULI)] = np.log([baseline.values[m] for m in MODULI])
    pace.begins(Stage.SEARCH)
    search, creases_worth = searched(
        prepared, coordinates, layout, rough, origin, say, pace, thorough=thorough
    )
    found, layout, coordinates = search.best, search.layout, search.problem.coordinates
    pace.begins(Stage.POINTS)
    say("the best model, by all points")
    for index, p in enumerate(prepared):
        correct_anew(p, found.here.near[index])
    baseline = regress(whole, MODULI, baseline.values, [p.shapes for p in baseline.predictions])
    offsets = on_points(whole, search.problem.offsets)
    weighing = search.problem.over(whole, offsets, _excess(search))
    fit = kept(lambda: descend(weighing, layout, found.model, found.x, found.here.near))
    final = regression_of(weighing, fit)
    bare = Weighing(whole, coordinates, offsets)
    tempered = temper(whole, final.predictions, taken_up(bare, fit, layout))
    # beside a misfit of its own covariance nothing of it is left
    left = tempered if search.problem.misfits is None else 1.0
    chances = weighed(search.scores(left), search.names)
    pace.begins(Stage.PARTS)
    say("the model without each of its parts")
    groups, without, steps = taken_apart(
        weighing, layout, fit, final, baseline, executor, search.fits
    )
    evidence = {g: _evidence(chances, coordinates, layout, fit, g, without[g]) for g in groups}
    keys = {g: _keys(coordinates, layout, fit.model, g) for g in groups}
    found_fields = [_field(coordinates, layout, fit, g, whole) for g in groups if is_field(g)]
    if offsets is not None:
        say("the model without offsets")
        creases = Owned(CREASES)
        keys[creases] = offsets_of_points(len(whole))
        smooth = weighing.smooth()
        rest = refitted(smooth, layout, fit.model, fit.x, fit.here.near)
        chance = float(expit(0.5 * creases_worth / tempered))
        without_creases = None if rest is None else regression_of(smooth, rest)
        evidence[creases] = Evidence(chance, (), without_creases, {})
        found_fields.append(FoundField(creases, _creases(whole, final)))
    return Explanation(
        baseline=baseline,
        final=final,
        known=_known(search),
        groups=keys,
        evidence=evidence,
        others={g: p for g, p in chances.groups.items() if g not in groups and p > 0.0},
        fields=found_fields,
        steps=steps,
        start=structure(whole, baseline),
        remainder=structure(whole, final),
        temper=tempered,
    )


def _excess(search: Search[Weighing]) -> float:
    """Of the noise, where the best model was weighed beside a misfit; 1 where nothing is left.

    What errs may also move the values of what does not, beyond what a covariance of its own says:
    so standard errors count it in all directions.
    """
    problem, best = search.problem, search.best
    if problem.misfits is None:
        return 1.0
    seen = seen_by(problem, best).predictions
    bare = Weighing(problem.data, problem.coordinates, problem.offsets)
    return temper(problem.data, seen, taken_up(bare, best, search.layout))


def _stepped_fields(data: Sequence[Data]) -> list[Field]:
    """Fields that have coordinates, and of the tests all that they need."""
    tests = [d.specimen.test for d in data]
    return [
        f
        for f in fields().values()
        if f.parameters and all(getattr(t, need) is not None for t in tests for need in f.needs)
    ]


def _creases(data: Sequence[Data], final: Regression) -> Sampled:
    """Sizes of the offsets of the first specimen's points, where they are."""
    offset = final.offsets[0]
    assert offset is not None
    x, y = data[0].specimen.reference[:, :2].T
    return Sampled(np.linalg.norm(offset, axis=1), {"x_mm": x, "y_mm": y})


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
    part = layout.part(group)
    pulls = {
        coordinates.every[c].key: float((fit.x[c] - layout.null[c]) / layout.width[c])
        for c in layout.columns(fit.model)
        if part.start <= c < part.stop
    }
    probability = chances.groups.get(group, 0.0)
    rivals = chances.rivals(group) if probability < SURE else ()
    return Evidence(probability, rivals, without, pulls)


def _field(
    coordinates: Coordinates, layout: Layout, fit: Fit, group: Owned, data: Sequence[Data]
) -> FoundField:
    specimen = data[group.specimen or 0].specimen
    part = layout.part(group)
    values = {coordinates.every[c].key: float(fit.x[c]) for c in range(part.start, part.stop)}
    own = {key.parameter: value for key, value in values.items()}
    kind = fields()[group.effect]
    sampled = kind.sampled(own, specimen.test.radius, specimen.recorded)
    return FoundField(group, sampled, Level.of(kind, values))


def _known(search: Search[Weighing]) -> Known:
    """By every coordinate of the catalogue, at the best model; by its own where that has no way."""
    names = (name for name in search.names if not is_field(name))
    around = search.seen_around(search.best) or search.best.here
    columns = np.intersect1d(search.layout.columns(search.layout.whole(names)), around.columns)
    around = around.of(columns)
    every = search.problem.coordinates.every
    return Known(tuple(every[c].key for c in columns), around.hessian)
