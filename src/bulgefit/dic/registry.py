"""Which readers are there? Each registers its format here with a decorator."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from bulgefit.errors import InputError

__all__ = [
    "READERS",
    "Reader",
    "Recording",
    "choose_reader",
    "file_checksum",
    "one_line",
    "reader",
    "text_of",
    "unreadable",
]


@dataclass
class Recording:
    """What a file says of a test, before it is checked: mm, MPa, s.

    Attributes
    ----------
    pressure : (frames,) array_like, MPa
    checksum : str
        SHA-256 of what was read.
    reference, displacement : (n, 3) and (frames, n, 3) array_like, mm, or None
        Given where the frames share their points.
    frames : sequence of ((n_i, 3), (n_i, 3)) array_likes, mm, or None
        Reference and displacement of each frame, given where they do not.
    radius, thickness : float, mm, or None
        None where the file does not say.
    poisson_ratio : float or None
    static_displacement : (m, n, 3) array_like, mm, or None
    time : (frames,) array_like, s, or None
    name : str or None
    pressure_unit : str
        Of the numbers in the file, one of `bulgefit.dic.units.PRESSURE`: messages speak in it.
    history : sequence of str
        What was done to the test before it was written.
    """

    pressure: ArrayLike
    checksum: str
    reference: ArrayLike | None = None
    displacement: ArrayLike | None = None
    frames: Sequence[tuple[ArrayLike, ArrayLike]] | None = None
    radius: float | None = None
    thickness: float | None = None
    poisson_ratio: float | None = None
    static_displacement: ArrayLike | None = None
    time: ArrayLike | None = None
    name: str | None = None
    pressure_unit: str = "MPa"
    history: Sequence[str] = ()


@dataclass(frozen=True)
class Reader:
    """A format: its name, what it looks like, and the function that reads it.

    Attributes
    ----------
    name : str
    looks_like : str
        What such a file is called, e.g. "*.npz".
    matches : callable
        Whether a path is taken for this format where none is given.
    options : tuple of str
        Keyword arguments of `read`.
    read : callable
        Reads the path into a `Recording`.
    """

    name: str
    looks_like: str
    matches: Callable[[Path], bool]
    options: tuple[str, ...]
    read: Callable[..., Recording]


READERS: dict[str, Reader] = {}


def reader(
    name: str,
    matches: Callable[[Path], bool] | Sequence[str],
    *,
    looks_like: str | None = None,
    options: Iterable[str] = (),
) -> Callable[[Callable[..., Recording]], Callable[..., Recording]]:
    """Register the decorated function as the reader of a format.

    Parameters
    ----------
    name : str
        What `format=` and `--format` call it.
    matches : callable or sequence of str
        Whether a path is of this format, or the file suffixes that say so.
    looks_like : str, optional
        Shown in messages; by default the suffixes.
    options : iterable of str
        Keyword arguments that the function takes beside the path.

    Examples
    --------
    >>> @reader("mine", [".mine"])  # doctest: +SKIP
    ... def read_mine(path: Path) -> Recording: ...
    """
    if callable(matches):
        test, shown = matches, looks_like or name
    else:
        suffixes = tuple(suffix.lower() for suffix in matches)
        shown = looks_like or ", ".join(f"*{suffix}" for suffix in suffixes)

        def test(path: Path) -> bool:
            return path.suffix.lower() in suffixes

    def register(function: Callable[..., Recording]) -> Callable[..., Recording]:
        READERS[name] = Reader(name, shown, test, tuple(options), function)
        return function

    return register


def choose_reader(path: Path, format: str | None, options: dict[str, Any]) -> Reader:
    """The reader of a path: the format that is named, else the one that matches.

    Raises
    ------
    InputError
        The path does not exist, no format fits it, or the format has no such option.
    """
    known = "; ".join(f"{entry.name} ({entry.looks_like})" for entry in READERS.values())
    if format is not None and format not in READERS:
        raise InputError(f"unknown format {format!r}; known are {known}")
    if not os.path.lexists(path):
        raise InputError(f"{path}: no such file or folder; check the path")
    if format is not None:
        chosen = READERS[format]
    else:
        fitting = [entry for entry in READERS.values() if entry.matches(path)]
        if not fitting:
            kind = "folder" if path.is_dir() else "file"
            raise InputError(
                f"{path}: not a {kind} of a known format; name one with --format, of {known}"
            )
        chosen = fitting[0]
    for option in options:
        if option not in chosen.options:
            raise InputError(f"{path}: the format {chosen.name} has no option {option!r}")
    return chosen


def one_line(error: Exception) -> str:
    """The message of another library's error, without line breaks; it may quote the file."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def unreadable(path: Path, error: OSError) -> InputError:
    """What is raised where the system does not let a file be read."""
    return InputError(f"{path}: cannot be read ({error.strerror or one_line(error)})")


def text_of(path: Path, errors: str = "strict") -> str:
    """The text of one file of a folder, of UTF-8 with or without its mark."""
    try:
        return path.read_text(encoding="utf-8-sig", errors=errors)
    except OSError as error:  # says itself which file, since the folder is what was asked for
        raise unreadable(path, error) from error


def file_checksum(*paths: Path) -> str:
    """SHA-256 of one file's bytes, or of several files' bytes one after the other."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while chunk := file.read(1 << 20):
                digest.update(chunk)
    return digest.hexdigest()
