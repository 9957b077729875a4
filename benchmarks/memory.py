"""Does one process fit for ever in the memory that its first fits took?

    python benchmarks/memory.py [--fits 100] [--workers 2]

Fits the example of data/, each time from other starts: between bounds where all paths are stable,
and, a tenth as often, where shear is so soft that paths end and start anew. Prints the memory
of the process as it goes, and leaves with status 1 where the second half of the fits takes more
than the spread of its own readings and a tenth of what the first half took.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import bulgefit

HERE = Path(__file__).resolve().parents[1]
#: MPa.
BOUNDS = {
    "stable": {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)},
    "soft": {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (2.0, 4.0)},
}


def resident() -> float:
    """Memory of this process, MB; Linux."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def grows(kind: str, fits: int, workers: int) -> bool:
    """Fit, print the memory, and say whether it grows."""
    test = bulgefit.read_test(HERE / "data" / "example_bulge.npz")
    began, held = time.perf_counter(), []
    for seed in range(fits):
        bulgefit.fit(test, bounds=BOUNDS[kind], starts=workers, seed=seed, workers=workers)
        held.append(resident())
        if (seed + 1) % max(1, fits // 10) == 0:
            seconds = time.perf_counter() - began
            print(f"{kind}: {seed + 1} fits, {held[-1]:.0f} MB, {seconds:.0f} s", flush=True)
    first, second = np.array_split(held, 2)
    allowed = max(0.1 * first.max(), second.std())
    return bool(second.max() - first.max() > allowed)


def main() -> int:
    """Both kinds of fits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fits", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    counts = {"stable": args.fits, "soft": max(2, args.fits // 10)}
    growing = [kind for kind, fits in counts.items() if grows(kind, fits, args.workers)]
    print(f"grows: {', '.join(growing) or 'nowhere'}")
    return int(bool(growing))


if __name__ == "__main__":
    sys.exit(main())
