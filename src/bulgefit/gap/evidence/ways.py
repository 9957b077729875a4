"""Which ways lead to the best model? From everything, from the smallest, and with fields.

Each may be trapped: effects may take what is a field's, and fields what is an effect's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.improve import improved
from bulgefit.gap.evidence.problem import Problem, freeze
from bulgefit.gap.evidence.search import GROWN, Search
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["Ways"]

Kind = TypeVar("Kind", bound=Problem)

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ways(Generic[Kind]):
    """Ways to the best model, since each may be trapped.

    Attributes
    ----------
    search : Search
    start : (n,) array
        Coordinates from which something balances.
    near : object
        What a neighbouring point is sooner found from, or None.
    fields : tuple of Owned
        Groups that are freed by some ways alone.
    origin : (n,) array, optional
        Where nothing but what every model has departs from its null; default: `start`.
    doubted : bool
        The start is where a descent to the noise was given up.
    """

    search: Search[Kind]
    start: Floats
    near: object = None
    fields: tuple[Owned, ...] = ()
    origin: Floats | None = None
    doubted: bool = False

    @property
    def named(self) -> tuple[Owned, ...]:
        """Groups without the fields."""
        return tuple(n for n in self.search.names if n not in self.fields)

    @property
    def _named(self) -> Search[Kind]:
        """The same search without fields; what it fits counts for both."""
        return replace(self.search, names=self.named)

    def by_elimination(self, hopeful: Callable[[], bool] = lambda: True) -> None:
        """Everything but the fields is freed at once, and thinned.

        Parameters
        ----------
        hopeful : callable
            Whether, by what was fitted so far, thinning may lead anywhere.
        """
        named = self._named
        whole = named.layout.whole(named.names)
        found = named.fit(
            whole,
            self.start,
            self.near,
            roughly=True,
            hope=named.problem.noise,
            doubted=self.doubted,
        )
        if found is not None and hopeful():
            improved(named, found)

    def from_below(self, *, to_noise: bool = False) -> None:
        """Groups, but no fields, are added to the smallest model, fewer than the best one has.

        With as many, what began with the wrong one would only gather others about it.

        Parameters
        ----------
        to_noise : bool
            As long as the groups that may still be added may lead down to the noise.

        Raises
        ------
        SolveError
            Nothing balances at the start, and no model was fitted.
        """
        named = self._named
        fewer = len(named.best.model) - 1 if named.fits else None
        rough = named if fewer is None else replace(named, roughly=True, share=GROWN)
        small = rough.fit(freeze({}), self.start, self.near)
        if small is not None:
            improved(rough, small, fewer, to_noise=to_noise)
        elif not named.fits:
            # the same solve once more: its error says where and why nothing balances
            none = named.layout.columns(freeze({}))
            named.problem.linearise(self.start, none, self.near)

    def from_fields(self) -> None:
        """Effects are added to each field of the best model alone, fewer than that one has.

        Several effects may stand for what is a field's; beside it they are no worse than before,
        and far from where they can be let go. Without it they lead where they led from below.
        """
        model = self.search.best.model
        fields = [(name, form) for name, form in sorted(model) if name in self.fields]
        if fields and len(model) > 1:
            self.search.say("each field by itself")
            alone = replace(self, search=self.search.alone(), near=None)
            self.search.abreast(_from_field, alone, fields)

    def with_fields(self, *, thorough: bool = False) -> Fit | None:
        """Everything is freed from the origin; if that is a trap, with the fields freed last.

        Effects may take what is a field's, and fields what is an effect's. A model that is worse
        than one it contains was trapped.

        Parameters
        ----------
        thorough : bool
            From both starts in any case.
        """
        layout = self.search.layout
        whole = layout.whole(self.search.names)
        origin = self.start if self.origin is None else self.origin
        starts = [(origin, None), (self.start, self.near)]
        if (first := self.search.fits.get(layout.whole(self.named))) is not None:
            starts[1] = (first.x, first.here.near)
        rough = self.search if thorough else replace(self.search, share=GROWN)
        for start, near in starts:
            found = rough.fit(whole, start, near, roughly=True)
            if found is not None and found is self.search.best and not thorough:
                break
        return self.search.fits.get(whole)

    def every(self) -> None:
        """All of them, one after another; raises SolveError where none leads anywhere."""
        self.by_elimination()
        self.from_below()
        if self.fields and (found := self.with_fields(thorough=True)) is not None:
            improved(self.search, found)
        improved(self.search, self.search.best)


def _from_field(ways: Ways[Any], part: tuple[Owned, int]) -> list[Fit]:
    """What is found on the way from a field of the best model."""
    name, form = part
    best, own = ways.search.best, ways.search.alone()
    names = tuple(n for n in own.names if n == name or n not in ways.fields)
    search = replace(own, roughly=True, share=GROWN, names=names)
    origin = ways.start if ways.origin is None else ways.origin
    with one_blas_thread():
        alone = search.fit(freeze({name: form}), origin)
        if alone is not None:
            improved(search, alone, len(best.model) - 1, keep=name)
    return [fit for model, fit in search.fits.items() if model != best.model]
