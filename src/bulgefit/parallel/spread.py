"""How does work reach its workers? In any executor, with the data sent once, lost work done again.

An executor is one of `concurrent.futures`: threads, processes, or a Dask client's. Results come in
the order of the items, so that they do not depend on who did what.

What a call shares goes to each other process once (see `parcels`). joblib does not stand here,
since it gives all up with a worker that dies (docs/house.md).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from itertools import islice
from typing import Any

from bulgefit.errors import BulgefitError
from bulgefit.parallel.cluster import client_of, comes_back, is_there, line_of
from bulgefit.parallel.journal import Journal, within_a_piece
from bulgefit.parallel.parcels import sent
from bulgefit.parallel.processes import Processes

__all__ = ["counted", "spread"]

#: Seconds without a result after which a scheduler is asked whether it is still there, and
#: processes whether they still run.
SILENCE = 3.0

#: Told of every `spread` that this thread calls how much of it is done.
_counter: ContextVar[Callable[[int, int], None]] = ContextVar(
    "counter", default=lambda done, total: None
)

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
        What all tasks need. Threads share it; every other process unpickles it once, and what is
        `sent_once` in it the first time alone.
    items : sequence
    done : callable
        Told index and result of each item as it is finished, in the caller's thread; of those that
        the run's journal has (see `journal`), first.

    Raises
    ------
    BulgefitError
        Work was lost with its processes, and could not be done again.
    """
    with within_a_piece() as journal:
        return _spread(executor, task, shared, items, done, journal)


def _spread(
    executor: Executor,
    task: Callable[[Any, Any], Any],
    shared: Any,
    items: Sequence[Any],
    done: Callable[[int, Any], None],
    journal: Journal | None,
) -> list[Any]:
    left, found = dict(enumerate(items)), dict[int, Any]()
    count = _counter.get()
    count(0, len(items))

    def take(index: int, result: Any) -> None:
        found[index] = result
        del left[index]
        done(index, result)
        count(len(found), len(items))

    call = 0 if journal is None else journal.call()
    for index, result in () if journal is None else journal.known(call):
        take(index, result)
    for _ in range(ROUNDS):
        if left:
            # the scheduler of a cluster may be lost before it has what it is sent
            with suppress(BrokenExecutor), sent(executor, shared) as handles:
                for index, result in _results(executor, task, handles, left):
                    if journal is not None:
                        journal.keep(call, index, result)
                    take(index, result)
        if not left:
            return [found[index] for index in range(len(items))]
        _renew(executor)
    raise BulgefitError(
        f"{len(left)} of {len(items)} tasks were lost {ROUNDS} times with the processes that did "
        "them, which may lack memory: use fewer workers, or larger machines"
    )


@contextmanager
def counted(counter: Callable[[int, int], None]) -> Iterator[None]:
    """Let `counter` be told of each `spread` in the block: how many items are done, of how many.

    First of none; the calls that tasks themselves make in other threads are their own affair.
    """
    token = _counter.set(counter)
    try:
        yield
    finally:
        _counter.reset(token)


def _results(
    executor: Executor, task: Callable[[Any, Any], Any], handles: list[Any], left: dict[int, Any]
) -> Iterator[tuple[int, Any]]:
    """Index and result of whatever is not lost on its way.

    Processes of our own are given what they have room for, and nothing is ever taken back: where
    they end, the pool of Python 3.11 complains of what was.
    """
    ours, line = isinstance(executor, Processes), line_of(executor)
    futures: dict[Future[Any], int] = {}
    waiting = set[Future[Any]]()
    todo = iter([*left.items()])
    try:
        while True:
            room = executor.room - len(waiting) if isinstance(executor, Processes) else len(left)
            with suppress(BrokenExecutor):  # what was not taken is left for the next round
                for index, item in islice(todo, room):
                    future = executor.submit(_run, task, handles, item)
                    futures[future] = index
                    waiting.add(future)
            if not waiting:
                break
            finished, waiting = wait(waiting, SILENCE, FIRST_COMPLETED)
            if not finished:
                if line_of(executor) is not line or not is_there(executor, SILENCE):
                    break  # nobody is left who would finish or cancel them
                if isinstance(executor, Processes):
                    executor.end_stalled()
            for future in finished:
                try:
                    result = future.result()
                except (BrokenExecutor, CancelledError):
                    continue
                except Exception as error:
                    raise _told(error) from error
                yield futures[future], result
    finally:
        for future in () if ours else futures:
            future.cancel()


def _run(task: Callable[[Any, Any], Any], handles: list[Any], item: Any) -> Any:
    shared, *parts = handles
    return task(shared.opened(parts), item)


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
    client = client_of(executor)
    if client is not None and (is_there(executor, SILENCE) or comes_back(executor)):
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
