"""How long a diagnosis takes, and in how much memory: 2,000 points, 20 frames, all causes.

    python benchmarks/diagnosis.py [--workers 2] [--write docs/diagnosis_time.md]
    python benchmarks/diagnosis.py --pace

The tests are made with clocks, so that what goes by time is tried as well; one has a cause that no
catalogue has, one has it beside others that have names, and one is a family of three specimens.
Each is diagnosed by `bulgefit diagnose` in a process of its own. Linux, which tells the memory.
With --pace it is told what is left when a stage begins, over the time so far: `gap/pace.py` has it.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import bulgefit
from bulgefit.gap import diagnose
from bulgefit.gap.pace import Pace, Stage
from bulgefit.parallel.workers import open_executor
from bulgefit.trial.family import make_family
from bulgefit.trial.make import Recipe, make_test
from sections import marked, put

KINDS = ("none", "clamp_slip", "rigid_motion", "two", "five", "soft_patch", "beside", "family")
#: Spacing (mm) that gives some 2,000 points.
RECIPE = Recipe(frames=20, spacing=3.85)
WANTED_SECONDS, WANTED_MB = 60, 1500
#: Seconds between two looks at the memory.
LOOK = 0.2


@dataclass(frozen=True)
class Spent:
    """What one diagnosis took.

    Attributes
    ----------
    wall, processor : float, s
        The processor's over all processes.
    memory : float, MB
        Most that all processes had together, what they share counted once.
    """

    wall: float
    processor: float
    memory: float


def made(kind: str, seed: int) -> tuple[tuple[bulgefit.BulgeTest, ...], list[str]]:
    """Tests of a kind, with clocks, and the effects that they were made with."""
    if kind == "family":
        family = make_family(seed, RECIPE)
        tests, truth = family.tests, family.truth
    else:
        one = make_test(kind, seed, RECIPE)
        tests, truth = (one.test,), one.truth
    clocks = (
        t if t.time is not None else replace(t, time=np.arange(float(t.n_frames))) for t in tests
    )
    return tuple(clocks), truth["effects"]


def diagnosed(files: Sequence[Path], workers: int) -> tuple[dict[str, Any], Spent]:
    """The answer, and what it took."""
    out = files[0].with_suffix(".json")
    asked = [*map(str, files), "--workers", str(workers), "--quiet", "--json", str(out)]
    began, most = time.perf_counter(), [0.0]
    process = subprocess.Popen(
        [sys.executable, "-m", "bulgefit", "diagnose", *asked],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(LOOK):
            most[0] = max(most[0], _memory(process.pid))

    watcher = threading.Thread(target=watch)
    watcher.start()
    _, status, used = os.wait4(process.pid, 0)
    ended.set()
    watcher.join()
    if status:
        raise SystemExit(f"{files[0].name}: the diagnosis ended with status {status}")
    wall = time.perf_counter() - began
    return json.loads(out.read_text()), Spent(wall, used.ru_utime + used.ru_stime, most[0])


def _memory(session: int) -> float:
    """MB of all processes of a session, what they share counted once."""
    total = 0.0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if os.getsid(int(folder.name)) != session:
                continue
            lines = (folder / "smaps_rollup").read_text().splitlines()
        except OSError:  # it has ended
            continue
        total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
    return total * 1024 / 1e6


def row(kind: str, seed: int, workers: int, folder: Path) -> list[str]:
    """Of the table."""
    tests, effects = made(kind, seed)
    files = [folder / f"{kind}_{k}.npz" for k in range(len(tests))]
    for test, file in zip(tests, files, strict=True):
        bulgefit.write_test(test, file)
    answer, spent = diagnosed(files, workers)
    print(f"{kind}: {spent.wall:.1f} s", file=sys.stderr, flush=True)
    causes = [" or ".join((c["effect"], *c["alternatives"])) for c in answer["causes"]]
    causes += [f"{f['field']} ({f['place']})" for f in answer["fields"]]
    points = sum(len(b.reference) for test in tests for b in test.blocks)
    return [
        ", ".join(effects) or "nothing", f"{points}", f"{tests[0].n_frames}",
        answer["verdict"], ", ".join(causes),
        f"{spent.wall:.0f}", f"{spent.processor:.0f}", f"{spent.memory:.0f}",
    ]  # fmt: skip


def paced(kind: str, seed: int, workers: int) -> dict[Stage, float]:
    """What was left when each stage began, over the time so far."""
    tests, _ = made(kind, seed)
    told = list[tuple[Stage, float]]()

    class Watched(Pace):
        def begins(self, stage: Stage) -> None:
            told.append((stage, time.monotonic()))

    with (
        open_executor(workers, processes=workers > 1) as executor,
        patch.object(diagnose, "Pace", Watched),
    ):
        began = time.monotonic()
        diagnose.diagnose(tests, executor=executor, workers=workers)
        ended = time.monotonic()
    return {stage: (ended - at) / (at - began) for stage, at in told}


def paces(kinds: Sequence[str], seed: int, workers: int) -> None:
    """Print the least and the most of all kinds."""
    found = [paced(kind, seed + k, workers) for k, kind in enumerate(kinds)]
    for stage in Stage:
        ratios = sorted(one[stage] for one in found if stage in one)
        if ratios:
            print(f"{stage.name}: {ratios[0]:.3f} to {ratios[-1]:.3f} ({len(ratios)} tests)")


def page(rows: list[list[str]], workers: int, beside: str) -> str:
    """The table as Markdown."""
    head = [
        "made with", "points", "frames", "verdict", "found", "wall, s", "processor, s", "memory, MB"
    ]  # fmt: skip
    lines = [head, ["---"] * len(head), *rows]
    told = (
        f"Made by `python benchmarks/diagnosis.py`; Python {platform.python_version()}, "
        f"{workers} workers on {os.cpu_count()} cores, kernels compiled before. One "
        "`bulgefit diagnose` over the whole catalogue and all fields each (wanted: "
        f"{WANTED_SECONDS} s and {WANTED_MB} MB for one test): wall time from its start to its "
        "end, the processor's over all processes, and most that these had together."
    )
    return (
        "\n\n".join(
            [
                "# How long a diagnosis takes",
                f"{told} {beside}".strip(),
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
    parser.add_argument("--kinds", default=",".join(KINDS), help="of tests, apart by commas")
    parser.add_argument("--beside", default="", help="a sentence on what else the machine did")
    parser.add_argument("--write", type=Path, help="Markdown file")
    parser.add_argument("--pace", action="store_true", help="tell what is left at each stage")
    args = parser.parse_args()
    if args.pace:
        paces(args.kinds.split(","), args.seed, args.workers)
        return
    with tempfile.TemporaryDirectory() as folder:
        rows = [
            row(kind, args.seed + k, args.workers, Path(folder))
            for k, kind in enumerate(KINDS)
            if kind in args.kinds.split(",")
        ]
    text = page(rows, args.workers, args.beside)
    if args.write:
        put(marked("time", text), args.write)
    print(text)


if __name__ == "__main__":
    main()
