"""Linear algebra on one thread, as in fits and evaluations."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from bulgefit.parallel.threads import one_blas_thread


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    with one_blas_thread():
        yield
