"""In which order is it searched for what explains the gap? And when is that enough?

Everything at once, models of it, and the best of these by all points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import SolveError
from bulgefit.gap.attempt import Attempt
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates, is_field
from bulgefit.gap.evidence.creases import on_points
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.improve import promise
from bulgefit.gap.evidence.outcome import seen_by
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.search import Search
from bulgefit.gap.evidence.temper import taken_up, temper
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.pace import Pace, Stage
from bulgefit.gap.prepare import Prepared, correct_anew, fix_units
from bulgefit.parallel.journal import kept
from bulgefit.parallel.memory import give_back

__all__ = ["Best", "most_probable"]

Floats = NDArray[np.float64]

#: Points that models are weighed by at least; beyond, as many as the noise's correlation leaves.
LEAST_POINTS = 400


@dataclass(frozen=True, eq=False)
class Best:
    """The best model that was found.

    Attributes
    ----------
    search : Search
        That it was found by, on some of the points.
    weighing : Weighing
        Of all points.
    fit : Fit
        Of the best model, by them.
    creases_worth : float
        What -2 ln Z falls by with offsets of the points.
    """

    search: Search[Weighing]
    weighing: Weighing
    fit: Fit
    creases_worth: float


def most_probable(
    prepared: Sequence[Prepared],
    coordinates: Coordinates,
    start: Floats,
    origin: Floats,
    say: Callable[[str], None],
    pace: Pace,
    executor: Executor | None = None,
    *,
    thorough: bool = False,
) -> Best:
    """Free all groups at once, take out what the evidence lets go; the best model by all points.

    Noise, the mesh's error and the values in use are fixed by the fit of everything, before any
    models are compared. The mesh's error is found once more at the best model.

    Parameters
    ----------
    prepared : sequence of Prepared
    coordinates : Coordinates
    start, origin : (n,) array
        Where everything at once is fitted from, and fields are freed from; the first again from
        the second where nothing balances at it.
    say : callable
        Told what is tried.
    pace : Pace
        Told which stage begins.
    executor : concurrent.futures.Executor, optional
        Searches that do not wait for each other, side by side.
    thorough : bool
        Search by every way, also where the first leaves nothing but noise.

    Raises
    ------
    SolveError
        Nothing balances at either.
    """
    layout = Layout.of(coordinates.groups)
    data = [p.data for p in prepared]
    say("everything at once")
    rough = _rough_fit(data, coordinates, layout, start, origin)
    for index, p in enumerate(prepared):
        fix_units(p, rough.here.near[index])
    pace.begins(Stage.SEARCH)
    search, creases_worth = _searched(
        prepared, coordinates, layout, rough, origin, say, pace, executor, thorough=thorough
    )
    found = search.best
    # what all fields took at once all points need again, while workers have nothing to do
    give_back(executor)
    pace.begins(Stage.POINTS)
    say("the best model, by all points")
    for index, p in enumerate(prepared):
        correct_anew(p, found.here.near[index])
    offsets = on_points(data, search.problem.offsets)
    weighing = search.problem.over(data, offsets, _excess(search))
    fit = kept(lambda: descend(weighing, search.layout, found.model, found.x, found.here.near))
    return Best(search, weighing, fit, creases_worth)


def _rough_fit(
    data: Sequence[Data],
    coordinates: Coordinates,
    layout: Layout,
    start: Floats,
    origin: Floats,
) -> Fit:
    """Every effect freed, before the mesh's error is known: one for other moduli would mislead."""
    for d in data:
        d.specimen.correction = None
    weighing = Weighing(_thinned(data), coordinates)
    model = layout.whole(name for name in layout.free if not is_field(name))
    hope = weighing.noise
    try:
        return kept(lambda: descend(weighing, layout, model, start, roughly=True, hope=hope))
    except SolveError:
        return kept(lambda: descend(weighing, layout, model, origin, roughly=True, hope=hope))


def _thinned(data: Sequence[Data]) -> list[Data]:
    """As many points as the noise's correlation leaves."""
    return [
        d.thinned(min(round(d.in_space), len(d.specimen.reference) // LEAST_POINTS)) for d in data
    ]


def _searched(
    prepared: Sequence[Prepared],
    coordinates: Coordinates,
    layout: Layout,
    rough: Fit,
    origin: Floats,
    say: Callable[[str], None],
    pace: Pace,
    executor: Executor | None,
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
    weighing = Weighing(_thinned([p.data for p in prepared]), coordinates)
    # the first attempt has no name: where another is gone on with, it gives its memory back
    found, worth, enough = _begun(
        Attempt.of(weighing, layout, rough, origin, say, executor), pace, thorough=thorough
    )
    pace.begins(Stage.UNNAMED if found.has_unnamed else Stage.UNITS)
    for settle in (Attempt.finished,) if enough else (Attempt.thinned, Attempt.settled):
        say("units anew")
        for index, p in enumerate(prepared):
            fix_units(p, found.search.best.here.near[index])
        found = found.anew(_thinned([p.data for p in prepared]))
        found, worth = found.with_offsets_if_worth(worth)
        found = settle(found)
    return found.search, worth


def _begun(plain: Attempt, pace: Pace, *, thorough: bool) -> tuple[Attempt, float, bool]:
    """The search that is gone on with, what offsets of the points are worth in it, and if it ends.

    Elimination begins where everything together leaves nothing but noise: that is enough. Where all
    that have names leave more, so do fewer: offsets are tried, which cost no coordinates, then the
    fields, and these beside offsets.
    """
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
    if (offsets := plain.offsets) is not None:
        plain.search.say("offsets of the points")
        beside = plain.begun_beside(offsets)
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
        and promise(plain.search, whole) < promise(found.search, best)
    ):
        found = replace(plain, search=replace(plain.search, fits={whole.model: whole}))
    return found, plain.score - found.score, False


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
