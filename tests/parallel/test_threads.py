"""Is BLAS held to one thread for as long as anyone asks for it? Do threads keep the order?"""

from __future__ import annotations

import time

import pytest
from threadpoolctl import threadpool_limits

from bulgefit.parallel.threads import _controller, one_blas_thread, side_by_side


def threads() -> set[int]:
    found = _controller().info()
    return {library["num_threads"] for library in found if library["user_api"] == "blas"}


def test_blocks_of_one_blas_thread_may_overlap() -> None:
    """As those of two threads do, of which the one that began first ends first."""
    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        first, second = one_blas_thread(), one_blas_thread()
        first.__enter__()
        second.__enter__()
        assert threads() == {1}
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == before


def test_threads_answer_in_the_order_of_the_items() -> None:
    def late(item: int) -> int:
        time.sleep(0.02 * (3 - item))
        return item

    assert side_by_side(late, range(4), 3) == [0, 1, 2, 3]


@pytest.mark.parametrize("threads", [1, 2])
def test_the_first_error_in_order_is_raised(threads: int) -> None:
    def refuse(item: int) -> None:
        raise ValueError(f"item {item}")

    with pytest.raises(ValueError, match="item 0"):
        side_by_side(refuse, range(3), threads)
