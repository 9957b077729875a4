"""Which threads are there? Those that balance frames side by side, and one for linear algebra."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, TypeVar

__all__ = ["one_blas_thread", "pool_of", "side_by_side"]

Item = TypeVar("Item")
Result = TypeVar("Result")

_lock = threading.Lock()
_blocks = 0
_limit: Any = None


@lru_cache(maxsize=1)
def _controller() -> Any:
    # importing scipy.linalg first makes its BLAS visible to the controller
    import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread: its matrices are small here, and threads only get in their way.

    The limit is the process's: the first block of any thread sets it, the last one lifts it.
    """
    global _blocks, _limit
    with _lock:
        if _blocks == 0:
            _limit = _controller().limit(limits=1, user_api="blas")
        _blocks += 1
    try:
        yield
    finally:
        with _lock:
            _blocks -= 1
            if _blocks == 0:
                _limit.restore_original_limits()


def side_by_side(
    task: Callable[[Item], Result], items: Iterable[Item], threads: int
) -> list[Result]:
    """`[task(item) for item in items]`, by so many threads; the first error in order is raised."""
    if threads == 1:
        return [task(item) for item in items]
    with pool_of(threads) as pool:
        return list(pool.map(task, items))


@contextmanager
def pool_of(threads: int) -> Iterator[ThreadPoolExecutor]:
    """So many threads until the block ends; what was not started by then is dropped.

    They end what they are at before the block does, unless it is left by a Ctrl-C: nothing can
    stop a thread, and whoever gives up does not wait for what no one will ask for.
    """
    pool, wait = ThreadPoolExecutor(threads), True
    try:
        yield pool
    except KeyboardInterrupt:
        wait = False
        raise
    finally:
        pool.shutdown(wait, cancel_futures=True)
