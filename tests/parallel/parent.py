"""A program of three workers: one computes for ever, one sleeps for ever, one has done its work."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from numba import njit

from bulgefit.parallel.parcels import sent_once
from bulgefit.parallel.spread import spread
from bulgefit.parallel.workers import open_executor


@njit(nogil=True)
def _compute(count: int) -> float:
    total = 0.0
    for i in range(count):
        total += 1.0 / (1.0 + i * total)
    return total


@sent_once
class Folder:
    """Where workers write down who they are; sent to each of them as measured data are."""

    def __init__(self, path: str) -> None:
        self.path = path


def stay(folder: Folder, item: int) -> float:
    """Write down who this is, and do one's part."""
    _compute(10)
    Path(folder.path, f"worker{item}").write_text(str(os.getpid()))
    if item == 0:
        return float(_compute(10**13))
    if item == 1:
        time.sleep(1000)
    return 0.0


if __name__ == "__main__":
    signal.alarm(300)  # it outlives a test that is killed itself, but not for ever
    with open_executor(3, processes=True) as pool:
        spread(pool, stay, Folder(sys.argv[1]), range(3))
