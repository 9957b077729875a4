"""What of a long run is done already? A journal on disk, from which an interrupted run goes on.

A journal is one file. Its first record says what the run was asked, others which files it writes,
so that whoever goes on may replace them; each further one holds the result of one piece of work,
with its length and checksum before it, on the disk before the next is begun. A record that was
being written when all ended does not fit its checksum, and is done again.

A run does its pieces in an order that depends on nothing but what it was asked, so a piece is known
by its call of `kept` or `spread` and its place in it.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import os
import pickle
import struct
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from enum import Enum
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from bulgefit.errors import InputError, UnsolvedError
from bulgefit.files import atomic_write_bytes, open_regular

__all__ = ["Journal", "journaled", "kept", "outputs_of", "within_a_piece"]

Result = TypeVar("Result")

_MAGIC = b"bulgefit journal 1\n"
#: Before each record: the call and the place that it is the result of, its length, and its SHA-256.
_HEAD = struct.Struct("<QQQ32s")
#: Call and place of what the run was asked, and of the outputs that it names: of no piece.
_ASKED, _OUTPUTS = (0, 0), (0, 1)

#: What numpy's arrays and numbers are made by when they are read. Other names are classes of ours.
_NUMPY = {
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
}

#: Of the thread that leads a run.
_current: ContextVar[Journal | None] = ContextVar("journal", default=None)


class Journal:
    """Results of the pieces that are done, in a file that is held by this process alone.

    Parameters
    ----------
    path : Path
    file : binary file
        Open for reading and writing, locked.
    tell : callable
        Told in one line when nothing more can be written; the run goes on without.
    """

    def __init__(self, path: Path, file: BinaryIO, tell: Callable[[str], None]) -> None:
        self.path, self._file, self._tell = path, file, tell
        self._places: dict[int, dict[int, int]] = {}
        self._outputs: set[str] = set()
        self._calls = 0
        self._writes = True

    @property
    def is_empty(self) -> bool:
        """Whether no piece is done."""
        return not self._places

    def call(self) -> int:
        """The number of the next call of `kept` or `spread`."""
        self._calls += 1
        return self._calls

    def known(self, call: int) -> Iterator[tuple[int, Any]]:
        """Place and result of what is done of a call, one after the other.

        Raises
        ------
        InputError
            The file holds what no run of bulgefit writes.
        """
        for index, place in sorted(self._places.get(call, {}).items()):
            record = _record(self._file, place)
            if record is None:
                raise InputError(f"{self.path}: was changed meanwhile; begin anew with --force")
            yield index, _opened(record[2], self.path)

    def keep(self, call: int, index: int, result: Any) -> None:
        """Write the result of one piece, and wait until it is on the disk."""
        place = self._append(call, index, lambda file: pickle.dump(result, file, protocol=5))
        if place is not None:
            self._places.setdefault(call, {})[index] = place

    def note(self, outputs: Iterable[str]) -> None:
        """Write which files the run writes, but for those that are known."""
        if new := sorted({*outputs} - self._outputs):
            self._append(*_OUTPUTS, lambda file: file.write(json.dumps(new).encode()))

    def _append(self, call: int, index: int, write: Callable[[_Summed], object]) -> int | None:
        """Where a record stands once it is on the disk; None where it cannot be written.

        Its content goes there as it is made: as a whole it would be in memory beside the result.
        Until its head is written it has one that fits no content.
        """
        if not self._writes:
            return None
        place = self._file.seek(0, os.SEEK_END)
        try:
            self._file.write(bytes(_HEAD.size))
            content = _Summed(self._file)
            write(content)
            self._file.seek(place)
            self._file.write(_HEAD.pack(call, index, content.length, content.sha256.digest()))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            self._writes = False
            with suppress(OSError):
                self._file.truncate(place)
            self._tell(
                f"{self.path}: cannot be written ({error.strerror}); the run goes on, and what it "
                "does from here is not kept for --resume"
            )
            return None
        return place

    def read(self) -> Mapping[str, Any] | None:
        """What the run was asked, once the places of all that is done are known.

        What follows the last whole record is cut off. None where not even the first is whole.
        """
        first = _record(self._file, len(_MAGIC))
        if first is None:
            return None
        place = self._file.tell()
        while (record := _record(self._file, place)) is not None:
            call, index, content = record
            if (call, index) == _OUTPUTS:
                self._outputs.update(json.loads(content))
            else:
                self._places.setdefault(call, {})[index] = place
            place = self._file.tell()
        self._file.truncate(place)
        return dict(json.loads(first[2]))

    def close(self) -> None:
        """Let the file go."""
        with suppress(OSError):  # what could not be written was told
            self._file.close()


@contextmanager
def within_a_piece() -> Iterator[Journal | None]:
    """The journal of the run that this thread leads; in the block there is none.

    Pieces of a piece would be counted where it is done, and not where it is known.
    """
    journal = _current.get()
    token = _current.set(None)
    try:
        yield journal
    finally:
        _current.reset(token)


def kept(work: Callable[[], Result]) -> Result:
    """`work()`, or what it was if the run's journal has it.

    It must depend on nothing that another piece leaves behind beside its result.
    """
    with within_a_piece() as journal:
        if journal is None:
            return work()
        call = journal.call()
        for _, result in journal.known(call):
            return result
        result = work()
        journal.keep(call, 0, result)
        return result


@contextmanager
def journaled(
    path: str | os.PathLike[str],
    asked: Mapping[str, Any],
    *,
    resume: bool = False,
    force: bool = False,
    outputs: Iterable[str] = (),
    tell: Callable[[str], None] = lambda line: None,
) -> Iterator[Journal]:
    """Keep what is done in the block, and take what was done before.

    The journal is removed when the block ends well, when nothing was done in it, and when it ends
    as it would again: where nothing has an equilibrium.

    Parameters
    ----------
    path : path
        Of the journal.
    asked : mapping, JSON types
        All that the result depends on: arguments, checksums of inputs, versions.
    resume : bool
        Go on from a journal that is there; where there is none, begin.
    force : bool
        Begin anew where there is a journal and `resume` is false.
    outputs : iterable of str
        What the run writes beside the journal, for `outputs_of`.
    tell : callable
        Told in one line that the journal cannot be written any more.

    Raises
    ------
    InputError
        There is a journal, and neither `resume` nor `force` is said; it is of a run that was asked
        something else; another run holds it; or it is none.
    """
    place = Path(path)
    plain = json.loads(json.dumps(asked))
    if not (resume and os.path.lexists(place)):
        if os.path.lexists(place) and not force:
            raise InputError(
                f"{place}: holds what an interrupted run had done; go on from it with --resume, or "
                "begin anew with --force"
            )
        if force and place.is_file():
            _locked(place).close()  # not while another run is at it
        _begin(place, plain, force)
    journal = Journal(place, _locked(place), tell)
    token = _current.set(journal)
    try:
        _check_asked(journal, plain)
        journal.note(outputs)
        ended = False
        try:
            yield journal
            ended = True
        except UnsolvedError:
            ended = True
            raise
        finally:
            if ended or journal.is_empty:
                journal.close()
                with suppress(OSError):
                    place.unlink(missing_ok=True)
    finally:
        _current.reset(token)
        journal.close()


def outputs_of(path: str | os.PathLike[str]) -> frozenset[str]:
    """The outputs that a journal's runs named; none of what is no journal."""
    found: set[str] = set()
    with suppress(InputError, OSError), open_regular(path) as file:
        place = len(_MAGIC)
        if file.read(place) != _MAGIC:
            return frozenset()
        while (record := _record(file, place)) is not None:
            call, index, content = record
            if (call, index) == _OUTPUTS:
                found.update(json.loads(content))
            place = file.tell()
    return frozenset(found)


def _begin(place: Path, asked: Mapping[str, Any], force: bool) -> None:
    content = json.dumps(asked).encode()
    head = _HEAD.pack(*_ASKED, len(content), hashlib.sha256(content).digest())
    atomic_write_bytes(place, _MAGIC + head + content, force)


def _locked(place: Path) -> BinaryIO:
    """The file of a journal, which no other process holds."""
    try:
        with open_regular(place) as file:
            if file.read(len(_MAGIC)) != _MAGIC:
                raise InputError(f"{place}: is no journal of bulgefit; name another place for it")
        held = open(place, "r+b")  # noqa: SIM115  (it is held as long as the run)
    except OSError as error:
        raise InputError(f"{place}: cannot be opened ({error.strerror})") from error
    try:
        _lock(held)
    except BlockingIOError:
        held.close()
        raise InputError(
            f"{place}: another run is at it; wait for its end, or name another output"
        ) from None
    return held


def _lock(file: BinaryIO) -> None:
    """Hold a file until this process closes it or ends, however it ends."""
    try:
        import fcntl
    except ImportError:  # Windows, where two runs on one journal are not told apart
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks
        return


def _check_asked(journal: Journal, asked: Mapping[str, Any]) -> None:
    """Refuse a journal of a run that was asked something else, and say what."""
    before = journal.read()
    if before is None:
        raise InputError(f"{journal.path}: damaged at its beginning; begin anew with --force")
    for part in {**before, **asked}:
        old, new = before.get(part), asked.get(part)
        if old != new:
            raise InputError(
                f"{journal.path}: is of another run, with {_difference(part, old, new)}; give what "
                "was given then, or begin anew with --force instead of --resume"
            )


def _difference(part: str, old: Any, new: Any) -> str:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in {**old, **new}:
            if old.get(name) != new.get(name):
                return _difference(f"{part} {name}", old.get(name), new.get(name))
    return f"{part} {json.dumps(old)}, not {json.dumps(new)}"


def _record(file: BinaryIO, place: int) -> tuple[int, int, bytes] | None:
    """Call, place in it and content of a record, the file then standing behind it.

    None where none is whole.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(place)
    if size - place < _HEAD.size:
        return None
    call, index, length, checksum = _HEAD.unpack(file.read(_HEAD.size))
    if length > size - place - _HEAD.size:
        return None
    content = file.read(length)
    return (call, index, content) if hashlib.sha256(content).digest() == checksum else None


def _opened(content: bytes, path: Path) -> Any:
    try:
        return _Reader(io.BytesIO(content)).load()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except Exception as error:  # a damaged pickle raises nearly anything
        raise InputError(f"{path}: damaged; begin anew with --force") from error


def _named(found: type) -> bool:
    """Whether it is a tuple with named fields, such as the keys of what a diagnosis found."""
    return issubclass(found, tuple) and hasattr(found, "_fields")


class _Summed:
    """The content of a record on its way into the file: its length and checksum so far."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.length, self.sha256 = 0, hashlib.sha256()

    def write(self, part: bytes | memoryview) -> int:
        """Write what comes next."""
        self._file.write(part)
        self.length += memoryview(part).nbytes
        self.sha256.update(part)
        return memoryview(part).nbytes


class _Reader(pickle.Unpickler):
    """Makes arrays, and results of our own classes; a journal runs nothing that it names."""

    def find_class(self, module: str, name: str) -> Any:
        """A class of results, or what makes an array; loaded already by whoever made the result."""
        found: Any = getattr(sys.modules.get(module), name, None)
        if (module, name) in _NUMPY:
            return found
        ours = module.startswith("bulgefit.") and isinstance(found, type)
        if ours and (dataclasses.is_dataclass(found) or issubclass(found, Enum) or _named(found)):
            return found
        raise InputError(f"asks for {module}.{name}, which is no result; begin anew with --force")
