"""Which unmodelled effect explains the gap? Free effects, judge on what was not fitted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

from bulgefit.effects.base import Effect
from bulgefit.errors import InputError, SolveError
from bulgefit.gap.data import Data
from bulgefit.gap.doubt import Doubt, doubt
from bulgefit.gap.exchange import (
    Evidence,
    evidence_of,
    exchanged,
    fits_without,
    without_superfluous,
)
from bulgefit.gap.forms import in_smallest_forms, smallest_form
from bulgefit.gap.keys import columns_of, effect_of, is_field, null_of, start_of
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.search import (
    GAIN,
    GAIN_PER_PARAMETER,
    TIE,
    TIE_SHARE,
    Candidate,
    Groups,
    Search,
)
from bulgefit.gap.structure import Structure, structure
from bulgefit.gap.universe import Universe, forms_in_reach, observed
from bulgefit.model.inflation import Shapes
from bulgefit.parallel.spread import spread
from bulgefit.parallel.threads import one_blas_thread

__all__ = ["Explanation", "Round", "explain"]

#: Effects that are added at most, also in a thorough search.
MOST_EFFECTS, MOST_THOROUGH = 4, 8
#: An effect that takes less than this share of what is left beyond the noise, and leaves structure,
#: is the last: more of them would only pile up on what none explains. A thorough search goes on.
LEAST_SHARE = 0.1
#: Refits in the later rounds, best first by the linear forecast; effects that start off their null,
#: since they are of second order there, are tried beyond.
LATER_REFITS = 5
#: Steps that every candidate gets; the best are then fitted to the end (or so many steps), at most
#: so many, if their score came within this share of the best one's gain.
FIRST_STEPS, LAST_STEPS, FINALISTS, FINAL_SHARE = 1, 8, 4, 0.1


@dataclass(eq=False)
class Round:
    """One stepwise addition: everything that was tried, and what was taken."""

    before: float
    candidates: list[Candidate]
    taken: Candidate | None


@dataclass(eq=False)
class Explanation:
    """What the search found.

    Attributes
    ----------
    baseline, final : Regression
    known : Universe
        Sensitivities to everything that could be freed, at the final model.
    groups : dict of effect id to its freed keys
    evidence : dict of effect id to Evidence
    rounds : list of Round
    start, remainder : Structure
        Of the baseline's residual and of the final model's.
    doubt : Doubt
        Why the effects do not explain the gap; "" where they do.
    """

    baseline: Regression
    final: Regression
    known: Universe
    groups: dict[str, tuple[str, ...]]
    evidence: dict[str, Evidence]
    rounds: list[Round]
    start: Structure
    remainder: Structure
    doubt: Doubt

    @property
    def partial(self) -> bool:
        """The effects explain a part of the gap only, if any."""
        return self.doubt != ""


def explain(
    data: Sequence[Data],
    effects: Sequence[Effect],
    baseline: Regression,
    executor: Executor,
    settle: Callable[[Regression], Regression] = lambda fit: fit,
    say: Callable[[str], None] = lambda _: None,
    *,
    thorough: bool = False,
) -> Explanation:
    """Add effects one at a time while held-out data pay for them.

    Parameters
    ----------
    data : sequence of Data
    effects : sequence of Effect
        Candidates.
    baseline : Regression
        The moduli alone.
    executor : concurrent.futures.Executor
        Refits candidates side by side.
    settle : callable
        Given a fit with an effect more: renews what is known of noise and mesh, and fits again.
    say : callable
        Told what is tried.
    thorough : bool
        Add up to `MOST_THOROUGH` effects.
    """
    usable = [e for e in effects if not e.never_separable]
    search = Search(data, usable, executor, say)
    current = baseline
    search.remember(current)
    groups: Groups = {}
    start = remainder = structure(data, baseline)
    rounds: list[Round] = []
    most = MOST_THOROUGH if thorough else MOST_EFFECTS
    while remainder.significant:
        found = _round(search, current, groups, most)
        rounds.append(found)
        if found.taken is None:
            break
        current = settle(found.taken.fit)
        search.remember(current)
        groups = _still_freed({**groups, found.taken.effect: found.taken.keys}, current)
        remainder = structure(data, current)
        gained = found.before - found.taken.held_out
        if not thorough and gained < LEAST_SHARE * (found.before - current.floor):
            break
    if 1 < len(groups) <= MOST_EFFECTS and remainder.significant:
        other, others = exchanged(search, current, groups, largely=True)
        if others != groups:
            current, groups = settle(other), others
            remainder = structure(data, current)
    # what explains a gap in part only is not worth the time that weighing it against others takes
    if thorough or not remainder.significant:
        current, groups, without = without_superfluous(search, current, groups)
    else:
        without = fits_without(search, current, groups)
    if 1 < len(groups) <= MOST_EFFECTS and not remainder.significant:
        current, groups = exchanged(search, current, groups)
        current, groups = in_smallest_forms(search, settle(current), groups)
        current, groups, without = without_superfluous(search, current, groups)
    known = search.universe(current)
    remainder = structure(data, current)
    # where nothing balances without an effect, it may be as bad as the moduli alone
    without_each = {name: fit or baseline for name, fit in without.items()}
    why = doubt(search, baseline, current, groups, without_each, remainder)
    return Explanation(
        baseline,
        current,
        known,
        groups,
        evidence_of(search, known, current, groups, without, worst=baseline, rivals=not why),
        rounds,
        start,
        remainder,
        why,
    )


def _still_freed(groups: Groups, current: Regression) -> Groups:
    """Groups without what an offset of every point has taken the place of."""
    kept = {name: tuple(k for k in keys if k in current.keys) for name, keys in groups.items()}
    return {name: keys for name, keys in kept.items() if keys}


def _round(search: Search, current: Regression, groups: Groups, most: int) -> Round:
    """Free each effect beside what is in the model; take the one that held-out data pay for.

    Once there are so many effects as may be, only larger forms of them are tried.
    """
    known = search.universe(current)
    before = current.held_out()
    forecasts = [
        forecast
        for forecast in _forecasts(search, known, current)
        if len(groups) < most or forecast[1] in groups
    ]

    def finished(candidates: Sequence[Candidate]) -> list[Candidate]:
        def said(index: int, _: Regression) -> None:
            one = candidates[index]
            search.say(f"{_trial_name(groups, one.effect, one.keys)}, to the end")

        fits = [c.fit for c in candidates]
        ends = spread(search.executor, _last_steps, (search.data, fits), range(len(fits)), said)
        return [
            search.candidate(c.effect, c.keys, end) for c, end in zip(candidates, ends, strict=True)
        ]

    chosen = [
        forecast
        for place, forecast in enumerate(forecasts)
        if not groups or place < LATER_REFITS or _starts_off_null(search, forecast[2])
    ]
    freed = [search.freed(current, effect, keys) for _, effect, keys in chosen]
    fits = spread(
        search.executor,
        _first_steps,
        (search.data, current, [p.shapes for p in known.predictions]),
        [(keys, known.starts(keys, [k for k in keys if k not in current.keys])) for keys in freed],
        lambda index, _: search.say(_trial_name(groups, *chosen[index][1:])),
    )
    for fit in fits:
        if fit is not None and fit.chi_square < current.chi_square:
            search.remember(fit)
    # by its forecast or by its first step, whichever promises more: both may err
    promised = sorted(
        (
            (min(score, candidate.score), candidate)
            for (score, effect, keys), fit in zip(chosen, fits, strict=True)
            if fit is not None
            for candidate in [search.candidate(effect, keys, fit, realised=False)]
        ),
        key=lambda item: item[0],
    )
    candidates = [candidate for _, candidate in promised]
    if not candidates:
        return Round(before, [], None)
    reach = promised[0][0] + max(2 * TIE, FINAL_SHARE * (before - promised[0][0]))
    finalists = [c for promise, c in promised[:FINALISTS] if promise <= reach]
    candidates[: len(finalists)] = finished(finalists)
    candidates.sort(key=lambda c: c.score)
    ended = {c.effect for c in finalists}
    while candidates[0].effect not in ended:  # a forecast that now leads
        ended.add(candidates[0].effect)
        candidates[:1] = finished(candidates[:1])
        candidates.sort(key=lambda c: c.score)
    return _judged(search, before, candidates, current)


def _starts_off_null(search: Search, keys: Sequence[str]) -> bool:
    """Whether a linear forecast from the null says little of what keys can do."""
    return any(start_of(k, search.data) != null_of(k, search.data) for k in columns_of(keys))


def _trial_name(groups: Iterable[str], effect: str, keys: Sequence[str]) -> str:
    """What is being tried, for progress: the last effect is the new one, or grows."""
    size = "an offset of every point" if is_field(keys[0]) else f"{len(keys)} parameters"
    return f"{' + '.join([*(g for g in groups if g != effect), effect])} ({size})"


def _forecasts(
    search: Search, known: Universe, current: Regression
) -> list[tuple[float, str, tuple[str, ...]]]:
    """Score, effect and keys of each effect's best group by one linear step, best first."""
    out = []
    for effect in search.effects:
        options = []
        for keys in forms_in_reach(current, effect, len(search.data)):
            if search.grows(current, effect.id, keys) and set(columns_of(keys)) <= set(known.keys):
                held = _forecast(search, known, current, effect.id, keys)
                options.append((held + GAIN_PER_PARAMETER * search.size(keys), effect.id, keys))
        out += sorted(options, key=lambda item: item[0])[:1]
    return sorted(out, key=lambda item: item[0])


def _forecast(
    search: Search, known: Universe, current: Regression, effect: str, keys: tuple[str, ...]
) -> float:
    """Held-out misfit with an effect in this form, by one linear step."""
    freed = search.freed(current, effect, keys)
    gone = [k for k in current.keys if k not in freed]
    field = [k for k in keys if is_field(k)]
    here = known.with_field(field) if field and not known.field else known
    return here.moved({k: null_of(k, search.data) - current.values[k] for k in gone}).held_out(
        freed
    )


def _judged(
    search: Search, before: float, candidates: list[Candidate], current: Regression
) -> Round:
    """The best candidate if it pays, in its smallest form."""
    best = candidates[0]
    extra = search.size(best.fit.keys) - search.size(current.keys)
    if before - best.held_out < GAIN + GAIN_PER_PARAMETER * extra:
        return Round(before, candidates, None)
    size_before = search.size(k for k in current.keys if effect_of(k) == best.effect)
    fit, keys = smallest_form(search, best.fit, best.effect, best.keys, size_before)
    candidates[0] = best = search.candidate(best.effect, keys, fit)
    margin = max(TIE, TIE_SHARE * (before - best.held_out))
    ties = [c for c in candidates[1:] if c.score < best.score + margin]
    # the smallest of those that are not told apart stands for them
    taken = min([best, *ties], key=lambda c: c.size)
    return Round(before, candidates, taken)


def _first_steps(
    here: tuple[Sequence[Data], Regression, Sequence[Shapes]],
    item: tuple[Sequence[str], Mapping[str, float]],
) -> Regression | None:
    """First steps with others freed, from where the new ones start; None where nothing balances.

    From the data, the current fit, and its shapes with derivatives by all that could be freed.
    """
    data, current, shapes = here
    freed, new = item
    gone = set(current.keys) - set(freed)
    start = {**{k: v for k, v in current.values.items() if k not in gone}, **new}
    at_null = not gone and all(value == null_of(k, data) for k, value in new.items())
    near = [p.shapes for p in current.predictions]
    try:
        with one_blas_thread():
            return regress(
                data,
                freed,
                start,
                near,
                iterations=FIRST_STEPS,
                known=observed(data, shapes, freed) if at_null else None,
            )
    except (SolveError, InputError):
        return None


def _last_steps(here: tuple[Sequence[Data], Sequence[Regression]], index: int) -> Regression:
    """One of several fits, on to its end."""
    data, fits = here
    fit = fits[index]
    if fit.converged:
        return fit
    near = [p.shapes for p in fit.predictions]
    with one_blas_thread():
        return regress(data, fit.keys, fit.values, near, iterations=LAST_STEPS)
