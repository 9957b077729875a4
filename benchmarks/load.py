"""Do diagnoses side by side give the bits of one alone, in the memory of one each?

    python benchmarks/load.py [--runs 8]

Each of them has two workers of its own, so that eight of them are twenty-four processes. Prints the
seconds and the largest process of one alone and of all together, and leaves with status 1 where a
result differs or a process grows by more than a tenth.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

from kills import VERBS, begun, contents, prepared


def side_by_side(folders: list[Path]) -> tuple[list[dict[str, object]], float, float]:
    """What each diagnosis leaves in its folder; seconds, and MB of the largest process so far."""
    began = time.monotonic()
    runs = [begun(VERBS["diagnose"][0], prepared(folder)) for folder in folders]
    for run in runs:
        said = run.communicate()[1]
        assert run.returncode == 0, said
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    seconds = time.monotonic() - began
    return [contents(folder, hidden=True) for folder in folders], seconds, largest


def main() -> int:
    """One alone, then all together."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=8)
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as place:
        (alone,), before, small = side_by_side([Path(place, "alone")])
        found, after, large = side_by_side([Path(place, str(k)) for k in range(runs)])
    other = sum(result != alone for result in found)
    print(f"alone: {before:.0f} s, largest process {small:.0f} MB")
    print(f"{runs} side by side: {after:.0f} s, largest process {large:.0f} MB, {other} differ")
    return int(other > 0 or large > 1.1 * small)


if __name__ == "__main__":
    sys.exit(main())
