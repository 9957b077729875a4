"""What does the folder of a trial hold, and is it as the trial wrote it?

`trial.json` (what was asked), `tests/*.npz`, `sealed/*.json` (a truth each), `seals.txt` (their
SHA-256, as sha256sum writes it) and `answers/*.json`.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bulgefit.errors import InputError
from bulgefit.files import atomic_write_text
from bulgefit.trial.known import KNOWN
from bulgefit.trial.plan import FAMILY
from bulgefit.trial.score import score

__all__ = [
    "answered_in",
    "begin_folder",
    "catalogued",
    "records_of",
    "seal",
    "write_answer",
    "write_seals",
]


def seal(text: str) -> str:
    """SHA-256 of a truth."""
    return hashlib.sha256(text.encode()).hexdigest()


def begin_folder(output: str | Path, asked: Mapping[str, Any], *, resume: bool) -> Path:
    """The folder of a trial, made, with what is asked in it.

    Raises
    ------
    InputError
        It holds something, or with `resume` something else than the same trial, or cannot be made.
    """
    folder = Path(output).absolute()  # a worker may stand elsewhere
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        if not resume:
            raise InputError(f"{folder}: holds something; name an empty or a new folder")
        _check_begun(folder, asked)
    try:
        for part in ("tests", "sealed", "answers"):
            (folder / part).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror})") from error
    atomic_write_text(folder / "trial.json", _text_of(asked), force=resume)
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


def write_seals(
    folder: Path, seals: Mapping[str, str], resume: bool, say: Callable[[str], None]
) -> None:
    """Write the SHA-256 of each truth by its test's name, and say them."""
    lines = [f"{digest}  sealed/{name}.json" for name, digest in seals.items()]
    text = "\n".join(lines) + "\n"
    if resume and (folder / "seals.txt").is_file() and _text(folder / "seals.txt") != text:
        raise InputError(f"{folder / 'seals.txt'}: changed since the trial was interrupted")
    atomic_write_text(folder / "seals.txt", text, force=resume)
    for line in lines:
        say(line)
    say(f"sealed {len(lines)} truths; SHA-256 of all seals {seal(text)}")


def write_answer(folder: Path, name: str, answer: Mapping[str, Any]) -> None:
    """Write the answer to a test."""
    text = json.dumps(answer, indent=2, allow_nan=False) + "\n"
    atomic_write_text(folder / "answers" / f"{name}.json", text, force=True)


def answered_in(
    folder: Path,
) -> tuple[dict[str, Any], dict[str, str], list[dict[str, Any]]]:
    """What was asked, seals and records of the tests that are answered.

    Raises
    ------
    InputError
        Not a trial's folder, no answers, a file that is damaged, or a broken seal.
    """
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
    records = records_of(folder, asked, answered, answers)
    for record in records:
        _check_answer(folder, record)
    return asked, answered, records


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
    """SHA-256 of each truth, as `write_seals` writes them."""
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


def records_of(
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
            "struck": catalogued(truth) if asked["strike"] else [],
        }
        for name, truth in truths.items()
    ]


def catalogued(truth: Mapping[str, Any]) -> list[str]:
    """Effects of the catalogue that are there: what may be struck from it."""
    return [effect for effect in truth["effects"] if effect in KNOWN]


def _opened(folder: Path, name: str, digest: str) -> dict[str, Any]:
    path = folder / "sealed" / f"{name}.json"
    text = _text(path)
    if seal(text) != digest:
        raise InputError(f"{path}: the seal is broken; the truth was changed after it was sealed")
    return dict(json.loads(text))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise _damaged(path, "no text in UTF-8") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _damaged(path: Path, why: str) -> InputError:
    return InputError(f"{path}: damaged, not as a trial writes it ({why}); restore or remove it")
