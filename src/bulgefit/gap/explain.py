"""Which unmodelled effect explains the gap? Free effects, judge on what was not fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError, SolveError
from bulgefit.gap.effects import CATALOGUE, MODULI, Effect
from bulgefit.gap.regress import (
    Blocks,
    Data,
    Regression,
    names_of,
    normal_equations,
    own_key,
    regress,
    specimen_values,
    start_of,
)
from bulgefit.gap.structure import Structure, structure
from bulgefit.model.specimen import Prediction

__all__ = ["Candidate", "Explanation", "Round", "Universe", "explain", "universe"]

Floats = NDArray[np.float64]
Run = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]

#: Held-out improvement (sum of squares in noise units, correlation allowed for) that an effect
#: must bring, and more for each of its parameters.
GAIN, GAIN_PER_PARAMETER = 14.0, 2.5
#: Effects within this of the best, or within this share of its gain, are not told apart.
TIE, TIE_SHARE = 8.0, 0.01
MOST_ROUNDS = 6
#: Refits in the later rounds, best first by the linear forecast.
LATER_REFITS = 5
#: Steps that every candidate gets; the best are then fitted to the end, at most so many, if their
#: score came within this share of the best one's gain.
FIRST_STEPS, FINALISTS, FINAL_SHARE = 1, 4, 0.1


@dataclass(eq=False)
class Candidate:
    """An effect freed beside what is already in the model.

    Attributes
    ----------
    effect : str
    keys : tuple of str
        The group that was freed.
    fit : Regression
    held_out : float
        Held-out sum of squares over the inflation.
    """

    effect: str
    keys: tuple[str, ...]
    fit: Regression
    held_out: float

    @property
    def score(self) -> float:
        """Held-out misfit with the cost of its parameters."""
        return self.held_out + GAIN_PER_PARAMETER * len(self.keys)


@dataclass(eq=False)
class Round:
    """One stepwise addition: everything that was tried, and what was taken."""

    before: float
    candidates: list[Candidate]
    taken: Candidate | None
    ties: list[Candidate]


@dataclass(eq=False)
class Explanation:
    """What the search found.

    Attributes
    ----------
    baseline, final : Regression
    groups : dict of effect id to its freed keys
    rounds : list of Round
    remainder : Structure
        Of the final model's residual.
    skipped : dict of effect id to why
    """

    baseline: Regression
    final: Regression
    groups: dict[str, tuple[str, ...]]
    rounds: list[Round]
    start: Structure
    remainder: Structure
    skipped: dict[str, str] = field(default_factory=dict)


@dataclass(eq=False)
class Universe:
    """Normal equations of every parameter of every effect at one fit: forecasts cost nothing.

    Attributes
    ----------
    keys : tuple of str
    hessian : (cells, K, K) array
    gradient : (cells, K) array
    square : (cells,) array
    predictions : list of Prediction
        With derivatives by all keys that are the specimen's.
    values : dict
        Of the fit.
    """

    keys: tuple[str, ...]
    hessian: Floats
    gradient: Floats
    square: Floats
    predictions: list[Prediction]
    values: dict[str, float]

    def held_out(self, keys: Sequence[str], folds: Sequence[NDArray[np.int64]]) -> float:
        """Forecast of the held-out sum of squares with `keys` freed, by one linear step."""
        index = [self.keys.index(key) for key in keys]
        part = Regression(
            tuple(keys),
            {},
            self.hessian[:, index][:, :, index],
            self.gradient[:, index],
            self.square,
            np.zeros(len(self.square), dtype=np.int64),
            [],
            1.0,
            True,
        )
        return part.held_out(folds)

    def at(self, keys: Sequence[str]) -> list[Prediction]:
        """The predictions with derivatives by `keys` alone."""
        several, out = len(self.predictions) > 1, []
        for index, p in enumerate(self.predictions):
            names, _ = names_of(self.keys, index, several)
            wanted, _ = names_of(keys, index, several)
            rows = [names.index(name) for name in wanted]
            out.append(Prediction(p.displacement, p.derivative[rows], p.shapes))
        return out


def all_folds(data: Sequence[Data]) -> list[NDArray[np.int64]]:
    """Folds over the cells of all specimens."""
    folds: list[list[NDArray[np.int64]]] = [[] for _ in Blocks.folds(data[0].blocks)]
    first = 0
    for d in data:
        for fold, cells in zip(folds, d.blocks.folds(), strict=True):
            fold.append(cells + first)
        first += d.blocks.count
    return [np.concatenate(fold) for fold in folds]


def group_keys(names: Iterable[str], count: int) -> tuple[str, ...]:
    """Keys of a group of model parameters over `count` specimens."""
    keys: dict[str, None] = {}
    for name in names:
        for index in range(count):
            keys[own_key(name, index, count > 1)] = None
    return tuple(keys)


def universe(data: Sequence[Data], fit: Regression, effects: Sequence[Effect]) -> Universe:
    """Normal equations at a fit, by everything that could be freed."""
    names = [n for e in effects if not e.never_separable for n in e.all_keys]
    keys = tuple(dict.fromkeys([*fit.keys, *group_keys([*MODULI, *names], len(data))]))
    predictions = []
    for index, (d, p) in enumerate(zip(data, fit.predictions, strict=True)):
        wanted, _ = names_of(keys, index, len(data) > 1)
        predictions.append(d.specimen.predict(specimen_values(fit.values, index), wanted, p.shapes))
    h, g, square, _ = normal_equations(data, predictions, keys)
    return Universe(keys, h, g, square, predictions, dict(fit.values))


def _in_turn(task: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    return [task(item) for item in items]


def explain(
    data: Sequence[Data],
    effects: Sequence[Effect],
    baseline: Regression,
    settle: Callable[[Regression], Regression] = lambda fit: fit,
    say: Callable[[str], None] = lambda _: None,
    run: Run = _in_turn,
) -> Explanation:
    """Add effects one at a time while held-out data pay for them.

    Parameters
    ----------
    data : sequence of Data
    effects : sequence of Effect
        Candidates.
    baseline : Regression
        The moduli alone.
    settle : callable
        Given a fit with an effect more: renews what is known of noise and mesh, and fits again.
    say : callable
        Told what is being tried.
    run : callable
        Maps a task over items, in order: an executor's map as a list.
    """
    folds = all_folds(data)
    usable = [e for e in effects if not e.never_separable]
    current = baseline
    groups: dict[str, tuple[str, ...]] = {}
    start = remainder = structure(data, baseline)
    rounds: list[Round] = []
    for number in range(MOST_ROUNDS):
        if not remainder.significant:
            break
        found = _round(data, usable, current, groups, folds, say, run, first=number == 0)
        rounds.append(found)
        if found.taken is None:
            break
        groups[found.taken.effect] = found.taken.keys
        current = settle(found.taken.fit)
        remainder = structure(data, current)
    current, groups = _without_superfluous(data, current, groups, folds, say)
    return Explanation(baseline, current, groups, rounds, start, structure(data, current))


def _round(
    data: Sequence[Data],
    effects: Sequence[Effect],
    current: Regression,
    groups: dict[str, tuple[str, ...]],
    folds: Sequence[NDArray[np.int64]],
    say: Callable[[str], None],
    run: Run,
    *,
    first: bool,
) -> Round:
    known = universe(data, current, effects)
    inflation = current.inflation
    before = current.held_out(folds) / inflation
    forecasts = []
    for effect in effects:
        best = None
        for group in effect.groups():
            keys = group_keys(group, len(data))
            extra = tuple(k for k in keys if k not in current.keys)
            if not extra:
                continue
            held = known.held_out((*current.keys, *extra), folds) / inflation
            score = held + GAIN_PER_PARAMETER * len(keys)
            if best is None or score < best[0]:
                best = (score, effect.id, keys, extra)
        if best is not None:
            forecasts.append(best)
    forecasts.sort(key=lambda item: item[0])

    def attempt(item: tuple[float, str, tuple[str, ...], tuple[str, ...]]) -> Candidate | None:
        _, effect_id, keys, extra = item
        say(f"{' + '.join([*groups, effect_id])} ({len(keys)} parameters)")
        fit = _refit(data, current, extra, known)
        if fit is None:
            return None
        return Candidate(effect_id, keys, fit, fit.held_out(folds) / inflation)

    def finish(candidate: Candidate) -> Candidate:
        if candidate.fit.converged:
            return candidate
        say(f"{' + '.join([*groups, candidate.effect])}, to the end")
        near = [p.shapes for p in candidate.fit.predictions]
        fit = regress(data, candidate.fit.keys, candidate.fit.values, near)
        return Candidate(candidate.effect, candidate.keys, fit, fit.held_out(folds) / inflation)

    tried = run(attempt, forecasts if first else forecasts[:LATER_REFITS])
    candidates = sorted((c for c in tried if c is not None), key=lambda c: c.score)
    if candidates:
        reach = candidates[0].score + max(2 * TIE, FINAL_SHARE * (before - candidates[0].held_out))
        finalists = [c for c in candidates[:FINALISTS] if c.score <= reach]
        candidates[: len(finalists)] = run(finish, finalists)
        candidates.sort(key=lambda c: c.score)
    if not candidates:
        return Round(before, [], None, [])
    best_one = candidates[0]
    extra_count = len(set(best_one.keys) - set(current.keys))
    if before - best_one.held_out < GAIN + GAIN_PER_PARAMETER * extra_count:
        return Round(before, candidates, None, [])
    margin = max(TIE, TIE_SHARE * (before - best_one.held_out))
    ties = [c for c in candidates[1:] if c.score < best_one.score + margin]
    # the smallest of those that are not told apart stands for them
    taken = min([best_one, *ties], key=lambda c: len(c.keys))
    ties = [c for c in [best_one, *ties] if c is not taken and len(c.keys) <= 2 * len(taken.keys)]
    return Round(before, candidates, taken, ties)


def _refit(
    data: Sequence[Data], current: Regression, extra: Sequence[str], known: Universe
) -> Regression | None:
    """First steps with `extra` freed, from the current fit; None where nothing balances."""
    start, at_null = dict(current.values), True
    for key in extra:
        name, _, owner = key.partition("@")
        own = data[int(owner) if owner else 0]
        start[key] = start_of(name, own)
        at_null &= start[key] == own.specimen.nulls().get(name, 0.0)
    keys = (*current.keys, *extra)
    try:
        return regress(
            data,
            keys,
            start,
            [p.shapes for p in current.predictions],
            iterations=FIRST_STEPS,
            known=known.at(keys) if at_null else None,
        )
    except (SolveError, InputError):
        return None


def _without_superfluous(
    data: Sequence[Data],
    current: Regression,
    groups: dict[str, tuple[str, ...]],
    folds: Sequence[NDArray[np.int64]],
    say: Callable[[str], None],
) -> tuple[Regression, dict[str, tuple[str, ...]]]:
    """Drop effects that later ones have made superfluous."""
    for effect in list(groups)[:-1]:
        keys = groups[effect]
        say(f"without {effect}")
        kept = tuple(k for k in current.keys if k not in keys)
        start = {k: v for k, v in current.values.items() if k not in keys}
        try:
            fit = regress(data, kept, start, [p.shapes for p in current.predictions])
        except (SolveError, InputError):
            continue
        loss = (fit.held_out(folds) - current.held_out(folds)) / current.inflation
        if loss < GAIN + GAIN_PER_PARAMETER * len(keys):
            current = fit
            groups = {name: group for name, group in groups.items() if name != effect}
    return current, groups


def effect_of(key: str) -> str:
    """Effect that a freed key belongs to, "" for a modulus."""
    name = key.partition("@")[0].partition(".")[0]
    return name if name in CATALOGUE else ""
