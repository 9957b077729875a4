"""The blind trial: made tests whose truth is sealed, diagnosed elsewhere, opened, and scored.

Making and diagnosing run in other processes than the one that scores, started afresh, so nothing
but a file's path (and what is struck from the catalogue) reaches a diagnosis. The SHA-256 of each
truth is said before the first diagnosis starts, and checked when the truth is opened.
"""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from itertools import count
from math import isfinite
from pathlib import Path
from typing import Any

from numpy.random import SeedSequence

from bulgefit.dic.readers import read_test
from bulgefit.dic.writers import write_test
from bulgefit.errors import BulgefitError, InputError
from bulgefit.files import atomic_write_text
from bulgefit.parallel.spread import spread
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.parallel.workers import open_executor
from bulgefit.trial.answer import TrialAnswer
from bulgefit.trial.family import make_family
from bulgefit.trial.folder import (
    answered_in,
    begin_folder,
    catalogued,
    records_of,
    seal,
    write_answer,
    write_seals,
)
from bulgefit.trial.known import KNOWN
from bulgefit.trial.make import Recipe, make_test
from bulgefit.trial.plan import FAMILY, filmed_closely, interpolated, plan, turned
from bulgefit.trial.right import Record
from bulgefit.trial.score import judge, score

__all__ = ["diagnose_files", "run_trial", "score_folder"]

Diagnose = Callable[..., Any]


def run_trial(
    number: int = 20,
    seed: int = 0,
    *,
    output: str | Path,
    kinds: Sequence[str] | None = None,
    strike: bool = False,
    workers: int = 1,
    recipe: Recipe | None = None,
    diagnose: Diagnose,
    options: Mapping[str, Any] | None = None,
    makers: Executor | None = None,
    executor: Executor | None = None,
    resume: bool = False,
    say: Callable[[str], None] = lambda line: None,
) -> TrialAnswer:
    """Make tests, seal their truth, diagnose them blind, open and score.

    The folder gets `trial.json` (what was asked), `tests/*.npz` (of a family one for each
    specimen), `sealed/*.json`, `seals.txt` (as sha256sum writes it) and `answers/*.json`.

    Parameters
    ----------
    number, seed : int
        The tests depend on nothing else; `kinds` as in `plan`.
    output : path
        A folder that is empty or not there yet.
    strike : bool
        Take the true effects out of the catalogue before a test is diagnosed.
    workers : int
        Processes.
    recipe : Recipe, optional
        How large the tests are; in a trial of all kinds no cause is lost in the noise, and a few
        tests have interpolated frames, or more of them than the others.
    options : mapping, optional
        Of the diagnosis.
    diagnose : callable
        Called as `diagnose(tests, **options)` with one test or a family's three, gives an object
        with `to_dict()`; it must be importable by a fresh process, such as `bulgefit.diagnose`.
    makers, executor : Executor, optional
        Where tests are made, and where they are diagnosed. Default: fresh processes each, so that
        no process that diagnoses has known a truth. Workers on other machines must share `output`.
    resume : bool
        The folder may hold what the same trial had written when it was interrupted.
    say : callable
        Told about the progress, line by line.

    Returns
    -------
    TrialAnswer
        A dict of `scores` (see `bulgefit.trial.score.score`), `tests` (a line each) and `meta`,
        with `report`, `plot`, `to_dict` and `to_dataframe`.

    Raises
    ------
    InputError
        Bad numbers or kinds, a folder that holds something, or a broken seal.
    """
    start = time.perf_counter()
    chosen = plan(number, seed, kinds)
    recipe = recipe or Recipe()
    asked = {
        "number": number,
        "seed": seed,
        "kinds": list(kinds) if kinds else None,
        "strike": strike,
        "shrink": recipe.shrink,
    }
    folder = begin_folder(output, asked, resume=resume)
    jobs = [
        (str(folder), i, chosen[i], seed, one)
        for i, one in enumerate(_recipes(recipe, number, seed, whole=not kinds))
    ]
    with _pool(makers, workers) as pool:
        made = _all(pool, _make, jobs, lambda n, *_: say(f"made {n} of {number} tests"))
    seals = {name: digest for name, _, digest, _ in made}
    write_seals(folder, seals, resume, say)
    asked_of = {name: (files, effects if strike else []) for name, files, _, effects in made}
    with _pool(executor, workers) as pool:
        answers = _answers(pool, folder, asked_of, dict(options or {}), diagnose, say)
    records = records_of(folder, asked, seals, answers)
    return _scored(asked, seals, records, time.perf_counter() - start)


def _recipes(recipe: Recipe, number: int, seed: int, *, whole: bool) -> list[Recipe]:
    """The recipe of each test.

    In a trial of all kinds they are audible, a few interpolated, a few have more frames, and of a
    few the warp was mounted elsewhere.
    """
    if not whole:
        return [recipe] * number
    mixed, closely = interpolated(number, seed), filmed_closely(number, seed)
    angles = turned(number, seed)
    return [
        replace(
            recipe,
            audible=True,
            interpolated=i in mixed,
            frames=max(recipe.frames, closely.get(i, 0)),
            mounted=angles.get(i, 0.0),
        )
        for i in range(number)
    ]


def score_folder(output: str | Path) -> TrialAnswer:
    """Score the answers that a folder holds: of a trial that was interrupted, say.

    Parameters
    ----------
    output : path
        The folder of `run_trial`.

    Returns
    -------
    TrialAnswer
        As `run_trial`, over the tests that were answered; `meta` says how many.

    Raises
    ------
    InputError
        Not a trial's folder, no answers, a file that is damaged, or a broken seal.
    """
    asked, seals, records = answered_in(Path(output))
    return _scored(asked, seals, records, sum(r["answer"]["seconds"] for r in records))


def _scored(
    asked: Mapping[str, Any],
    seals: Mapping[str, str],
    records: Sequence[Record],
    seconds: float,
) -> TrialAnswer:
    return TrialAnswer(
        scores=score(records),
        tests=[judge(record) for record in records],
        meta={**asked, "answered": len(records), "seals": dict(seals), "seconds": seconds},
    )


def diagnose_files(
    paths: Sequence[str], options: Mapping[str, Any], diagnose: Diagnose
) -> dict[str, Any]:
    """Read tests and diagnose them; a diagnosis that fails is an answer, too, but never right."""
    start = time.perf_counter()
    try:
        with one_blas_thread():
            answer = diagnose([read_test(path) for path in paths], **options).to_dict()
    except (BulgefitError, ArithmeticError, ValueError, IndexError, KeyError) as error:
        answer = {"verdict": "failed", "error": f"{type(error).__name__}: {error}"}
    return dict(_plain({**answer, "seconds": time.perf_counter() - start}))


def _pool(executor: Executor | None, workers: int) -> AbstractContextManager[Executor]:
    """The executor given, or fresh processes that end with the block."""
    if executor is not None:
        return nullcontext(executor)
    return open_executor(workers, processes=True)


def _make(_: None, job: tuple[str, int, str, int, Recipe]) -> tuple[str, list[str], str, list[str]]:
    """Make one test, or family, and its sealed truth; name, files, the seal, what to strike."""
    folder, index, kind, seed, recipe = job
    name, source = f"test_{index:04d}", SeedSequence([seed, 1, index])
    if kind == FAMILY:
        family = make_family(source, recipe, name)
        tests, truth = family.tests, family.truth
    else:
        made = make_test(kind, source, recipe, name)
        tests, truth = (made.test,), made.truth
    text = json.dumps(truth, indent=2, sort_keys=True) + "\n"
    files = [f"{test.name}.npz" for test in tests]
    for test, file in zip(tests, files, strict=True):
        # a worker that died may have written it already
        write_test(test, Path(folder) / "tests" / file, force=True)
    atomic_write_text(Path(folder) / "sealed" / f"{name}.json", text, force=True)
    return name, files, seal(text), catalogued(truth)


def _answer(_: None, job: tuple[list[str], dict[str, Any], list[str], Diagnose]) -> dict[str, Any]:
    """Diagnose one test, or a family together, without struck effects."""
    paths, options, struck, diagnose = job
    for path in paths:
        if not Path(path).is_file():  # which is no answer
            raise InputError(
                f"{path}: not seen from {socket.gethostname()}; name a folder that all workers "
                "share"
            )
    if struck:
        offered = options.get("effects") or KNOWN
        options = {**options, "effects": [e for e in offered if e not in struck]}
    return diagnose_files(paths, options, diagnose)


def _answers(
    pool: Executor,
    folder: Path,
    asked_of: Mapping[str, tuple[list[str], list[str]]],
    options: dict[str, Any],
    diagnose: Diagnose,
    say: Callable[[str], None],
) -> dict[str, dict[str, Any]]:
    """Diagnose all tests (files, struck effects); each answer is written as soon as it is there."""
    names = list(asked_of)
    jobs = [
        ([str(folder / "tests" / file) for file in files], options, struck, diagnose)
        for files, struck in asked_of.values()
    ]

    def keep(number: int, index: int, answer: dict[str, Any]) -> None:
        write_answer(folder, names[index], answer)
        say(f"diagnosed {number} of {len(names)} tests, {answer['seconds']:.0f} s")

    return dict(zip(names, _all(pool, _answer, jobs, keep), strict=True))


def _all(
    pool: Executor,
    work: Callable[[None, Any], Any],
    jobs: Sequence[Any],
    tell: Callable[[int, int, Any], None],
) -> list[Any]:
    """Results in the order of the jobs; `tell` gets number done, index and result of each."""
    number = count(1)
    return spread(pool, work, None, jobs, lambda i, result: tell(next(number), i, result))


def _plain(value: Any) -> Any:
    """What JSON can hold: no NumPy, and null for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
