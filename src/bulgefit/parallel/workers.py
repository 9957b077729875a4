"""Where does work run? On threads or processes of this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from numbers import Integral

from bulgefit.errors import InputError
from bulgefit.parallel.cluster import opened
from bulgefit.parallel.parcels import drop_files
from bulgefit.parallel.processes import Processes
from bulgefit.parallel.threads import pool_of

__all__ = ["open_executor"]


@contextmanager
def open_executor(
    workers: int = 1, scheduler: str | None = None, *, processes: bool = False
) -> Iterator[Executor]:
    """An executor that ends with the block; what was not started by then is dropped.

    Parameters
    ----------
    workers : int
        Threads, or processes, of this machine.
    scheduler : str, optional
        Address of a Dask scheduler, tcp://host:port; its workers do the work instead.
    processes : bool
        Fresh processes instead of threads: they take a second or two to start, but nothing that
        runs in one of them waits for another.

    Raises
    ------
    InputError
        No scheduler answers there, it has no workers, or they are not as this process is; no
        number of workers.
    """
    if not isinstance(workers, Integral) or workers < 1:
        raise InputError(f"workers: give a whole number of 1 or more, not {workers!r}")
    if scheduler is not None:
        place = opened(scheduler)
    else:
        place = _processes(workers) if processes else pool_of(workers)
    with place as pool:
        yield pool


@contextmanager
def _processes(workers: int) -> Iterator[Executor]:
    """Processes that end with the block, at once where it is left by a Ctrl-C."""
    pool = Processes(workers)
    try:
        yield pool
    except KeyboardInterrupt:
        pool.kill()
        drop_files()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
