"""How does an output file appear whole or not at all? It is written beside, then renamed.

And how is an input opened that may be no file at all, or hold more than memory does?
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import secrets
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO

from bulgefit.errors import InputError, kind_of

__all__ = [
    "as_path",
    "atomic_path",
    "atomic_write_bytes",
    "atomic_write_text",
    "check_apart",
    "check_folder",
    "check_output",
    "checksum_of",
    "drop_abandoned",
    "drop_unfinished",
    "memory_for",
    "open_regular",
    "own_name",
]

Place = str | os.PathLike[str]

#: Temporary files that are being written.
_unfinished: set[Path] = set()

_BINARY = getattr(os, "O_BINARY", 0)


def as_path(path: Place) -> Path:
    """A path of what names one; InputError of what does not."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"the name of a file is needed, not {kind_of(path)}")
    return Path(path)


def check_output(path: Place, force: bool = False) -> Path:
    """Refuse an output that cannot be, before the work for it is done.

    Parameters
    ----------
    path : path
        The file to be written.
    force : bool
        Whether a file that exists may be replaced.

    Returns
    -------
    Path
        Where the file will stand; a symbolic link is followed, so that it stays a link.

    Raises
    ------
    InputError
        The file exists and `force` is false, is not a regular file, or its folder is missing or
        takes no file.
    """
    target = _target(path, force)
    with _written(path):
        _try(_temporary(target))
    return target


def check_folder(folder: Place) -> None:
    """Refuse a folder that takes no file, or cannot be made, before the work for it is done.

    Parameters
    ----------
    folder : path
        Need not be there yet.

    Raises
    ------
    InputError
    """
    folder = Path(folder)
    standing = next(p for p in (folder, *folder.absolute().parents) if os.path.lexists(p))
    if not standing.is_dir():
        raise InputError(f"{folder}: {standing} is a file; name a folder")
    with _written(folder):
        _try(_temporary(standing / "file"))


def check_apart(outputs: Iterable[Place], inputs: Iterable[Place] = ()) -> None:
    """Refuse outputs that would replace one another or what is read, whatever they are called.

    Parameters
    ----------
    outputs : iterable of paths
        The files to be written.
    inputs : iterable of paths
        The files that are read.

    Raises
    ------
    InputError
    """
    read = {os.path.realpath(path) for path in inputs}
    taken: set[str] = set()
    for path in outputs:
        place = os.path.realpath(path)
        if place in read:
            raise InputError(f"{path}: would replace what is read as input; name another file")
        if place in taken:
            raise InputError(f"{path}: two outputs have this name; give each a name of its own")
        taken.add(place)


def open_regular(path: Place) -> BinaryIO:
    """Open a regular file for reading; a pipe would wait for ever, and a device need not end.

    Raises
    ------
    InputError
        The path is a folder, a pipe, a socket or a device.
    OSError
        The system does not open it.
    """
    # without O_NONBLOCK opening a pipe already waits for somebody to write to it
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise InputError(f"{path}: cannot be read (it is no regular file); name a file")
    return open(descriptor, "rb")


def checksum_of(file: BinaryIO) -> str:
    """SHA-256 of all bytes of an open file, wherever it stands."""
    file.seek(0)
    digest = hashlib.sha256()
    while chunk := file.read(1 << 20):
        digest.update(chunk)
    return digest.hexdigest()


def memory_for(file: BinaryIO) -> int:
    """Bytes that the arrays of an open file may take: four times the file, and 100 MB.

    Arrays that say they are larger come from a file that was compressed or left out to harm.
    """
    return 4 * os.fstat(file.fileno()).st_size + 100_000_000


def _target(path: Place, force: bool) -> Path:
    if not os.fspath(path):
        raise InputError("the name of a file to write is empty; give one")
    target = Path(os.path.realpath(path))
    if os.path.isdir(target):  # unlike Path's own, not stopped by a name that is too long
        raise InputError(f"{path}: is a folder; name a file to write")
    if not target.parent.is_dir():
        raise InputError(f"{path}: the folder {target.parent} does not exist; make it first")
    if os.path.exists(target):
        # renaming over a device such as /dev/null would replace the device itself
        if not target.is_file():
            raise InputError(f"{path}: is not a regular file; name a file to write")
        if not force:
            raise InputError(f"{path}: exists; use --force to replace it")
    return target


@contextmanager
def atomic_path(path: Place, force: bool = False) -> Iterator[Path]:
    """Give a temporary path beside `path`; rename it to `path` when the block ends well.

    The temporary path has the suffix of `path`, for writers that choose a format by it. Where
    the block raises, the temporary file is removed and an older `path` stays as it was.

    Parameters
    ----------
    path : path
        The file to be written.
    force : bool
        Whether a file that exists may be replaced.

    Yields
    ------
    Path
        An empty file to be filled.

    Raises
    ------
    InputError
        `path` is refused by `check_output`, the folder is read-only, or the disk is full.
    """
    target = _target(path, force)
    drop_abandoned(target.parent, f".{target.stem}.", target.suffix)
    temporary = _temporary(target)
    _unfinished.add(temporary)
    try:
        with _written(path):
            _make(temporary)
            yield temporary
            _to_disk(temporary)
            os.replace(temporary, target)
    finally:
        _remove(temporary)


def drop_unfinished() -> None:
    """Remove what is being written, in the midst of it: for a process that is about to end."""
    for temporary in [*_unfinished]:
        _remove(temporary)


def _remove(temporary: Path) -> None:
    with suppress(OSError):
        temporary.unlink(missing_ok=True)
    _unfinished.discard(temporary)


def atomic_write_bytes(path: Place, data: bytes, force: bool = False) -> None:
    """Write `data` to `path`, whole or not at all (see `atomic_path`)."""
    with atomic_path(path, force) as temporary:
        temporary.write_bytes(data)


def atomic_write_text(path: Place, text: str, force: bool = False) -> None:
    """Write `text` as UTF-8 to `path`, whole or not at all (see `atomic_path`).

    What is no letter, such as a byte of a file's name in another encoding, is written as an escape.
    """
    atomic_write_bytes(path, text.encode(errors="backslashreplace"), force)


@contextmanager
def _written(path: Place) -> Iterator[None]:
    """Say of what the system refuses that `path` cannot be written."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"{path}: cannot be written ({reason}); it is as it was, choose another place"
        ) from error


def _temporary(target: Path) -> Path:
    return target.with_name(own_name(f".{target.stem}.", target.suffix))


def own_name(head: str, tail: str) -> str:
    """A new name that tells whose it is: this machine's and process's."""
    return f"{head}{_machine()}-{os.getpid()}-{secrets.token_hex(4)}{tail}"


@cache
def _machine() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def drop_abandoned(folder: Path, head: str, tail: str) -> None:
    """Remove files of an `own_name` whose processes were killed on this machine."""
    if os.name != "posix":  # elsewhere asking whether a process lives may end it
        return
    whose = f"{head}{_machine()}-"
    for path in folder.iterdir():
        owner = re.fullmatch(r"(\d+)-[0-9a-f]{8}", path.name.removeprefix(whose).removesuffix(tail))
        if path.name.startswith(whose) and owner:
            try:
                os.kill(int(owner[1]), 0)
            except ProcessLookupError:
                _remove(path)
            except (OSError, OverflowError):  # somebody else's process, or none that can be
                continue


def _make(path: Path) -> None:
    # not tempfile: its files are private to the user whatever the umask says
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def _try(path: Path) -> None:
    """Make a file and remove it: permissions alone do not tell whether that can be."""
    _make(path)
    path.unlink()


def _to_disk(path: Path) -> None:
    # a full disk may only be noticed when the system flushes the file
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
