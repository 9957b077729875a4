"""Fixtures that every floor's tests may use."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from bulgefit.fem import jit


@pytest.fixture(scope="session", autouse=True)
def _compiling_was_announced() -> None:
    """Before any test looks at what is said: the first one to run a kernel may have to compile."""
    jit._announce()


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of the published study's reference data, beside the repository."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not (folder / "data").is_dir():
        pytest.skip("the study's reference data (../shared/data) are not on this machine")
    return folder


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Address of a local Dask scheduler with two worker processes."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as found:
        # it gives up copies of idle data at times of its own, to be fetched from another worker
        found.scheduler.extensions["amm"].stop()
        yield found.scheduler_address
