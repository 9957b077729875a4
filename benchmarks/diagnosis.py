"""How long a diagnosis takes: 2,000 points, 20 frames, the whole catalogue, two workers.

    python benchmarks/diagnosis.py [--workers 2] [--write docs/diagnosis_time.md]

The tests are made with clocks, so that `creep` is tried as well. Each is diagnosed by processes
that have loaded their kernels before, as `bulgefit diagnose --workers` does.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import platform
import sys
import time
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

import bulgefit
from bulgefit.parallel.workers import open_executor
from bulgefit.trial.make import Recipe, make_test

KINDS = ("none", "clamp_slip", "rigid_motion", "knee", "two", "soft_patch", "frame_bend")
#: Spacing (mm) that gives some 2,000 points.
RECIPE = Recipe(frames=20, spacing=3.85)
WANTED_SECONDS = 60


def timed(kind: str, seed: int, executor: Executor, workers: int) -> list[str]:
    """A row of the table."""
    made = make_test(kind, seed, RECIPE)
    (block,) = made.test.blocks
    measured = block.measured.any(axis=0).sum()
    test = made.test
    if test.time is None:
        test = replace(test, time=np.arange(float(test.n_frames)))
    began = time.perf_counter()
    found = bulgefit.diagnose(test, executor=executor, workers=workers)
    seconds = time.perf_counter() - began
    print(f"{kind}: {seconds:.1f} s", file=sys.stderr, flush=True)
    judged = found.prepared[0].data.used.any(axis=2).any(axis=0).sum()
    causes = " + ".join("/".join((c.effect, *c.alternatives)) for c in found.causes)
    return [
        " + ".join(made.truth["effects"]) or "nothing", f"{measured}", f"{judged}",
        f"{test.n_frames}", f"{found.verdict} {causes}".strip(), f"{seconds:.1f}",
    ]  # fmt: skip


def page(rows: list[list[str]], workers: int) -> str:
    """The table as Markdown."""
    head = ["made with", "points", "judged", "frames", "answer", "s"]
    lines = [head, ["---"] * len(head), *rows]
    return (
        "\n\n".join(
            [
                "# How long a diagnosis takes",
                f"Made by `python benchmarks/diagnosis.py`; Python {platform.python_version()}, "
                f"{workers} workers on {os.cpu_count()} cores, kernels compiled. Wall time of one "
                f"diagnosis over the whole catalogue (wanted: {WANTED_SECONDS} s).",
                "\n".join("| " + " | ".join(line) + " |" for line in lines),
            ]
        )
        + "\n"
    )


def main() -> None:
    """Run, and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="Markdown file")
    args = parser.parse_args()
    with open_executor(args.workers, processes=args.workers > 1) as executor:
        small = make_test("clamp_slip", args.seed, Recipe(12, 8.0)).test
        bulgefit.diagnose(small, executor=executor)  # loads the kernels
        rows = [timed(kind, args.seed + k, executor, args.workers) for k, kind in enumerate(KINDS)]
    text = page(rows, args.workers)
    if args.write:
        args.write.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
