"""Is anything lost where a verb is killed? A few of the kills of benchmarks/kills.py."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    spec = spec_from_file_location("kills", Path(__file__).parents[2] / "benchmarks" / "kills.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("verb", "number"), [("convert", 4), ("align", 3), ("crossval", 2), ("fit", 2)]
)
def test_a_kill_loses_nothing(
    verb: str, number: int, benchmark: ModuleType, tmp_path: Path
) -> None:
    assert len(benchmark.kills([verb], number, 1, tmp_path)) == number
