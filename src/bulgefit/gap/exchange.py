"""Does each effect of the final model deserve its place, or would another do as well there?

Stepwise search takes what is best beside what is already there; with more effects in the model,
an early one may turn out to have stood in for others. The normal equations of everything that
could be freed, moved to where some effects are at their null, forecast every such exchange without
a solve; the promising ones are fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

from bulgefit.gap.keys import group_keys, null_of
from bulgefit.gap.regress import MAX_ITERATIONS, Regression
from bulgefit.gap.search import (
    GAIN,
    GAIN_PER_PARAMETER,
    TIE,
    TIE_SHARE,
    Groups,
    Search,
    Trial,
)
from bulgefit.gap.structure import structure
from bulgefit.gap.universe import Universe

__all__ = ["Evidence", "evidence_of", "exchanged", "fits_without", "without_superfluous"]

#: Exchanges that are made at most, fits that are tried for each, and steps that each of them gets.
MOST_EXCHANGES, MOST_TRIED, STEPS = 3, 4, 8
#: Share of what is left beyond the noise that an exchange has to promise where structure is left.
LARGELY = 0.5
#: Share of what effects explain by which a linear forecast without them may err.
LINEAR = 0.02


@dataclass(frozen=True)
class Evidence:
    """Why an effect stands in the final model.

    Attributes
    ----------
    without : Regression or None
        The rest refitted with the effect at its null; None where that finds no equilibrium.
    held_out : float
        Held-out sum of squares over the inflation of the final model.
    rivals : tuple of str
        Effects that do as well in its place.
    """

    without: Regression | None
    held_out: float
    rivals: tuple[str, ...]


@dataclass(frozen=True)
class _Exchange:
    """Effects that leave, the one that comes or grows, with all its keys, and forecasts.

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
) -> tuple[Regression, Groups, dict[str, Regression | None]]:
    """Drop effects that others have made superfluous, the most flexible first.

    Those whose loss held-out data do not mind, or leaves nothing that noise could not have made.
    The last effect stays. Returned with `fits_without` of what is left.
    """
    while True:
        without = fits_without(search, current, groups)
        superfluous = {
            name: fit
            for name, fit in without.items()
            if fit is not None and _is_enough(search, current, fit, groups[name])
        }
        if len(groups) < 2 or not superfluous:
            return current, groups, without
        gone = max(superfluous, key=lambda name: search.size(groups[name]))
        current = superfluous[gone]
        groups = {name: keys for name, keys in groups.items() if name != gone}


def fits_without(
    search: Search, current: Regression, groups: Groups
) -> dict[str, Regression | None]:
    """The fit without each effect of a model; None where nothing balances."""
    trials = [_trial_without(search, current, name, keys) for name, keys in groups.items()]
    return dict(zip(groups, search.fits(current, trials), strict=True))


def _trial_without(search: Search, current: Regression, effect: str, keys: Sequence[str]) -> Trial:
    return Trial(
        f"without {effect}",
        tuple(k for k in current.keys if k not in keys),
        {k: v for k, v in current.values.items() if k not in keys},
        # where an early fit of the rest got stuck, an effect that does nothing would seem to matter
        sure=search.loss_without(current, keys) < _loss_allowed(search, keys),
    )


def _loss_allowed(search: Search, keys: Sequence[str]) -> float:
    return GAIN + GAIN_PER_PARAMETER * search.size(keys)


def _is_enough(search: Search, current: Regression, fit: Regression, keys: Sequence[str]) -> bool:
    """Whether a fit without `keys` does, beside the current one with them."""
    loss = fit.held_out() - current.held_out()
    return loss < _loss_allowed(search, keys) or not structure(search.data, fit).significant


def exchanged(
    search: Search, current: Regression, groups: Groups, *, largely: bool = False
) -> tuple[Regression, Groups]:
    """Put another effect in the place of one or two, while that scores better.

    With `largely` only where a forecast has that take off `LARGELY` of what is left beyond the
    noise.
    """
    left: list[set[str]] = []
    for _ in range(MOST_EXCHANGES):
        known = search.universe(current)
        here = _score(search, current, groups)
        left.append(set(groups))
        options = _promising(search, known, current, groups, here, left)
        if largely:
            most = here - LARGELY * (here - current.floor)
            options = [option for option in options if option.score < most]
        tried = _tried(search, current, groups, options, STEPS)
        better = [pair for pair in tried if pair is not None and _score(search, *pair) < here]
        if not better:
            break
        current, groups = min(better, key=lambda pair: _score(search, *pair))
    return current, groups


def _promising(
    search: Search,
    known: Universe,
    current: Regression,
    groups: Groups,
    here: float,
    left: Sequence[set[str]],
) -> list[_Exchange]:
    """The exchanges worth a fit, best first; one for each effect that comes for one or for two.

    None leads back to effects that were left.
    """
    best: dict[tuple[str, int], _Exchange] = {}
    for leaving in chain(combinations(groups, 1), combinations(groups, 2)):
        for option in _forecasts(search, known, current, groups, leaving):
            kind = option.effect, len(leaving)
            # the further effects are from their null, the less a linear forecast is worth
            slack = max(TIE, LINEAR * (option.without - here))
            near = option.score < here + slack and set(_after(groups, option)) not in left
            if near and (kind not in best or option.score < best[kind].score):
                best[kind] = option
    return sorted(best.values(), key=lambda option: option.score)[:MOST_TRIED]


def _score(search: Search, fit: Regression, groups: Groups) -> float:
    """Held-out sum of squares over the inflation, with the cost of the effects' parameters."""
    return fit.held_out() + GAIN_PER_PARAMETER * _size(search, groups)


def _size(search: Search, groups: Groups) -> float:
    return sum(search.size(keys) for keys in groups.values())


def _forecasts(
    search: Search,
    known: Universe,
    current: Regression,
    groups: Groups,
    leaving: Sequence[str],
) -> Iterator[_Exchange]:
    """Other effects, or larger forms of those that stay, for those that leave, by a linear step."""
    dropped = [k for name in leaving for k in groups[name]]
    moved = known.moved({k: null_of(k, search.data) - current.values[k] for k in dropped})
    rest = [k for k in current.keys if k not in dropped]
    without = moved.held_out(rest)
    for effect in search.effects:
        if effect.id in leaving:
            continue
        for group in effect.groups():
            keys = group_keys(group, len(search.data))
            if not set(groups.get(effect.id, ())) < set(keys) <= set(known.keys):
                continue  # in the model already, or out of reach
            held = moved.held_out(dict.fromkeys([*rest, *keys]))
            option = _Exchange(tuple(leaving), effect.id, keys, held, without, moved)
            cost = GAIN_PER_PARAMETER * _size(search, _after(groups, option))
            yield replace(option, score=held + cost)


def _tried(
    search: Search,
    current: Regression,
    groups: Groups,
    options: Sequence[_Exchange],
    steps: int = MAX_ITERATIONS,
) -> list[tuple[Regression, Groups] | None]:
    """The fits with each exchange made; None where nothing balances."""
    fits = search.fits(current, [_trial_of(current, groups, option) for option in options], steps)
    return [
        None if fit is None else (fit, _after(groups, option))
        for fit, option in zip(fits, options, strict=True)
    ]


def _trial_of(current: Regression, groups: Groups, option: _Exchange) -> Trial:
    dropped = {k for name in option.leaving for k in groups[name]}
    start = {k: v for k, v in current.values.items() if k not in dropped}
    keys = tuple(dict.fromkeys([*(k for k in current.keys if k not in dropped), *option.keys]))
    start.update(option.known.starts(keys, [k for k in option.keys if k not in start]))
    return Trial(f"{option.effect} in the place of {' + '.join(option.leaving)}", keys, start)


def _after(groups: Groups, option: _Exchange) -> Groups:
    kept = {name: group for name, group in groups.items() if name not in option.leaving}
    return {**kept, option.effect: option.keys}


def evidence_of(
    search: Search,
    known: Universe,
    current: Regression,
    groups: Groups,
    without: Mapping[str, Regression | None],
    *,
    worst: Regression,
    rivals: bool,
) -> dict[str, Evidence]:
    """For each effect of the final model: what is lost without it, and what does as well.

    Where nothing balances without an effect, that may be as bad as `worst`. Rivals are looked for
    where asked: beside effects that explain a gap only in part, they would say nothing.
    """
    held, score = current.held_out(), _score(search, current, groups)
    lost = {name: (fit or worst).held_out() - held for name, fit in without.items()}
    margin = {name: max(TIE, TIE_SHARE * loss) for name, loss in lost.items()}
    # forecasts are linear: those that come near are fitted
    near = [
        option
        for name, keys in (groups.items() if rivals else ())
        for option in _best_of_each(_forecasts(search, known, current, groups, (name,)))
        if option.effect not in groups
        and search.size(option.keys) <= 2.0 * search.size(keys)
        and option.score <= score + 3.0 * margin[name]
    ]
    as_good: dict[str, list[str]] = {name: [] for name in groups}
    for option, found in zip(near, _tried(search, current, groups, near), strict=True):
        (name,) = option.leaving
        if found is not None and _score(search, *found) < score + margin[name]:
            as_good[name].append(option.effect)
    return {name: Evidence(without[name], held, tuple(as_good[name])) for name in groups}


def _best_of_each(options: Iterator[_Exchange]) -> Iterable[_Exchange]:
    """Each effect's best form."""
    best: dict[str, _Exchange] = {}
    for option in options:
        if option.effect not in best or option.score < best[option.effect].score:
            best[option.effect] = option
    return best.values()
