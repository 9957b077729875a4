"""Which processes work for this one? Fresh ones, replaced where they die, gone when it is gone."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures import wait as settled
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any

from bulgefit.parallel.parcels import drop_files

__all__ = ["Processes"]

#: Seconds between the beats of a process.
BEAT = 1.0
#: Calls of `end_stalled` without a beat after which a process is given up. `spread` calls it every
#: three seconds without a result: a minute, sixty beats, of which a machine under load sends some.
UNHEARD = 20


class Processes(Executor):
    """Fresh processes, which end with this object, or with the process that made it.

    After one has died, `renew` starts others. One that stands still, because it was stopped or
    waits for what never comes, is told by the beat that every process sends.

    Parameters
    ----------
    workers : int
    """

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._open: set[Future[Any]] = set()
        self._fresh()

    def _fresh(self) -> None:
        # the end that this process alone holds is closed when it ends, however it ends
        far, self._leash = multiprocessing.Pipe(duplex=False)
        self._beats, pulse = multiprocessing.Pipe(duplex=False)
        self._silent: dict[int, int] = {}
        # spawned, so that they start the same everywhere and know nothing of this process
        self._pool = ProcessPoolExecutor(
            self._workers,
            multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(far, pulse),
        )

    @property
    def room(self) -> int:
        """Calls that processes have in hand, or the next of them will take."""
        return self._workers + 1

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As every executor."""
        with _without_interrupts():
            future = self._pool.submit(fn, *args, **kwargs)
        self._open.add(future)
        future.add_done_callback(self._open.discard)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """As every executor, but that processes end at once when their work is done.

        They are not asked to: one that was killed while it held the queue's lock would let the
        others wait for the question for ever.
        """
        if cancel_futures:
            for future in [*self._open]:
                future.cancel()
        if wait:
            settled([*self._open])
            self.kill()
        self._pool.shutdown(wait, cancel_futures=cancel_futures)

    def kill(self) -> None:
        """End the processes at once, in the midst of whatever they do."""
        self._leash.close()
        self._hear()
        # one that stands still does not see the leash go; a wait for the others would be one for
        # the pool to find them gone, and to complain of futures that were cancelled
        for child in self._children():
            child.kill()

    def rest(self) -> None:
        """End the processes when their work is done; fresh ones start with the next call."""
        self.shutdown()
        self._fresh()

    def renew(self) -> None:
        """Replace the processes."""
        self._pool.shutdown(cancel_futures=True)
        self._leash.close()
        self._fresh()

    def end_stalled(self) -> None:
        """End processes of which nothing was heard in the last `UNHEARD` calls of this.

        Calls are counted, and not seconds: they rest while this process itself is stopped.
        """
        heard = self._hear()
        for child in self._children():
            pid = child.pid or 0
            self._silent[pid] = 0 if pid in heard else self._silent[pid] + 1
            if self._silent[pid] >= UNHEARD:
                child.kill()

    def _hear(self) -> set[int]:
        """Who sent a beat since the last call."""
        heard = set()
        while self._beats.poll():
            heard.add(int.from_bytes(self._beats.recv_bytes(), "little"))
        for pid in heard:
            self._silent.setdefault(pid, 0)
        return heard

    def _children(self) -> list[Any]:
        """The processes that were ever heard of, as long as they live."""
        return [child for child in multiprocessing.active_children() if child.pid in self._silent]


def _begin(leash: Connection, pulse: Connection) -> None:
    """What a process does first."""
    # a terminal's Ctrl-C is for the process that started this one, and ends it by the leash
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(leash, pulse), daemon=True).start()


def _end_with(leash: Connection, pulse: Connection) -> None:
    """Send a beat as long as the other end of the leash is held; when it is closed, end.

    No signal does that everywhere: Linux alone tells of a parent's death, and means the thread
    that started the child. Kernels leave the interpreter to this thread while they compute.
    """
    with suppress(EOFError, OSError):
        while True:
            pulse.send_bytes(os.getpid().to_bytes(8, "little"))
            if leash.poll(BEAT):
                leash.recv_bytes()  # nothing is ever sent
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join(0.1)
    if not parent.is_alive():  # nobody is left who would remove them
        drop_files()
    os._exit(1)


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let processes that start here never see a Ctrl-C, not even before they `_begin`."""
    mask = getattr(signal, "pthread_sigmask", None)
    if mask is None:  # Windows
        yield
        return
    before = mask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, before)
