"""Diagnose the gap between the virtual and the measured test."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.given import GivenTests, distinctly_named, given_tests
from bulgefit.effects.base import Effect
from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import fields, scatter
from bulgefit.errors import InputError, SolveError
from bulgefit.fitting.problem import Prior
from bulgefit.gap.causes import causes_of, verdict_of
from bulgefit.gap.caveats import in_doubt, lacked_by, left_of_the_mesh, left_out, of_the_fits
from bulgefit.gap.data import Data
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.effects import MODULI, chosen_effects
from bulgefit.gap.explain import explain
from bulgefit.gap.explanation import Explanation
from bulgefit.gap.follow_up.advise import advise
from bulgefit.gap.follow_up.holdout import judge_held_out
from bulgefit.gap.follow_up.separate import STIFFNESS, Pair, indistinguishable
from bulgefit.gap.implied_reference import implied_references
from bulgefit.gap.law_table import law_table
from bulgefit.gap.pace import Pace, Stage
from bulgefit.gap.prepare import (
    Prepared,
    drop_outliers,
    judge_mesh,
    prepare,
    renew_noise,
    settle,
)
from bulgefit.gap.regress import Regression, regress, starting_moduli
from bulgefit.gap.residual.locate import azimuthal_modes
from bulgefit.gap.residual.measure import fitted_gap, held_out_gap, noise_gap, weight_of
from bulgefit.gap.scatter import scatter_of
from bulgefit.model.description import check_needs
from bulgefit.model.parameters import as_effects
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.parallel.workers import open_executor

__all__ = ["diagnose"]


def diagnose(
    tests: GivenTests,
    *,
    holdout: BulgeTest | None = None,
    effects: Iterable[str] | None = None,
    law: str = "hencky",
    thorough: bool = False,
    same_rig: bool = False,
    priors: Mapping[str, Prior] | None = None,
    held: Mapping[str, float] | None = None,
    seed: int = 0,
    executor: Executor | None = None,
    workers: int = 1,
    say: Callable[[str], None] = lambda _: None,
    left: Callable[[float, float], None] = lambda least, most: None,
) -> Diagnosis:
    """Where the model misses, which unmodelled effect causes it, and how far the gap shrinks.

    Parameters
    ----------
    tests : BulgeTest, path, or sequence of them
        Several are specimens of one cloth and judged together: they share its law, about which each
        has factors of its own along warp and fill, and the face that is seen; all other effects are
        each test's own.
    holdout : BulgeTest, optional
        A specimen that takes no part: what specimens share comes from the others, what it has of
        its own is looked for on every second frame, and it is judged on the rest.
    effects : iterable of str, optional
        Candidates; default: the whole catalogue.
    law : {"hencky", "svk", "yarn"}
    thorough : bool
        Search by every way, also where the first leaves nothing but noise.
    same_rig : bool
        Several tests share what belongs to clamp and cameras: the clamp's shape, lens and scales.
    priors : mapping of name to Prior, optional
        What is believed of E1, E2 and G12 (MPa); default: a decade either way.
    held : mapping of str to float, optional
        What is known of every test: parameters (`effect.parameter`) of effects that every model
        has, and that are not looked for.
    seed : int
        Kept for the record; the search draws nothing at random.
    executor : concurrent.futures.Executor, optional
        Fits what does not wait for each other side by side: processes, or `Client.get_executor()`
        of Dask; the result does not depend on it. The measured data reach each process once.
    workers : int
        Threads that balance frames side by side, here and in each process of an executor; where
        no executor is given, also threads that take its place.
    say : callable
        Told what is tried.
    left : callable
        Told the least and the most seconds that are left, whenever a stage begins.

    Raises
    ------
    InputError
        Unknown parameters, or values that mean nothing, among those held; effects that are both
        held and candidates. A test with too few points or frames to judge, or without one of the
        components; unknown effects; tests that state different Poisson ratios; priors of other
        parameters, or that are none.
    SolveError
        The baseline finds no equilibrium.
    """
    began = time.perf_counter()
    given, holdout = _given(tests, holdout)
    known, believed = as_effects(held), _believed(priors or {})
    wanted = _not_held(chosen_effects(effects), known, named=effects is not None)
    lacking = _lacking(wanted, given)
    candidates = [e for e in wanted if e.id not in lacking]
    for test in (*given, *([holdout] if holdout else [])):
        check_needs(known, test)
    own = open_executor(workers) if executor is None else nullcontext(executor)
    with one_blas_thread(), own as pool:
        prepared = [prepare(test, law, workers, known) for test in given]
        kept_out = None if holdout is None else prepare(holdout, law, workers, known)
        data = [p.data for p in prepared]
        pace = Pace(left)
        say("baseline: the moduli alone")
        baseline = _baseline(prepared)
        found = explain(
            prepared,
            candidates,
            baseline,
            pool,
            say,
            pace,
            thorough=thorough,
            same_rig=same_rig,
            priors=believed,
        )
        baseline = found.baseline
        pace.begins(Stage.REST)
        say("held-out gap")
        for one, prediction in zip(prepared, found.final.predictions, strict=True):
            judge_mesh(one, prediction.shapes)
        gaps = _gaps(data, found)
        pairs = indistinguishable(found.known)
        pairs[:0] = [Pair((e.id, STIFFNESS), 1.0) for e in candidates if e.never_separable]
        causes = causes_of(found)
        advice = advise(data, found)
        met, unmet = None, list[str]()
        if kept_out is not None:
            say("held-out test")
            unusable = _lacking(wanted, [kept_out.data.specimen.test])
            usable = [e for e in wanted if e.id not in unusable]
            try:
                met = judge_held_out(
                    kept_out, found, usable, weight_of(data), say, same_rig=same_rig
                )
            except SolveError as error:
                unmet = [f"the held-out test could not be met with what was found: {error}"]
            unmet += lacked_by(kept_out, found)
    return Diagnosis(
        verdict=verdict_of(found),
        causes=causes,
        prepared=prepared,
        explanation=found,
        gaps=gaps,
        modes=azimuthal_modes(data, baseline),
        pairs=pairs,
        advice=advice,
        law=law_table(data, found.final, found.level),
        scatter=scatter_of(found.final),
        implied=implied_references(data, found.final),
        skipped=lacking,
        held=known,
        tests=given,
        seed=seed,
        seconds=time.perf_counter() - began,
        holdout=met,
        kept_out=holdout,
        warnings=[
            *left_out([*prepared, *([kept_out] if kept_out else [])]),
            *in_doubt(prepared, found),
            *left_of_the_mesh(prepared),
            *of_the_fits(found),
            *unmet,
        ],
    )


def _given(
    tests: GivenTests, holdout: BulgeTest | None
) -> tuple[list[BulgeTest], BulgeTest | None]:
    """The tests that are diagnosed, and the one that is kept out, if any; all of one cloth."""
    given = given_tests(tests)
    if not given:
        raise InputError("no bulge test was given")
    if holdout is None:
        _same_ratio(given)
        return given, None
    every = distinctly_named([*given, *given_tests(holdout)])
    if len(every) != len(given) + 1:
        raise InputError("holdout: give one test; the others are diagnosed together")
    _same_ratio(every)
    return given, every[-1]


def _gaps(data: Sequence[Data], found: Explanation) -> dict[str, dict[str, float]]:
    """Of the moduli alone and of what was found, on what was fitted and what was held out."""
    weight = weight_of(data)
    fits = {"baseline": found.baseline, "explained": found.final}
    return {
        **{name: fitted_gap(data, fit, weight) for name, fit in fits.items()},
        **{f"heldout_{name}": held_out_gap(data, fit, weight) for name, fit in fits.items()},
        "noise_floor": noise_gap(data, weight),
    }


def _not_held(effects: Iterable[Effect], held: Mapping[str, float], *, named: bool) -> list[Effect]:
    """Effects of which nothing is held; InputError where others were asked for by name."""
    keys = [Key.read(name) for name in held]
    if own := [str(key) for key in keys if key.specimen is not None]:
        raise InputError(f"held: {own[0]}: what is held is so in every test; leave out the @")
    known = {key.effect for key in keys}
    if never := sorted(known & set(fields())):
        raise InputError(f"held: {never[0]} is a field, which is looked for where it is needed")
    if never := sorted(known & set(scatter())):
        raise InputError(f"held: {never[0]} is each specimen's own, which is found of several")
    found = [e for e in effects if e.id not in known]
    if named and (twice := [e.id for e in effects if e.id in known]):
        raise InputError(f"held: {twice[0]} is among the effects to try, too; leave it out of one")
    return found


def _lacking(effects: Iterable[Effect], tests: Sequence[BulgeTest]) -> dict[str, str]:
    """Effects that need what one of the tests has not, and why."""
    return {
        e.id: f"the test has no {need}"
        for e in effects
        for need in e.needs
        if any(getattr(t, need) is None for t in tests)
    }


def _same_ratio(tests: Sequence[BulgeTest]) -> None:
    """Specimens judged together share the material, of which each test states Poisson's ratio."""
    ratios = sorted({t.poisson_ratio for t in tests})
    if len(ratios) > 1:
        raise InputError(
            f"the tests state different Poisson ratios ({', '.join(f'{r:g}' for r in ratios)}), "
            "but specimens judged together share the material: diagnose them one by one, or state "
            "one ratio in their files"
        )


def _believed(priors: Mapping[str, Prior]) -> dict[str, tuple[float, float]]:
    """Centre and standard deviation (MPa) of moduli; InputError for what is no prior of one."""
    known = [m.name for m in MODULI]
    for name, prior in priors.items():
        if name not in known:
            raise InputError(
                f"prior: {name} is none of {', '.join(known)}; in a diagnosis effects have priors "
                "of physical size about their null (docs/diagnosis.md)"
            )
        if not isinstance(prior, Prior):
            raise InputError(f"prior of {name}: give a Prior(mean, deviation), not {prior!r}")
        if not (0.0 < prior.mean < np.inf and 0.0 < prior.deviation < np.inf):
            raise InputError(f"prior of {name}: give a value and a deviation above 0 MPa")
    return {name: (prior.mean, prior.deviation) for name, prior in priors.items()}


def _baseline(prepared: Sequence[Prepared]) -> Regression:
    """Moduli alone; then the mesh's error is taken off and outliers left out, and again."""
    data = [p.data for p in prepared]
    rough = regress([_few_frames(d) for d in data], MODULI, starting_moduli(data))
    first = regress(data, MODULI, rough.values)
    for p, prediction in zip(prepared, first.predictions, strict=True):
        renew_noise(p, prediction.displacement)
        drop_outliers(p, prediction.displacement)
    return settle(prepared, first)


def _few_frames(data: Data) -> Data:
    """Every fourth frame: enough to bring the moduli near their place."""
    order = np.argsort(data.specimen.recorded, kind="stable")
    return data.of_frames(np.sort(order[::-4]))
