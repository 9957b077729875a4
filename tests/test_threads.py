"""Is BLAS held to one thread for as long as anyone asks for it?"""

from __future__ import annotations

from threadpoolctl import threadpool_limits

from bulgefit.threads import _controller, one_blas_thread


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
