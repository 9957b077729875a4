"""Memory that is free goes back to the system when it is asked for."""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path

import pytest

_BETWEEN = """
import numpy as np
from bulgefit.parallel.memory import give_back

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

pieces = [np.ones(12_000) for _ in range(600)]  # of 96 kB: below what the system maps apart
kept = pieces[-1]  # above all others: nothing between falls back by itself
pieces.clear()
before = resident()
give_back()
print(before - resident(), kept.sum())
"""


@pytest.mark.skipif(
    platform.libc_ver()[0] != "glibc" or not Path("/proc/self/statm").exists(),
    reason="another allocator, or nothing that tells the memory of a process",
)
def test_what_is_free_between_pieces_in_use_is_given_back():
    done = subprocess.run(
        [sys.executable, "-c", _BETWEEN], capture_output=True, text=True, check=True
    )
    given, kept = done.stdout.split()
    assert float(given) > 40.0
    assert float(kept) == 12_000
