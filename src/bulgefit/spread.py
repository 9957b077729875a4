"""How does work reach its workers? In any executor, with the data sent once, lost work done again.

An executor is one of `concurrent.futures`: threads, processes, or a Dask client's. Results come in
the order of the items, so that they do not depend on who did what.
"""

from __future__ import annotations

import hashlib
import pickle
import socket
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bulgefit.errors import BulgefitError

__all__ = ["spread"]

#: Seconds without a result after which a scheduler is asked whether it is still there.
SILENCE = 3.0

#: Rounds after which work that is lost again and again is given up.
ROUNDS = 3


def spread(
    executor: Executor,
    task: Callable[[Any, Any], Any],
    shared: Any,
    items: Sequence[Any],
    done: Callable[[int, Any], None] = lambda index, result: None,
) -> list[Any]:
    """`[task(shared, item) for item in items]`, by the workers of an executor.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    task : callable
        Importable by other processes, where the executor has any.
    shared : object
        What all tasks need. Threads share it; every other process unpickles it once.
    items : sequence
    done : callable
        Told index and result of each item as it is finished, in the caller's thread.

    Raises
    ------
    BulgefitError
        Work was lost with its processes, and could not be done again.
    """
    left, found = dict(enumerate(items)), dict[int, Any]()
    for _ in range(ROUNDS):
        with _sent(executor, shared) as handle:
            for index, result in _results(executor, task, handle, left):
                found[index] = result
                del left[index]
                done(index, result)
        if not left:
            return [found[index] for index in range(len(items))]
        _renew(executor)
    raise BulgefitError(
        f"{len(left)} of {len(items)} tasks were lost {ROUNDS} times with the processes that did "
        "them, which may lack memory: use fewer workers, or larger machines"
    )


def _results(
    executor: Executor, task: Callable[[Any, Any], Any], handle: Any, left: dict[int, Any]
) -> Iterator[tuple[int, Any]]:
    """Index and result of whatever is not lost on its way."""
    futures: dict[Future[Any], int] = {}
    try:
        try:
            for index, item in left.items():
                futures[executor.submit(_run, task, handle, item)] = index
        except BrokenExecutor:
            pass  # what was not taken is left for the next round
        waiting = set(futures)
        while waiting:
            finished, waiting = wait(waiting, SILENCE, FIRST_COMPLETED)
            if not finished and not _is_there(executor):
                break  # nobody is left who would finish or cancel them
            for future in finished:
                try:
                    result = future.result()
                except (BrokenExecutor, CancelledError):
                    continue
                except Exception as error:
                    raise _told(error) from error
                yield futures[future], result
    finally:
        for future in futures:
            future.cancel()


def _run(task: Callable[[Any, Any], Any], handle: Any, item: Any) -> Any:
    return task(handle.value, item)


def _told(error: Exception) -> Exception:
    """Dask's own words for a task that took its workers down, as one of our errors."""
    if type(error).__name__ != "KilledWorker":
        return error
    return BulgefitError(
        "the cluster gave a task up, because the workers that tried it died one after the other; "
        "they may lack memory"
    )


def _renew(executor: Executor) -> None:
    """Make the executor ready for another round, or say why it cannot be."""
    client = _client_of(executor)
    if client is not None and _is_there(executor):
        return  # the cluster has other workers, or starts new ones
    if client is not None:
        raise BulgefitError("the cluster's scheduler was lost; start it and run this again")
    renew = getattr(executor, "renew", None)
    if renew is None:
        raise BulgefitError(
            "a worker process died, and its executor with it; it may have lacked memory: run this "
            "again with fewer workers"
        )
    renew()


def _is_there(executor: Executor) -> bool:
    """Whether the scheduler of a cluster still answers; a client may not notice that it does not.

    Executors of this machine cancel what they lose.
    """
    client = _client_of(executor)
    if client is None:
        return True
    if client.status != "running":
        return False
    place = urlsplit(client.scheduler.address)
    if place.scheme not in ("tcp", "tls"):
        return True
    try:
        with socket.create_connection((place.hostname, place.port), SILENCE):
            return True
    except OSError:
        return False


def _client_of(executor: Executor) -> Any:
    """The Dask client behind an executor, or None."""
    client = getattr(executor, "_client", None)  # Client.get_executor() has no public name for it
    return client if hasattr(client, "scatter") else None


@contextmanager
def _sent(executor: Executor, shared: Any) -> Iterator[Any]:
    """Something whose `value` is `shared` wherever a task of this executor asks for it."""
    client = _client_of(executor)
    if client is not None and shared is not None:
        # in a list, because scatter would take a list apart
        (handle,) = client.scatter([_Parcel(_pickled(shared))], broadcast=True, hash=False)
        yield handle
        return
    here = _Here(shared)
    try:
        yield here
    finally:
        here.close()


class _Here:
    """Data at home. Other processes are told of a file, and the file is written for the first."""

    def __init__(self, value: Any) -> None:
        self.value = value
        self._lock = threading.Lock()
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._told: tuple[str, str] = ("", "")

    def __reduce__(self) -> tuple[Any, ...]:
        if self.value is None:
            return _Here, (None,)
        with self._lock:
            if self._folder is None:
                content = _pickled(self.value)
                self._folder = tempfile.TemporaryDirectory(prefix="bulgefit-")
                file = Path(self._folder.name) / "shared.pickle"
                file.write_bytes(content)
                self._told = str(file), hashlib.sha256(content).hexdigest()
        return _from_file, self._told

    def close(self) -> None:
        """Remove the file, if there is one."""
        if self._folder is not None:
            self._folder.cleanup()


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

    @property
    def value(self) -> Any:
        """What was packed."""
        with self._lock:
            if not self._opened:
                self._opened = (pickle.loads(self._content),)
            return self._opened[0]


def _pickled(value: Any) -> bytes:
    return pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)


#: What this process was last sent by a file, by the checksum of its pickle.
_received: dict[str, _Here] = {}
_receiving = threading.Lock()


def _from_file(file: str, checksum: str) -> _Here:
    with _receiving:
        if checksum not in _received:
            _received.clear()  # one is enough, and they are large
            _received[checksum] = _Here(pickle.loads(Path(file).read_bytes()))
        return _received[checksum]
