"""How do data get to the workers? Once to each other process: by files, or scattered by Dask.

Objects of a kind that is marked `sent_once` (measured data) travel apart from the rest, by a name
of their own, so that a process that has them from an earlier call is not sent them again.
"""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import tempfile
import threading
import weakref
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from bulgefit.errors import InputError
from bulgefit.files import drop_abandoned, own_name
from bulgefit.parallel.cluster import asked, client_of

__all__ = ["drop_files", "sent", "sent_once"]

Kind = TypeVar("Kind", bound=type)

_BINARY = getattr(os, "O_BINARY", 0)

#: Kinds that are `sent_once`.
_once: tuple[type, ...] = ()


def sent_once(kind: Kind) -> Kind:
    """Mark a class whose objects never change: each process is sent each of them once.

    They are told apart by identity, and may be weakly referred to.
    """
    global _once
    _once += (kind,)
    return kind


@contextmanager
def sent(executor: Executor, shared: Any) -> Iterator[list[Any]]:
    """What opens as `shared` wherever a task asks for it, and the parts that it is opened with."""
    client = client_of(executor)
    if client is not None and shared is not None:
        yield _scattered(client, shared)
        return
    here = _Here(shared)
    try:
        yield [here]
    finally:
        here.close()


def _scattered(client: Any, shared: Any) -> list[Any]:
    """What opens as `shared` on a cluster, and parcels with its parts, new ones in a single one."""
    content, parts = _packed(shared)
    labels = {name: _labels[part] for name, part in parts.items()}
    missing = {n: parts[n] for n, label in labels.items() if not label.is_held_by(client)}
    parcels = [_Parcel(content), *([_Parcel(_pickled(missing))] if missing else [])]
    with asked(client):
        whole, *new = client.scatter(parcels, broadcast=True, hash=False)
    for name in missing:
        labels[name].cluster, labels[name].parcel = client.id, new[0]
    return [whole, *{id(label.parcel): label.parcel for label in labels.values()}.values()]


class _Here:
    """Data at home. Other processes are told of files, which are written for the first of them."""

    def __init__(self, value: Any) -> None:
        self._value = value
        self._lock = threading.Lock()
        self._told: tuple[str, str, dict[str, str]] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        if self._value is None:
            return _Here, (None,)
        with self._lock:
            if self._told is None:
                content, parts = _packed(self._value)
                files = {name: _filed_once(part) for name, part in parts.items()}
                self._told = _filed(content), hashlib.sha256(content).hexdigest(), files
        return _from_files, self._told

    def opened(self, parts: Sequence[Any]) -> Any:
        """The data; they came with their parts."""
        return self._value

    def close(self) -> None:
        """Remove the file, if there is one; those of the parts stay for the next call."""
        if self._told is not None:
            _remove(self._told[0], os.getpid())


class _Parcel:
    """Pickled data, opened once in each process that is asked for them.

    Workers pass it on to each other unopened. It is opened from bytes, since arrays that come
    straight off the wire may lie at odd addresses, for which kernels would be compiled anew.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._lock = threading.Lock()
        self._opened: tuple[Any, ...] = ()

    def __reduce__(self) -> tuple[Any, ...]:
        return _Parcel, (self._content,)

    def __sizeof__(self) -> int:
        # what Dask believes it holds: the pickle and what comes out of it
        return 2 * len(self._content)

    def opened(self, parts: Sequence[_Parcel] = ()) -> Any:
        """What was packed; parts that travelled apart come from parcels of their own, by name."""
        with self._lock:
            if not self._opened:
                found = {name: part for parcel in parts for name, part in parcel.opened().items()}
                self._opened = (_unpacked(self._content, found),)
            return self._opened[0]


class _Label:
    """What a part is called on its travels, and where it has been sent.

    Attributes
    ----------
    name : str
    file : str
        For other processes of this machine; "" before it is written.
    cluster, parcel : str, Future
        Of Dask: the client that it was last scattered by, and the parcel it is in there.
    """

    def __init__(self) -> None:
        self.name, self.file, self.cluster = uuid4().hex, "", ""
        self.parcel: Any = None

    def is_held_by(self, client: Any) -> bool:
        """Whether the cluster has it, and has not lost it since."""
        return bool(self.cluster == client.id and self.parcel.status == "finished")


#: Of every part that was sent, as long as the part lives.
_labels: weakref.WeakKeyDictionary[Any, _Label] = weakref.WeakKeyDictionary()
_labelling = threading.Lock()


class _Packer(pickle.Pickler):
    """Pickles all but what is sent once, and tells that by its name."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.parts: dict[str, Any] = {}

    def persistent_id(self, value: Any) -> str | None:
        """The name of a part."""
        if not isinstance(value, _once):
            return None
        with _labelling:
            name = _labels.setdefault(value, _Label()).name
        self.parts[name] = value
        return name


class _Unpacker(pickle.Unpickler):
    def __init__(self, content: bytes, parts: Mapping[str, Any]) -> None:
        super().__init__(io.BytesIO(content))
        self._parts = parts

    def persistent_load(self, name: str) -> Any:
        """The part of that name."""
        return self._parts[name]


def _packed(value: Any) -> tuple[bytes, dict[str, Any]]:
    """The pickle of all but the parts that are sent once, and those by name."""
    file = io.BytesIO()
    packer = _Packer(file)
    packer.dump(value)
    return file.getvalue(), packer.parts


def _unpacked(content: bytes, parts: Mapping[str, Any]) -> Any:
    return _Unpacker(content, parts).load()


def _pickled(value: Any) -> bytes:
    return pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)


#: Files of data that this process wrote or read.
_files: set[str] = set()


#: Their names begin and end with these.
_HEAD, _TAIL = "bulgefit-", ".pickle"


def _filed(content: bytes) -> str:
    folder = Path(tempfile.gettempdir())
    _sweep(folder)
    file = str(folder / own_name(_HEAD, _TAIL))
    _files.add(file)
    try:
        # the user's alone, whatever the umask says
        made = os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY | _BINARY, 0o600)
        with open(made, "wb") as out:
            out.write(content)
    except OSError as error:
        _remove(file, os.getpid())
        raise InputError(
            f"{folder}: what the worker processes need cannot be written there "
            f"({error.strerror or error}); make room, or name another folder in TMPDIR"
        ) from error
    return file


@cache
def _sweep(folder: Path) -> None:
    """Remove what is left of processes that were killed together with all their workers."""
    with suppress(OSError):  # a folder that may be written to and not be read
        drop_abandoned(folder, _HEAD, _TAIL)


def _filed_once(part: Any) -> str:
    """The file of a part, which stays as long as the part."""
    label = _labels[part]
    with _labelling:
        if label.file not in _files:
            label.file = _filed(_pickled(part))
            weakref.finalize(part, _remove, label.file, os.getpid())
    return label.file


def _remove(file: str, owner: int) -> None:
    """Remove a file; not from a fork of the process that wrote it."""
    if os.getpid() == owner:
        with suppress(FileNotFoundError):
            os.unlink(file)
        _files.discard(file)


def drop_files() -> None:
    """Remove the files of data that this process wrote or read: it is told to end."""
    for file in [*_files]:
        _remove(file, os.getpid())


#: What this process was last sent by files: parts by name, and all by the checksum of its pickle.
_parts: dict[str, Any] = {}
_received: dict[str, _Here] = {}
_receiving = threading.Lock()


def _from_files(file: str, checksum: str, parts: Mapping[str, str]) -> _Here:
    with _receiving:
        if checksum not in _received:
            _files.update([file, *parts.values()])
            _received.clear()  # the last is enough, and they are large
            for name in _parts.keys() - parts.keys():
                del _parts[name]
            for name in parts.keys() - _parts.keys():
                _parts[name] = pickle.loads(Path(parts[name]).read_bytes())
            _received[checksum] = _Here(_unpacked(Path(file).read_bytes(), _parts))
        return _received[checksum]
