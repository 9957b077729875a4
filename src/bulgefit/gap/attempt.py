"""A search that is gone on with: beside offsets, by other units, beside what it misses by."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data
from bulgefit.gap.evidence.amplitude import amplitudes
from bulgefit.gap.evidence.closely import closely
from bulgefit.gap.evidence.coordinates import is_field
from bulgefit.gap.evidence.creases import Creases, likeliest_offsets, on_points
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.improve import improved
from bulgefit.gap.evidence.outcome import Seen, seen_by
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.search import GROWN, Search
from bulgefit.gap.evidence.ways import Ways
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.residual.structure import structure

__all__ = ["Attempt"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Attempt:
    """A search, and ways through it.

    Attributes
    ----------
    data : sequence of Data
        As models are weighed on them.
    search : Search
    ways : Ways
    """

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
        executor: Executor | None = None,
    ) -> Attempt:
        """From the fit of everything that came first; fields from the moduli alone, too."""
        names = layout.free
        search = Search(weighing, layout, names, say, executor=executor)
        free = tuple(n for n in names if is_field(n))
        ways = Ways(search, rough.x, rough.here.near, free, origin, doubted=rough.given_up)
        return cls(weighing.data, search, ways)

    def _by(self, search: Search[Weighing]) -> Attempt:
        """The same by another search."""
        return replace(self, search=search, ways=replace(self.ways, search=search))

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

    @property
    def has_unnamed(self) -> bool:
        """Whether the best model has fields, or offsets beside it."""
        best, offsets = self.search.best, self.search.problem.offsets
        return offsets is not None or any(is_field(name) for name, _ in best.model)

    @property
    def offsets(self) -> list[Creases] | None:
        """What the points show in all frames beyond the best model, and the noise."""
        return _offsets(self.data, self.seen)

    def begun_beside(self, offsets: Sequence[Creases]) -> Attempt:
        """From the same starts, beside offsets of the points."""
        weighing = Weighing(self.data, self.search.problem.coordinates, offsets)
        search = replace(self.search, problem=weighing, fits={}, renewed=set(), looked=[])
        return replace(self, search=search, ways=replace(self.ways, search=search, doubted=False))

    def beside_offsets(self, fit: Fit) -> Attempt | None:
        """A model from where it stands, beside offsets of the points; None where it leaves none."""
        problem = self.search.problem
        if (offsets := _offsets(self.data, seen_by(problem, fit))) is None:
            return None
        self.search.say("offsets of the points beside the fields")
        weighing = Weighing(self.data, problem.coordinates, offsets)
        search = replace(self.search, problem=weighing, fits={}, share=GROWN)
        if search.fit(fit.model, fit.x, fit.here.near, roughly=True) is None:
            return None
        return self._by(replace(search, share=0.0))

    def with_offsets_if_worth(self, before: float) -> tuple[Attempt, float]:
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
        hope = beside.hoped(best, best.model, best.here) + beside.problem.cost
        if search.fit(best.model, best.x, best.here.near, roughly=True, hope=hope) is None:
            return self, before
        worth = min(before, search.best.score - self.score)
        if worth > 0.0:
            return self, worth
        return self._by(search), 0.0

    def finished(self) -> Attempt:
        """What else may be, where nothing is left: fewer effects, or a field in their place.

        A group or two that stand for fewer are dropped or swapped by one change, which was tried.
        """
        improved(self.search, self.search.best)
        if len(self.search.best.model) > 2:
            self.ways.from_below()
        self.ways.from_fields()
        closely(self.search, self.ways.named)
        return self

    def anew(self, data: Sequence[Data]) -> Attempt:
        """The best model alone, by data in other units."""
        best, problem = self.search.best, self.search.problem
        weighing = Weighing(data, problem.coordinates, on_points(data, problem.offsets))
        search = replace(self.search, problem=weighing, fits={}, renewed=set())
        search.fit(best.model, best.x, best.here.near, roughly=True)
        return replace(self._by(search), data=data)

    def thinned(self) -> Attempt:
        """The best model without what it can do without, by the noise that it leaves.

        Where the largest model leaves more than noise, that is more than any group can take away:
        it stands in every model's residual, along the directions that groups have. With noise as
        large as the loudest of it groups are judged by what they take off beyond that.
        """
        best, search = self.search.best, self.search
        if not self.is_content:
            by = self._beside_misfit_of(best).loudest
            search = replace(search, problem=search.problem.beside(by), fits={}, roughly=True)
            found = search.fit(best.model, best.x, best.here.near)
            self.search.fits[best.model] = best.lighter(search.problem)
            best = found or best
        improved(search, best)
        closely(search, without_each=False)  # its sizes and what it misses by are told anew
        return self._by(search)

    def settled(self) -> Attempt:
        """The best model beside what it misses by; by less of it, if it can do with less.

        What is left is told by the smallest model that is reached: told by each that follows, it
        would shrink with every effect that takes some of it, and let the next one in.
        """
        sized = self._sized()
        told = sized.search.best
        while True:
            search = sized._beside(told)
            best = improved(search, search.best)
            if (smaller := search.layout.common(told.model, best.model)) == told.model:
                break
            if (less := sized.search.fit(smaller, best.x, best.here.near)) is None:
                break
            told = less
        closely(search, self.ways.named)
        return sized._by(search)

    def _sized(self) -> Attempt:
        """The best model with its fields as large as the evidence finds them (`amplitudes`)."""
        best, search = self.search.best, self.search
        found = [name for name, _ in best.model if is_field(name)]
        if not found:
            return self
        factors = amplitudes(best.here, search.layout, found)
        problem = search.problem.within(search.problem.coordinates.scaled(factors))
        layout = search.layout.scaled(factors)
        search = replace(search, problem=problem, layout=layout, fits={}, renewed=set())
        if search.fit(best.model, best.x, best.here.near) is None:
            return self
        return self._by(search)

    def _beside(self, fit: Fit) -> Search[Weighing]:
        """A search from a fit, beside what that misses by beyond the noise."""
        search = replace(self.search, fits={fit.model: fit}, roughly=True)
        if not structure(self.data, seen_by(search.problem, fit)).significant:
            return search
        search = replace(search, problem=self._beside_misfit_of(fit), fits={})
        search.fit(fit.model, fit.x, fit.here.near)
        return search

    def _beside_misfit_of(self, fit: Fit) -> Weighing:
        """The problem beside what a fit misses by."""
        problem = self.search.problem
        here = problem.linearise(fit.x, self.search.layout.columns(fit.model), fit.here.near)
        return problem.beside_misfit(here)


def _offsets(data: Sequence[Data], seen: Seen) -> list[Creases] | None:
    return likeliest_offsets(data, [p.displacement for p in seen.predictions])
