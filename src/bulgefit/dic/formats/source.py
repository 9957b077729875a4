"""What is read as one test: a file, a folder, a pattern or a list of files?"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from bulgefit.dic.formats.encoding import decode
from bulgefit.dic.formats.table import Header, headers_of
from bulgefit.errors import InputError, needed
from bulgefit.files import as_path

__all__ = [
    "PRESSURE_TABLE",
    "Head",
    "Place",
    "Source",
    "frame_name",
    "head_of",
    "natural",
    "source_of",
]

Place = str | os.PathLike[str]

#: The file by which a folder of CSV frames is told.
PRESSURE_TABLE = "pressure.csv"
# Bytes from which a format is seen; the longest preambles that DIC systems write are half of it.
_HEAD = 1 << 14
# Endings of files that may be a log.
_TEXTS = (".csv", ".txt", ".log", ".dat", ".tsv")
# Endings that an image or an export adds to the name of a frame, one after the other.
_ENDINGS = re.compile(
    r"\.(csv|txt|dat|out|mat|hdf5|h5|vc7|tiff?|bmp|png|jpe?g|raw|im7|cihx?)$", re.IGNORECASE
)


@dataclass(frozen=True)
class Head:
    """A file and its first bytes, by which its format is seen."""

    path: Path
    data: bytes

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """The lines of its text; none where it holds no text."""
        text = decode(self.data, cut=True)
        return () if "\0" in text else tuple(text.splitlines())

    @cached_property
    def headers(self) -> tuple[Header, ...]:
        """The lines of its text that may name columns."""
        return tuple(headers_of(self.lines))


@dataclass(frozen=True)
class Source:
    """Where a test is read from.

    Attributes
    ----------
    path : Path
        What messages speak of, and what a reader of single files takes.
    files : tuple of Path
        The files that may belong to it, numbers in their names in numerical order.
    picked : bool
        Whether these are some files of a folder, picked by a list or a pattern.
    """

    path: Path
    files: tuple[Path, ...]
    picked: bool = False

    @property
    def is_one_path(self) -> bool:
        """Whether this is a file or a folder, rather than a choice of files."""
        return not self.picked

    @cached_property
    def beside(self) -> tuple[Head, ...]:
        """The beginnings of text files in the folder of the files that were picked from it."""
        folder = self.path if self.picked else self.path.parent
        if self.path.is_dir() and not self.picked:
            return ()
        others = [
            file
            for file in sorted(folder.iterdir())
            if file.suffix.lower() in _TEXTS and file.is_file() and file not in self.files
        ]
        return tuple(head for head in map(_readable_head, others) if head is not None)

    @cached_property
    def heads(self) -> tuple[Head, ...]:
        """The beginnings of the files; those that cannot be read are left out."""
        return tuple(head for head in map(_readable_head, self.files) if head is not None)


def source_of(place: Place | Sequence[Place]) -> Source:
    """Find the files of a test.

    Parameters
    ----------
    place : path or sequence of paths
        A file, a folder (its files, not those of folders within), a pattern such as
        `frames/*.csv`, or the files themselves.

    Raises
    ------
    InputError
        Something does not exist, or is neither a file nor a folder.
    """
    if not isinstance(place, (str, os.PathLike)):
        files = [as_path(item) for item in needed(place, Iterable, "a path, or a list of them,")]
        if not files:
            raise InputError("no files: give a file, a folder or a list of files")
        for file in files:
            _need_file(file)
        if len(files) == 1:
            return Source(files[0], tuple(files))
        return Source(files[0].parent, tuple(files), picked=True)
    if not os.fspath(place):
        raise InputError("the name of a test is empty; give a file or a folder")
    path = Path(place)
    if not os.path.lexists(path):
        matching = sorted(map(Path, glob.glob(str(path))), key=lambda file: natural(file.name))
        if not matching:
            raise InputError(f"{path}: no such file or folder; check the path")
        return source_of(matching)
    if path.is_dir():
        try:
            inside = [entry for entry in path.iterdir() if not entry.name.startswith(".")]
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from error
        files = sorted(filter(Path.is_file, inside), key=lambda file: natural(file.name))
        return Source(path, tuple(files))
    _need_file(path)
    return Source(path, (path,))


def natural(name: str) -> tuple[tuple[float, str], ...]:
    """A key that sorts step_2 before step_10, and 0.5bar after 0bar."""
    parts = re.split(r"(\d+(?:[.,]\d+)?)", name)
    # every second part is a number
    return tuple(
        (float(part.replace(",", ".")), "") if i % 2 else (0.0, part)
        for i, part in enumerate(parts)
    )


def frame_name(name: str) -> str:
    """The name of a frame, from that of its image or export, with or without folders."""
    name = re.split(r"[\\/]", name.strip())[-1]
    while shorter := _ENDINGS.sub("", name):
        if shorter == name:
            break
        name = shorter
    return name


def _need_file(path: Path) -> None:
    if not os.path.lexists(path):
        raise InputError(f"{path}: no such file or folder; check the path")
    # opening a pipe would wait for ever, and a device need not end
    if not path.is_file():
        raise InputError(f"{path}: is not a regular file; name a file or a folder of files")


def head_of(path: Path) -> Head:
    """The beginning of a file."""
    with path.open("rb") as file:
        return Head(path, file.read(_HEAD))


def _readable_head(path: Path) -> Head | None:
    try:
        return head_of(path)
    except OSError:
        return None
