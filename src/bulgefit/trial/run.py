"""The blind trial: made tests whose truth is sealed, diagnosed elsewhere, opened, and scored.

Making and diagnosing run in other processes than the one that scores, started afresh, so nothing
but a file's path (and what is struck from the catalogue) reaches a diagnosis. The SHA-256 of each
truth is said before the first diagnosis starts, and checked when the truth is opened.
"""

from __future__ import annotations

import hashlib
import json
import re
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
from bulgefit.trial.known import KNOWN
from bulgefit.trial.make import Recipe, make_test
from bulgefit.trial.plan import FAMILY, filmed_closely, interpolated, plan, turned
from bulgefit.trial.score import judge, score

__all__ = ["diagnose_files", "run_trial", "score_folder", "seal"]

Diagnose = Callable[..., Any]


def seal(text: str) -> str:
    """SHA-256 of a truth."""
    return hashlib.sha256(text.encode()).hexdigest()


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
    folder = _folder(output, asked if resume else None)
    atomic_write_text(folder / "trial.json", _text_of(asked), force=resume)
    jobs = [
        (str(folder), i, chosen[i], seed, one)
        for i, one in enumerate(_recipes(recipe, number, seed, whole=not kinds))
    ]
    with _pool(makers, workers) as pool:
        made = _all(pool, _make, jobs, lambda n, *_: say(f"made {n} of {number} tests"))
    seals = {name: digest for name, _, digest, _ in made}
    _write_seals(folder, seals, resume, say)
    asked_of = {name: (files, effects if strike else []) for name, files, _, effects in made}
    with _pool(executor, workers) as pool:
        answers = _answers(pool, folder, asked_of, dict(options or {}), diagnose, say)
    return _scored(folder, asked, seals, answers, time.perf_counter() - start)


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
    folder = Path(output)
    if not (folder / "trial.json").is_file():
        raise InputError(f"{folder}: not the folder of a trial, it has no trial.json")
    asked = _read_object(folder / "trial.json", {"number": int, "strike": bool})
    seals = _read_seals(folder / "seals.txt", asked["number"])
    needed = {"verdict": str, "seconds": (int, float)}
    answers = {
        path.stem: _read_object(path, needed)
        for path in sorted((folder / "answers").glob("*.json"))
        if path.stem in seals
    }
    if not answers:
        raise InputError(f"{folder}: no test is answered yet")
    answered = {name: digest for name, digest in seals.items() if name in answers}
    for record in _records(folder, asked, answered, answers):
        _check_answer(folder, record)
    seconds = sum(answer["seconds"] for answer in answers.values())
    return _scored(folder, asked, answered, answers, seconds)


def _read_object(path: Path, needed: Mapping[str, Any]) -> dict[str, Any]:
    """A JSON object of a trial, which has these keys with values of these types."""
    try:
        content = json.loads(_text(path))
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise _damaged(path, str(error)) from error
    if not isinstance(content, dict):
        raise _damaged(path, "no JSON object")
    for key, kind in needed.items():
        if not isinstance(content.get(key), kind):
            raise _damaged(path, f"{key} is missing or of the wrong kind")
    return content


def _read_seals(path: Path, number: int) -> dict[str, str]:
    """SHA-256 of each truth, as `_write_seals` writes them."""
    lines = _text(path).splitlines()
    found = [re.fullmatch(r"([0-9a-f]{64})  sealed/(.+)\.json", line) for line in lines]
    if len(found) != number or not all(found):
        raise _damaged(path, f"not {number} lines of a SHA-256 and a file")
    return {match[2]: match[1] for match in found if match}


def _check_answer(folder: Path, record: dict[str, Any]) -> None:
    """Refuse an answer that cannot be scored; its truth is sealed, so it is as it was made."""
    try:
        score([record])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        path = folder / "answers" / f"{Path(record['file']).stem}.json"
        raise _damaged(path, f"{type(error).__name__}: {error}") from error


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _damaged(path, "no text in UTF-8") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _damaged(path: Path, why: str) -> InputError:
    return InputError(f"{path}: damaged, not as a trial writes it ({why}); restore or remove it")


def _scored(
    folder: Path,
    asked: Mapping[str, Any],
    seals: Mapping[str, str],
    answers: Mapping[str, dict[str, Any]],
    seconds: float,
) -> TrialAnswer:
    """Open the truths of sealed tests and score their answers."""
    records = _records(folder, asked, seals, answers)
    return TrialAnswer(
        scores=score(records),
        tests=[judge(record) for record in records],
        meta={**asked, "answered": len(records), "seals": dict(seals), "seconds": seconds},
    )


def _records(
    folder: Path,
    asked: Mapping[str, Any],
    seals: Mapping[str, str],
    answers: Mapping[str, dict[str, Any]],
) -> list[dict[str, Any]]:
    """Truth and answer of each sealed test, as `score` takes them."""
    truths = {name: _opened(folder, name, digest) for name, digest in seals.items()}
    return [
        {
            "file": f"{name}.npz" if truth["kind"] != FAMILY else name,
            "truth": truth,
            "answer": answers[name],
            "struck": _catalogued(truth) if asked["strike"] else [],
        }
        for name, truth in truths.items()
    ]


def _catalogued(truth: Mapping[str, Any]) -> list[str]:
    return [effect for effect in truth["effects"] if effect in KNOWN]


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


def _folder(output: str | Path, begun: Mapping[str, Any] | None) -> Path:
    """The folder, made; it is empty, or holds what was begun."""
    folder = Path(output).absolute()  # a worker may stand elsewhere
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        if begun is None:
            raise InputError(f"{folder}: holds something; name an empty or a new folder")
        _check_begun(folder, begun)
    try:
        for part in ("tests", "sealed", "answers"):
            (folder / part).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    return folder


def _check_begun(folder: Path, asked: Mapping[str, Any]) -> None:
    """Refuse a folder that holds anything but the same trial, which is about to go on in it."""
    file = folder / "trial.json"
    known = ("trial.json", "tests", "sealed", "seals.txt", "answers")
    parts = sorted(folder.iterdir()) if folder.is_dir() else [folder]
    # what was being written when the trial was killed begins with a dot
    other = [part.name for part in parts if part.name not in known and part.name[0] != "."]
    if other:
        raise InputError(f"{folder}: holds {other[0]}, which is no part of a trial; remove it")
    if file.is_file() and _text(file) != _text_of(asked):
        raise InputError(f"{folder}: holds another trial; go on with what {file} says")


def _text_of(asked: Mapping[str, Any]) -> str:
    return json.dumps(asked, indent=2) + "\n"


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
    return name, files, seal(text), _catalogued(truth)


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
        text = json.dumps(answer, indent=2, allow_nan=False) + "\n"
        atomic_write_text(folder / "answers" / f"{names[index]}.json", text, force=True)
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


def _write_seals(
    folder: Path, seals: Mapping[str, str], resume: bool, say: Callable[[str], None]
) -> None:
    lines = [f"{digest}  sealed/{name}.json" for name, digest in seals.items()]
    text = "\n".join(lines) + "\n"
    if resume and (folder / "seals.txt").is_file() and _text(folder / "seals.txt") != text:
        raise InputError(f"{folder / 'seals.txt'}: changed since the trial was interrupted")
    atomic_write_text(folder / "seals.txt", text, force=resume)
    for line in lines:
        say(line)
    say(f"sealed {len(lines)} truths; SHA-256 of all seals {seal(text)}")


def _opened(folder: Path, name: str, digest: str) -> dict[str, Any]:
    path = folder / "sealed" / f"{name}.json"
    text = _text(path)
    if seal(text) != digest:
        raise InputError(f"{path}: the seal is broken; the truth was changed after it was sealed")
    return dict(json.loads(text))


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
