"""Fixtures that every floor's tests may use."""

from __future__ import annotations

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
