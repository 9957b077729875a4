"""Does each effect of the final model deserve its place, or would another do as well there?

Stepwise search takes what is best beside what is already there; with more effects in the model,
an early one may turn out to have stood in for others. The normal equations of everything that
could be freed, moved to where some effects are at their null, forecast every such exchange without
a solve; the promising ones are fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.keys import group_keys, null_of
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.search import (
    GAIN,
    GAIN_PER_PARAMETER,
    TIE,
    TIE_SHARE,
    Groups,
    Search,
)
from bulgefit.gap.structure import structure
from bulgefit.gap.universe import Universe

__all__ = ["Evidence", "evidence_of", "exchanged", "without_superfluous"]

#: Exchanges that are made at most, and fits that are tried for each.
MOST_EXCHANGES, MOST_TRIED = 3, 4
#: Share of what effects explain by which a linear forecast without them may err.
LINEAR = 0.02


@dataclass(frozen=True)
class Evidence:
    """Why an effect stands in the final model.

    Attributes
    ----------
    without, held_out : float
        Held-out sum of squares over the inflation: with the effect at its null and the rest
        refitted (to first order), and as it is.
    rivals : tuple of str
        Effects that do as well in its place.
    """

    without: float
    held_out: float
    rivals: tuple[str, ...]


@dataclass(frozen=True)
class _Exchange:
    """Effects that leave, the one that comes with its keys, and forecasts.

    `score` with it in their place, `without` the held-out sum of squares with nothing there, where
    `known` is everything that could be freed.
    """

    leaving: tuple[str, ...]
    effect: str
    keys: tuple[str, ...]
    score: float
    without: float
    known: Universe


def without_superfluous(
    search: Search, current: Regression, groups: Groups
) -> tuple[Regression, Groups]:
    """Drop effects that others have made superfluous, the most flexible first.

    Those whose loss held-out data do not mind, or leaves nothing that noise could not have made.
    """
    for effect in sorted(groups, key=lambda name: -search.size(groups[name])):
        if len(groups) == 1:
            break
        keys = groups[effect]
        search.say(f"without {effect}")
        kept = tuple(k for k in current.keys if k not in keys)
        start = {k: v for k, v in current.values.items() if k not in keys}
        try:
            fit = regress(search.data, kept, start, [p.shapes for p in current.predictions])
        except (SolveError, InputError):
            continue
        loss = fit.held_out() - current.held_out()
        if (
            loss < GAIN + GAIN_PER_PARAMETER * search.size(keys)
            or not structure(search.data, fit).significant
        ):
            current = fit
            groups = {name: group for name, group in groups.items() if name != effect}
    return current, groups


def exchanged(search: Search, current: Regression, groups: Groups) -> tuple[Regression, Groups]:
    """Put another effect in the place of one or two, while that scores better."""
    for _ in range(MOST_EXCHANGES):
        known = search.universe(current)
        here = _score(search, current, groups)
        options = _promising(search, known, current, groups, here)
        fits = (_tried(search, current, groups, option) for option in options)
        better = next((f for f in fits if f is not None and _score(search, *f) < here), None)
        if better is None:
            break
        current, groups = better
    return current, groups


def _promising(
    search: Search, known: Universe, current: Regression, groups: Groups, here: float
) -> list[_Exchange]:
    """The exchanges worth a fit, best first; one for each effect that comes for one or for two."""
    best: dict[tuple[str, int], _Exchange] = {}
    for leaving in chain(combinations(groups, 1), combinations(groups, 2)):
        for option in _forecasts(search, known, current, groups, leaving):
            kind = option.effect, len(leaving)
            # the further effects are from their null, the less a linear forecast is worth
            slack = max(TIE, LINEAR * (option.without - here))
            near = option.score < here + slack
            if near and (kind not in best or option.score < best[kind].score):
                best[kind] = option
    return sorted(best.values(), key=lambda option: option.score)[:MOST_TRIED]


def _score(search: Search, fit: Regression, groups: Groups) -> float:
    """Held-out sum of squares over the inflation, with the cost of the effects' parameters."""
    size = sum(search.size(keys) for keys in groups.values())
    return fit.held_out() + GAIN_PER_PARAMETER * size


def _forecasts(
    search: Search,
    known: Universe,
    current: Regression,
    groups: Groups,
    leaving: Sequence[str],
) -> Iterator[_Exchange]:
    """Every other effect in the place of those that leave, by one linear step."""
    dropped = [k for name in leaving for k in groups[name]]
    moved = known.moved({k: null_of(k, search.data) - current.values[k] for k in dropped})
    rest = [k for k in current.keys if k not in dropped]
    without = moved.held_out(rest)
    staying = sum(search.size(keys) for name, keys in groups.items() if name not in leaving)
    for effect in search.effects:
        if effect.id in groups:
            continue
        for group in effect.groups():
            keys = group_keys(group, len(search.data))
            if not set(keys) <= set(known.keys):
                continue  # out of reach
            held = moved.held_out([*rest, *keys])
            cost = GAIN_PER_PARAMETER * (staying + search.size(keys))
            yield _Exchange(tuple(leaving), effect.id, keys, held + cost, without, moved)


def _tried(
    search: Search, current: Regression, groups: Groups, option: _Exchange
) -> tuple[Regression, Groups] | None:
    """The fit with the exchange made; None where nothing balances."""
    search.say(f"{option.effect} in the place of {' + '.join(option.leaving)}")
    dropped = {k for name in option.leaving for k in groups[name]}
    keys = (*(k for k in current.keys if k not in dropped), *option.keys)
    start = {k: v for k, v in current.values.items() if k not in dropped}
    start.update(option.known.starts(keys, option.keys))
    try:
        fit = regress(search.data, keys, start, [p.shapes for p in current.predictions])
    except (SolveError, InputError):
        return None
    kept = {name: group for name, group in groups.items() if name not in option.leaving}
    return fit, {**kept, option.effect: option.keys}


def evidence_of(
    search: Search, known: Universe, current: Regression, groups: Groups, *, rivals: bool
) -> dict[str, Evidence]:
    """For each effect of the final model: what is lost without it, and what does as well.

    Rivals are looked for where asked: beside effects that explain a gap only in part, they would
    say nothing.
    """
    held = current.held_out()
    score = _score(search, current, groups)
    out = {}
    for name, keys in groups.items():
        moved = known.moved({k: null_of(k, search.data) - current.values[k] for k in keys})
        rest = [k for k in current.keys if k not in keys]
        # forecasts on both sides: at a bound, they promise what the fit may not take
        without = held + moved.held_out(rest) - known.held_out(current.keys)
        margin = max(TIE, TIE_SHARE * (without - held))
        as_good = []
        forecasts = _forecasts(search, known, current, groups, (name,)) if rivals else iter(())
        for effect, option in _best_of_each(forecasts).items():
            # forecasts are linear: those that come near are fitted
            larger = search.size(option.keys) > 2.0 * search.size(keys)
            if larger or option.score > score + 3.0 * margin:
                continue
            found = _tried(search, current, groups, option)
            if found is not None and _score(search, *found) < score + margin:
                as_good.append(effect)
        out[name] = Evidence(without, held, tuple(as_good))
    return out


def _best_of_each(options: Iterator[_Exchange]) -> dict[str, _Exchange]:
    best: dict[str, _Exchange] = {}
    for option in options:
        if option.effect not in best or option.score < best[option.effect].score:
            best[option.effect] = option
    return best
