"""Diagnose made tests whose truth lies beside them, and say how near the diagnosis comes.

python benchmarks/practice.py ../shared/practice --write docs/practice.md

A folder of tests with a `truth.json` (file: effect, parameters, E1, E2, G12), as another program
made them.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import bulgefit

MODULI = ("E1", "E2", "G12")


def diagnosed(path: Path) -> tuple[str, dict[str, Any], float]:
    """The name of a file, its diagnosis as JSON types, and the seconds it took."""
    began = time.perf_counter()
    found = bulgefit.diagnose(bulgefit.read_test(path)).to_dict()
    return path.name, found, time.perf_counter() - began


def row(name: str, found: dict[str, Any], seconds: float, truth: dict[str, Any]) -> str:
    """A line of the table."""
    causes = ", ".join(f"{c['effect']} ({c['probability']:.3f})" for c in found["causes"]) or "none"
    moduli = found["parameters"]["corrected"]
    errors = [
        f"{100 * (moduli[m]['value'] / truth[m] - 1):+.2f} % "
        f"({(moduli[m]['value'] - truth[m]) / moduli[m]['stderr']:+.1f})"
        for m in MODULI
    ]
    cells = [name, truth["effect"], found["verdict"], causes, *errors, f"{seconds:.0f}"]
    return f"| {' | '.join(cells)} |"


def main() -> int:
    """Diagnose the folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path, help="the page; default: printed")
    args = parser.parse_args()
    truth = json.loads((args.folder / "truth.json").read_text())
    with ProcessPoolExecutor(args.workers) as pool:
        found = list(pool.map(diagnosed, [args.folder / name for name in truth]))
    lines = [
        "# Made tests of another program, with their truth",
        "",
        f"Made by `python benchmarks/practice.py` ({platform.machine()}, Python "
        f"{platform.python_version()}). The program that made them, and",
        "its mesh, are not bulgefit's. In brackets: of causes their probability, of moduli the "
        "error in standard errors. The tests were at hand while the diagnosis was built.",
        "",
        "| test | truth | verdict | causes | E1 | E2 | G12 | s |",
        "|---|---|---|---|---|---|---|---|",
        *(row(name, answer, seconds, truth[name]) for name, answer, seconds in found),
        "",
    ]
    text = "\n".join(lines)
    if args.write is None:
        sys.stdout.write(text)
    else:
        args.write.write_text(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
