"""Which unmodelled effects explain the gap? All freed at once under priors, weighed by evidence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bulgefit.effects.base import Effect
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Key, Owned
from bulgefit.effects.registry import fields, scatter
from bulgefit.errors import SolveError
from bulgefit.gap.apart import refitted, taken_apart
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CREASES, MODULI
from bulgefit.gap.evidence.amplitude import amplitudes
from bulgefit.gap.evidence.coordinates import Coordinates, is_field
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.outcome import Seen, regression_of, seen_by
from bulgefit.gap.evidence.probability import SURE, Weighed, weighed
from bulgefit.gap.evidence.problem import Layout, Model
from bulgefit.gap.evidence.search import GROWN, Search
from bulgefit.gap.evidence.temper import loudest, taken_up, temper
from bulgefit.gap.evidence.ways import Ways
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
#: Points that models are weighed by at least; beyond, as many as the noise's correlation leaves.
LEAST_POINTS = 400


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
    rough = _rough(whole, coordinates, layout, start, baseline)
    for index, p in enumerate(prepared):
        fix_units(p, rough.here.near[index])

    origin = np.array(layout.null)
    origin[: len(MODULI)] = np.log([baseline.values[m] for m in MODULI])
    pace.begins(Stage.SEARCH)
    search, creases_worth = _searched(
        prepared, coordinates, layout, rough, origin, say, pace, thorough=thorough
    )
    found, layout, coordinates = search.best, search.layout, search.problem.coordinates
    pace.begins(Stage.POINTS)
    say("the best model, by all points")
    for index, p in enumerate(prepared):
        correct_anew(p, found.here.near[index])
    baseline = regress(whole, MODULI, baseline.values, [p.shapes for p in baseline.predictions])
    offsets = _on(whole, search.problem.offsets)
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


def _catalogued(names: Iterable[Owned]) -> tuple[Owned, ...]:
    return tuple(n for n in names if not is_field(n))


def _free(layout: Layout) -> tuple[Owned, ...]:
    return tuple(g.id for g in layout.groups.values() if not g.always)


def _rough(
    data: Sequence[Data],
    coordinates: Coordinates,
    layout: Layout,
    start: Floats,
    baseline: Regression,
) -> Fit:
    """Every effect freed, before the mesh's error is known: one for other moduli would mislead."""
    for d in data:
        d.specimen.correction = None
    weighing = Weighing(_thinned(data), coordinates)
    model = layout.whole(_catalogued(_free(layout)))
    hope = weighing.count / weighing.inflation
    try:
        return kept(lambda: descend(weighing, layout, model, start, roughly=True, hope=hope))
    except SolveError:
        other = np.array(start)
        other[: len(MODULI)] = np.log([baseline.values[m] for m in MODULI])
        return kept(lambda: descend(weighing, layout, model, other, roughly=True, hope=hope))


def _thinned(data: Sequence[Data]) -> list[Data]:
    return [
        d.thinned(min(round(d.inflation / d.mixture), len(d.specimen.reference) // LEAST_POINTS))
        for d in data
    ]


def _searched(
    prepared: Sequence[Prepared],
    coordinates: Coordinates,
    layout: Layout,
    rough: Fit,
    origin: Floats,
    say: Callable[[str], None],
    pace: Pace,
    *,
    thorough: bool,
) -> tuple[Search[Weighing], float]:
    """Models weighed on as many points as the noise's correlation leaves.

    The search whose best model holds: that by points as they are, that beside offsets of the
    points, or the better one gone through again by what its largest model leaves. Also what -2 ln Z
    falls by with offsets.

    Units are fixed anew by what that comes to, before it is looked around in closely: with
    everything free the shape is off by more than the errors of what is then taken out. Where a fit
    missed that is done twice, by everything and by what is left of it.
    """
    found, worth, enough = _begun(
        prepared, coordinates, layout, rough, origin, say, pace, thorough=thorough
    )
    pace.begins(Stage.UNITS)
    for settle in (_Trial.finished,) if enough else (_Trial.thinned, _Trial.settled):
        say("units anew")
        for index, p in enumerate(prepared):
            fix_units(p, found.search.best.here.near[index])
        # what came before is not asked any more, and gives its memory back
        found = found.anew(_thinned([p.data for p in prepared]))
        found, worth = found.with_offsets_if_worth(worth)
        found = settle(found)
    return found.search, worth


def _begun(
    prepared: Sequence[Prepared],
    coordinates: Coordinates,
    layout: Layout,
    rough: Fit,
    origin: Floats,
    say: Callable[[str], None],
    pace: Pace,
    *,
    thorough: bool,
) -> tuple[_Trial, float, bool]:
    """The search that is gone on with, what offsets of the points are worth in it, and if it ends.

    Elimination begins where everything together leaves nothing but noise: that is enough. Where all
    that have names leave more, so do fewer: offsets are tried, which cost no coordinates, then the
    fields, and these beside offsets.
    """
    data = _thinned([p.data for p in prepared])
    plain = _Trial.of(Weighing(data, coordinates), layout, rough, origin, say)
    if thorough:
        plain.ways.every()
    else:
        plain.ways.by_elimination(lambda: plain.is_content)
    if not plain.search.fits or not (plain.search.best.converged or plain.is_content):
        # what everything together was given up at says nothing of smaller models
        plain.ways.from_below(to_noise=True)
    if plain.is_content:
        return plain, 0.0, True
    pace.begins(Stage.FIELDS)
    found = plain
    if (offsets := _offsets(data, plain.seen)) is not None:
        say("offsets of the points")
        beside = _Trial.of(Weighing(data, coordinates, offsets), layout, rough, origin, say)
        beside.ways.by_elimination(lambda: beside.is_content)
        found = beside if beside.search.fits else plain
    if found.is_content:
        return found, plain.score - found.score, True
    whole = plain.ways.with_fields()
    if found.score >= plain.score:
        found = plain
    if whole is not None and not plain.is_content:
        both = plain.beside_offsets(whole)
        if both is not None and both.score < found.score:
            return both, plain.score - both.score, both.is_content
    best = found.search.best
    # coordinates by the hundred that nothing asks for may cost fields more than others leave
    if (
        whole is not None
        and whole is not best
        and plain.search.promise(whole) < found.search.promise(best)
    ):
        found = replace(plain, search=replace(plain.search, fits={whole.model: whole}))
    return found, plain.score - found.score, False


@dataclass(frozen=True, eq=False)
class _Trial:
    """A search, and ways through it."""

    data: Sequence[Data]
    search: Search[Weighing]
    ways: Ways[Weighing]

    @classmethod
    def of(
        cls,
        weighing: Weighing,
        layout: Layout,
        rough: Fit,
        origin: Floats,
        say: Callable[[str], None],
    ) -> _Trial:
        """From the fit of everything that came first; fields from the moduli alone, too."""
        names = _free(layout)
        search = Search(weighing, layout, names, say)
        free = tuple(n for n in names if is_field(n))
        return cls(weighing.data, search, Ways(search, rough.x, rough.here.near, free, origin))

    @property
    def seen(self) -> Seen:
        """What the best model predicts."""
        return seen_by(self.search.problem, self.search.best)

    @property
    def score(self) -> float:
        """-2 ln Z of the best model, with what its offsets cost."""
        return self.search.best.score + self.search.problem.cost

    @property
    def is_content(self) -> bool:
        """Whether the best model leaves nothing but noise."""
        return not structure(self.data, self.seen).significant

    def beside_offsets(self, fit: Fit) -> _Trial | None:
        """A model from where it stands, beside offsets of the points; None where it leaves none."""
        problem = self.search.problem
        if (offsets := _offsets(self.data, seen_by(problem, fit))) is None:
            return None
        self.search.say("offsets of the points beside the fields")
        weighing = Weighing(self.data, problem.coordinates, offsets)
        search = replace(self.search, problem=weighing, fits={}, share=GROWN)
        if search.fit(fit.model, fit.x, fit.here.near, roughly=True) is None:
            return None
        search = replace(search, share=0.0)
        return replace(self, search=search, ways=replace(self.ways, search=search))

    def with_offsets_if_worth(self, before: float) -> tuple[_Trial, float]:
        """The best model beside offsets of the points or not, and what -2 ln Z falls by with them.

        They may have let it be found, and be worth nothing beside it.

        Parameters
        ----------
        before : float
            What they were worth when it was found, at most.
        """
        best, beside = self.search.best, self.search
        if beside.problem.offsets is None:
            return self, before
        search = replace(beside, problem=beside.problem.smooth(), fits={}, renewed=set())
        hope = beside.as_good(best, best.model, best.here) + beside.problem.cost
        if search.fit(best.model, best.x, best.here.near, roughly=True, hope=hope) is None:
            return self, before
        worth = min(before, search.best.score - self.score)
        if worth > 0.0:
            return self, worth
        return replace(self, search=search, ways=replace(self.ways, search=search)), 0.0

    def finished(self) -> _Trial:
        """What else may be, where nothing is left: fewer effects, or a field in their place.

        A group or two that stand for fewer are dropped or swapped by one change, which was tried.
        """
        if len(self.search.best.model) > 2:
            self.ways.from_below()
        self.search.improved(self.search.best)
        self.ways.from_fields()
        self.search.closely(self.ways.named)
        return self

    def anew(self, data: Sequence[Data]) -> _Trial:
        """The best model alone, by data in other units."""
        best, problem = self.search.best, self.search.problem
        weighing = Weighing(data, problem.coordinates, _on(data, problem.offsets))
        search = replace(self.search, problem=weighing, fits={}, renewed=set())
        search.fit(best.model, best.x, best.here.near, roughly=True)
        return replace(self, data=data, search=search, ways=replace(self.ways, search=search))

    def thinned(self) -> _Trial:
        """The best model without what it can do without, by the noise that it leaves.

        Where the largest model leaves more than noise, that is more than any group can take away:
        it stands in every model's residual, along the directions that groups have. Beside it as
        noise (`loudest`) groups are judged by what they take off beyond that.
        """
        best, search = self.search.best, self.search
        if not self.is_content:
            taken = taken_up(search.problem, best, search.layout)
            by = loudest(self.data, self.seen.predictions, taken)
            search = replace(search, problem=search.problem.beside(by), fits={}, roughly=True)
            best = search.fit(best.model, best.x, best.here.near) or best
        search.improved(best)
        search.closely(self.ways.named)
        return replace(self, search=search, ways=replace(self.ways, search=search))

    def settled(self) -> _Trial:
        """The best model beside what it misses by; by less of it, if it can do with less.

        What is left is told by the smallest model that is reached: told by each that follows, it
        would shrink with every effect that takes some of it, and let the next one in.
        """
        sized = self._sized()
        told = sized.search.best
        while True:
            search = sized._beside(told)
            best = search.improved(search.best)
            if (smaller := search.layout.common(told.model, best.model)) == told.model:
                break
            if (less := sized.search.fit(smaller, best.x, best.here.near)) is None:
                break
            told = less
        search.closely(self.ways.named)
        return replace(sized, search=search, ways=replace(sized.ways, search=search))

    def _sized(self) -> _Trial:
        """The best model with its fields as large as the evidence finds them (`amplitudes`)."""
        best, search = self.search.best, self.search
        found = [name for name, _ in best.model if is_field(name)]
        if not found:
            return self
        factors = amplitudes(best.here, search.layout, found, search.problem.inflation)
        problem = search.problem.within(search.problem.coordinates.scaled(factors))
        layout = search.layout.scaled(factors)
        search = replace(search, problem=problem, layout=layout, fits={}, renewed=set())
        if search.fit(best.model, best.x, best.here.near) is None:
            return self
        return replace(self, search=search, ways=replace(self.ways, search=search))

    def _beside(self, fit: Fit) -> Search[Weighing]:
        """A search from a fit, beside what that misses by beyond the noise."""
        problem, layout = self.search.problem, self.search.layout
        search = replace(self.search, fits={fit.model: fit}, roughly=True)
        if not structure(self.data, seen_by(problem, fit)).significant:
            return search
        here = problem.linearise(fit.x, layout.columns(fit.model), fit.here.near)
        search = replace(search, problem=problem.beside_misfit(here), fits={})
        search.fit(fit.model, fit.x, fit.here.near)
        return search


def _offsets(data: Sequence[Data], fit: Seen) -> list[Creases] | None:
    """What the points of each specimen show in all frames, beyond the noise; None without any."""
    pairs = zip(data, fit.predictions, strict=True)
    found = [Creases.likeliest(d, p.displacement) for d, p in pairs]
    if not any(found):
        return None
    return [c or Creases.of(d, np.zeros(3), 0.0) for d, c in zip(data, found, strict=True)]


def _on(data: Sequence[Data], offsets: Sequence[Creases] | None) -> list[Creases] | None:
    """The same offsets over other data."""
    if offsets is None:
        return None
    return [creases.on(d) for d, creases in zip(data, offsets, strict=True)]


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
    names = _catalogued(search.names)
    around = search.seen_around(search.best) or search.best.here
    columns = np.intersect1d(search.layout.columns(search.layout.whole(names)), around.columns)
    around = around.of(columns)
    every = search.problem.coordinates.every
    return Known(tuple(every[c].key for c in columns), around.hessian)
