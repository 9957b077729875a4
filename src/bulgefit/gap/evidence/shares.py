"""Which models have a say, and how much? Fitted ones, and those forecast near the best."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bulgefit.gap.evidence.neighbours import larger, smaller, swapped
from bulgefit.gap.evidence.problem import Model
from bulgefit.gap.evidence.search import REACH, Search

__all__ = ["scores"]

#: Models of a generation beyond which they are not looked around in: with sixty groups and more
#: that would take tens of thousands of forecasts.
MOST_ALIKE = 300


def scores(search: Search[Any], temper: float) -> dict[Model, float]:
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
    search : Search
    temper : float
        By which differences of the evidence are divided (`temper`): what the residual's smooth
        modes hold over what correlated noise would. A model that misses by more than the noise
        is thus as sure as the noise that it leaves lets it be.
    """
    best = search.best

    def tempered(model: Model, score: float) -> float:
        before = search.layout.believed(model)
        return (score - before) / temper + before

    known = {model: tempered(model, fit.score) for model, fit in search.fits.items()}
    if (around := search.seen_around(best)) is None:
        return known
    forecast = search.forecasts(around, best.model)
    reach = known[best.model] + REACH

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
        last = within(m for model in last for m in smaller(search.layout, model))
    others = within(swapped(search.layout, search.names, best.model))
    parts += others if len(others) <= MOST_ALIKE else []
    grown = within(m for model in parts for m in larger(search.layout, search.names, model))
    while 0 < len(grown) <= MOST_ALIKE:
        grown = within(m for model in grown for m in larger(search.layout, search.names, model))
    return known
