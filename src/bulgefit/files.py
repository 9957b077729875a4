"""How does an output file appear whole or not at all? It is written beside, then renamed."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bulgefit.errors import InputError

__all__ = ["atomic_path", "atomic_write_bytes", "atomic_write_text", "check_output"]


def check_output(path: str | os.PathLike[str], force: bool = False) -> Path:
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
        The file exists and `force` is false, is not a regular file, or its folder is missing.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: is a folder; name a file to write")
    if not target.parent.is_dir():
        raise InputError(f"{path}: the folder {target.parent} does not exist; make it first")
    if target.exists():
        # renaming over a device such as /dev/null would replace the device itself
        if not target.is_file():
            raise InputError(f"{path}: is not a regular file; name a file to write")
        if not force:
            raise InputError(f"{path}: exists; use --force to replace it")
    return target


@contextmanager
def atomic_path(path: str | os.PathLike[str], force: bool = False) -> Iterator[Path]:
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
    target = check_output(path, force)
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        # not tempfile: its files are private to the user whatever the umask says
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        _to_disk(temporary)
        os.replace(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(
            f"{path}: cannot be written ({reason}); nothing was changed, choose another place"
        ) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def atomic_write_bytes(path: str | os.PathLike[str], data: bytes, force: bool = False) -> None:
    """Write `data` to `path`, whole or not at all (see `atomic_path`)."""
    with atomic_path(path, force) as temporary:
        temporary.write_bytes(data)


def atomic_write_text(path: str | os.PathLike[str], text: str, force: bool = False) -> None:
    """Write `text` as UTF-8 to `path`, whole or not at all (see `atomic_path`)."""
    atomic_write_bytes(path, text.encode(), force)


def _to_disk(path: Path) -> None:
    # a full disk may only be noticed when the system flushes the file
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
