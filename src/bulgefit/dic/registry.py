"""Which readers are there? Each registers its format here with a decorator."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from bulgefit.dic.formats.source import PRESSURE_TABLE, Source, source_of
from bulgefit.errors import InputError

__all__ = [
    "READERS",
    "Reader",
    "Recording",
    "choose_reader",
    "file_checksum",
    "one_line",
    "reader",
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
    ellipticity : float or None
        Of the clamp: its semi-axes over their mean, less 1, + along x.
    poisson_ratio : float or None
    warp_angle : float, degree, or None
    at_rest : int
        So many of the first frames are images before inflation.
    static_displacement : (m, n, 3) array_like, mm, or None
    time : (frames,) array_like, s, or None
    schedule : (recorded,) array_like, s, or None
        Times of all frames that were recorded, where others were left out before it was written.
    name : str or None
    pressure_unit : str
        Of the numbers in the file, one of `bulgefit.dic.units.PRESSURE`: messages speak in it.
    notes : sequence of str
        What was taken, joined and lost on the way, one line each, for whoever reads the test.
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
    schedule: ArrayLike | None = None
    name: str | None = None
    pressure_unit: str = "MPa"
    notes: Sequence[str] = ()
    history: Sequence[str] = ()
    ellipticity: float | None = None
    warp_angle: float | None = None
    at_rest: int = 0


@dataclass(frozen=True)
class Reader:
    """A format: its name, what it looks like, and the function that reads it.

    Attributes
    ----------
    name : str
    looks_like : str
        What such a file is called, or what writes it.
    matches : callable
        Whether a `Source` is taken for this format where none is given.
    options : tuple of str
        Keyword arguments of `read`.
    read : callable
        Reads the source into a `Recording`.
    example : str
        A line of such a file, or what it holds.
    lost : str
        How it marks a point that was lost.
    positions : str
        Whether its positions are those before inflation ("reference") or at the frame ("current").
    by_content : bool
        Whether `matches` looks into the file; then it goes before formats that know only names.
    instead : str
        Where it says what options of other formats do, for who asks for one of those.
    """

    name: str
    looks_like: str
    matches: Callable[[Source], bool]
    options: tuple[str, ...]
    read: Callable[..., Recording]
    example: str = ""
    lost: str = "NaN"
    positions: str = "reference"
    by_content: bool = False
    instead: str = ""


READERS: dict[str, Reader] = {}


def reader(
    name: str,
    matches: Callable[[Path], bool] | Sequence[str],
    *,
    looks_like: str | None = None,
    options: Iterable[str] = (),
    example: str = "",
    lost: str = "NaN",
    positions: str = "reference",
    instead: str = "",
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
    example, lost, positions : str
        Shown by `bulgefit formats` (see `Reader`).
    instead : str
        See `Reader`.

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
        def read(source: Source, **given: Any) -> Recording:
            if not source.is_one_path:
                raise InputError(f"{source.path}: the format {name} is one path a test; name it")
            return function(source.path, **given)

        READERS[name] = Reader(
            name,
            shown,
            lambda source: source.is_one_path and test(source.path),
            tuple(options),
            read,
            example,
            lost,
            positions,
            instead=instead,
        )
        return function

    return register


def choose_reader(source: Source, format: str | None, options: dict[str, Any]) -> Reader:
    """The reader of a source: the format that is named, else the one that matches.

    Raises
    ------
    InputError
        No format fits the source or several do, or the format has no such option.
    """
    if format is not None:
        if format not in READERS:
            raise InputError(f"unknown format {format!r}; known are {_known()}")
        chosen = READERS[format]
    else:
        chosen = _matching(source, options)
    for option in options:
        if option not in chosen.options:
            written = f"--{option.replace('_', '-')}"
            raise InputError(
                f"{source.path}: the format {chosen.name} has no option {written}; leave it out"
                + (f" ({chosen.instead})" if chosen.instead else "")
            )
    return chosen


def _matching(source: Source, options: dict[str, Any]) -> Reader:
    fitting = [entry for entry in READERS.values() if entry.matches(source)]
    # the options that were given tell formats apart that a path could be of
    fitting = [entry for entry in fitting if {*options} <= {*entry.options}] or fitting
    seen = [entry for entry in fitting if entry.by_content]
    if len(seen) > 1:
        names = ", ".join(entry.name for entry in seen)
        raise InputError(f"{source.path}: may be of the formats {names}; name one with --format")
    if not fitting:
        raise InputError(f"{source.path}: {_otherwise(source)}")
    return [*seen, *fitting][0]


def _otherwise(source: Source) -> str:
    """Why a source is of no format, and what of it or about it may be."""

    def known(place: Path) -> bool:
        return any(entry.matches(source_of(place)) for entry in READERS.values())

    if source.picked and all(map(known, source.files)):
        some = " ".join(file.name for file in source.files[:3])
        return (
            f"{len(source.files)} files, each a test of its own, are no test together; name them "
            f"one by one, as {some}"
        )
    folder = source.path if source.picked else source.path.parent
    if source.heads and (folder / PRESSURE_TABLE).is_file():
        return f"is of no format by itself, but its folder is; name that, {folder}"
    kind = "folder" if source.path.is_dir() else "file"
    return f"not a {kind} of a known format; name one with --format, of {_known()}"


def _known() -> str:
    return f"{', '.join(sorted(READERS))} (bulgefit formats shows them)"


def one_line(error: Exception) -> str:
    """The message of another library's error, without line breaks; it may quote the file."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def unreadable(path: Path, error: OSError) -> InputError:
    """What is raised where the system does not let a file be read."""
    return InputError(f"{path}: cannot be read ({error.strerror or one_line(error)})")


def file_checksum(*paths: Path) -> str:
    """SHA-256 of one file's bytes, or of several files' names, sizes and bytes.

    A name may tell a pressure, and which row of a log is whose; sizes tell where a file ends.
    """
    digest = hashlib.sha256()
    for path in paths:
        if len(paths) > 1:
            digest.update(f"{path.name}\0{path.stat().st_size}\0".encode(errors="backslashreplace"))
        with path.open("rb") as file:
            while chunk := file.read(1 << 20):
                digest.update(chunk)
    return digest.hexdigest()
