"""Does one seed give the same bits in another process, another hash seed, other workers?"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"
BOUNDS = ["--bounds", "E1=300:400,E2=200:300,G12=20:40", "--refine", "2"]

#: Short commands of every verb that works side by side on measured tests.
COMMANDS = {
    "fit": [*BOUNDS, "--starts", "2", "--max-evaluations", "6", "--bootstrap", "20"],
    "crossval": [*BOUNDS, "--starts", "1", "--max-evaluations", "6", "--max-pressure", "1"],
}


def found(verb: str, tests: list[Path], workers: int, hash_seed: int) -> dict[str, Any]:
    """What a fresh process answers, but for the time it took."""
    words = ["-m", "bulgefit", verb, *map(str, tests), *COMMANDS[verb]]
    done = subprocess.run(
        [sys.executable, *words, "--workers", f"{workers}", "--json", "-", "--quiet"],
        capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONHASHSEED": f"{hash_seed}"},
    )  # fmt: skip
    answer = json.loads(done.stdout)
    answer.pop("seconds", None)
    answer.pop("run")  # the command and its date
    return dict(answer)


@pytest.mark.parametrize("verb", COMMANDS)
def test_runs_agree_to_the_last_bit(verb: str) -> None:
    tests = [EXAMPLE] if verb == "fit" else [EXAMPLE, EXAMPLE.with_name("example_slip.npz")]
    assert found(verb, tests, 1, 1) == found(verb, tests, 2, 2)
