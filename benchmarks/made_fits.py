"""Do fits find the moduli of tests in which nothing is wrong, and do their intervals hold them?

    python benchmarks/made_fits.py [--tests 20] [--first 9000] [--write docs/fit.md]
                                   [--keep FILE]

The tests are the blind trial's, of the kind `none`: another mesh, another way to see it, noise
that is correlated in space, holes, static frames. Each is fitted by the default objective from one
start, with the static frames and without them. --keep adds a line of JSON for each test to a file
as soon as it is done, and takes from there what is done already.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import json
import platform
import sys
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

import bulgefit
from bulgefit.trial.make import Recipe, make_test
from sections import marked, put

#: What is wanted: per cent of the moduli, share of the intervals that hold the truth.
WANTED = {"E1": 0.3, "E2": 0.3, "G12": 2.0}
HELD = (0.93, 0.97)
#: What is fitted of each test.
WAYS = ("as it is", "static left out")


def fitted(test: bulgefit.BulgeTest) -> dict[str, Any]:
    """What a fit finds, and how sure it says it is."""
    began = time.perf_counter()
    found = bulgefit.fit(test, starts=1)
    entries = found.to_dict()["parameters"]
    keys = ("value", "stderr", "interval95", "stderr_noise", "stderr_blocks", "stderr_parts")
    return {
        "parameters": {name: {key: entries[name][key] for key in keys} for name in WANTED},
        "misfit": found.quality.misfit_over_noise,
        "seconds": time.perf_counter() - began,
    }


def done(seed: int) -> dict[str, Any]:
    """A test's truth and its fits."""
    made = make_test("none", seed, Recipe(static=True))
    tests = (made.test, replace(made.test, static_displacement=None))
    found = {way: fitted(test) for way, test in zip(WAYS, tests, strict=True)}
    return {"seed": seed, "truth": made.truth["moduli"], **found}


def every(seeds: Iterable[int], keep: Path | None) -> list[dict[str, Any]]:
    """All tests, those that were done before from the file."""
    known: dict[int, dict[str, Any]] = {}
    if keep is not None and keep.exists():
        lines = [json.loads(line) for line in keep.read_text().splitlines()]
        known = {line["seed"]: line for line in lines}
    out = []
    for seed in seeds:
        if seed not in known:
            known[seed] = done(seed)
            if keep is not None:
                with keep.open("a") as file:
                    file.write(json.dumps(known[seed]) + "\n")
            print(f"{seed}: {known[seed]['as it is']['seconds']:.1f} s", file=sys.stderr)
        out.append(known[seed])
    return out


def row(name: str, way: str, tests: list[dict[str, Any]]) -> list[str]:
    """A modulus in fits done in one way."""
    fits = [(t["truth"][name], t[way]["parameters"][name]) for t in tests]
    off = np.array([100.0 * abs(found["value"] / truth - 1.0) for truth, found in fits])
    told = [(truth, found) for truth, found in fits if found["stderr"] is not None]
    z = np.array([(found["value"] - truth) / found["stderr"] for truth, found in told])
    held = sum(found["interval95"][0] <= truth <= found["interval95"][1] for truth, found in told)
    low, high = binomtest(held, len(told)).proportion_ci(0.95, "wilson")
    return [
        name, way, f"{len(fits)}", f"{np.median(off):.3f}", f"{off.max():.3f}",
        f"{100 * held / len(told):.1f} ({100 * low:.0f} to {100 * high:.0f})",
        f"{z.mean():+.2f}", f"{z.std(ddof=1):.2f}",
    ]  # fmt: skip


def page(tests: list[dict[str, Any]], command: str) -> str:
    """The table as Markdown."""
    head = ["", "fitted", "fits", "median, %", "largest, %", "interval holds, %", "mean z", "sd z"]
    rows = [row(name, way, tests) for name in WANTED for way in WAYS]
    table = "\n".join("| " + " | ".join(r) + " |" for r in [head, ["---"] * len(head), *rows])
    seconds = np.median([t[way]["seconds"] for t in tests for way in WAYS])
    return (
        "## Tests in which nothing is wrong\n\n"
        f"Made by `{command}` ({platform.machine()}, Python {platform.python_version()}): "
        f"{len(tests)} tests of the blind trial's maker without an effect, some 1,300 points, "
        f"20 loaded and 4 static frames each. *Median*, *largest*: of |found/true - 1|. *Interval "
        f"holds*: the share of 95 % intervals with the truth in them, and between what the share "
        f"of all such tests lies (95 %, Wilson). *z*: (found - true)/standard error, of mean 0 and "
        f"deviation 1 where the errors are right. *Static left out*: static frames taken away, so "
        f"that the noise is judged by the loaded frames alone. Median time of a fit "
        f"{seconds:.1f} s.\n\n"
        f"{table}\n\nWanted: {WANTED['E1']:g} % of E1 and E2, {WANTED['G12']:g} % of G12, "
        f"intervals that hold {100 * HELD[0]:.0f} to {100 * HELD[1]:.0f} %."
    )


def main() -> int:
    """Fit, print, and write the section into a page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tests", type=int, default=20, help="how many (default: 20)")
    parser.add_argument("--first", type=int, default=9000, help="seed (default: 9000)")
    parser.add_argument("--write", type=Path, help="page that gets the section")
    parser.add_argument("--keep", type=Path, help="file of what is done")
    args = parser.parse_args()
    tests = every(range(args.first, args.first + args.tests), args.keep)
    made = page(tests, f"python benchmarks/made_fits.py --tests {args.tests} --first {args.first}")
    if args.write is not None:
        put(marked("made_fits", made), args.write)
    print(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
