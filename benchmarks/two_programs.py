"""Does the model see what the trial's program makes, where several effects act together?

    python benchmarks/two_programs.py [--number 400] [--seed 0] [--workers 2]
                                      [--write docs/trial.md]

Draws tests of two to six effects as the trial does, makes them without noise by its own program,
and predicts them by the model with the true parameters. What differs is the error of both meshes,
and whatever one of the two does otherwise: that would move moduli, or be taken for a cause, and no
noise would tell. Of one draw in three the warp lies at any angle, which its test says. Draws with a
reference state are left out, whose waves the model has no like for. Those that differ by more than
a tenth of the least noise are named.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import platform
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.random import SeedSequence, default_rng

import bulgefit
from bulgefit.trial.draw import Draw, draw
from bulgefit.trial.fabric import UnstableDrawError
from bulgefit.trial.recording import Recipe, place, record
from bulgefit.trial.signature import noise_free
from sections import marked, put

KINDS = ("two", "three", "four", "five", "six")
#: mm: a tenth of the least noise of the trial's tests, in plane and out of plane.
ALLOWED = np.array([0.5e-3, 0.5e-3, 1e-3])


@dataclass(frozen=True)
class Compared:
    """Root mean squares of dx, dy, dz (mm) by which the programs differ in one draw."""

    number: int
    drawn: Draw
    apart: np.ndarray


def compared(seed: int, number: int) -> Compared | None:
    """One draw by both programs; None where it is left out, or its own program makes no test of it.

    Raises
    ------
    SolveError
        The model has no shape where the trial's program has one: that is no less a difference.
    """
    rng = default_rng(SeedSequence([seed, number]))
    drawn = draw(KINDS[number % len(KINDS)], rng, 1.0)
    if drawn.waves:
        return None
    if number % 3 == 2:
        drawn = replace(drawn, mounted=float(rng.spawn(1)[0].uniform(-90.0, 90.0)))
    recipe = Recipe(spacing=9.0, heights=False, static=False)
    setting = place(drawn, rng, recipe)
    try:
        height, seen = noise_free(drawn, setting, recipe.fineness)
    except UnstableDrawError:
        return None
    # none, but for what tells noise from copies
    test = record(setting, height, seen, (1e-9, 1e-9), rng, "made", recipe, timed=True)
    found = bulgefit.predict(test, drawn.moduli, effects=drawn.parameters)
    apart = found.displacement - test.blocks[0].displacement
    return Compared(number, drawn, np.sqrt(np.nanmean(apart**2, axis=(0, 1))))


def table(found: Sequence[Compared], number: int, seed: int) -> str:
    """What was found, as Markdown."""
    apart = 1e3 * np.array([one.apart for one in found])
    pairs = {pair for one in found for pair in combinations(sorted(one.drawn.effects), 2)}
    lines = [
        f"Made by `python benchmarks/two_programs.py --number {number} --seed {seed}` "
        f"({platform.machine()}, Python {platform.python_version()}): of {len(found)} draws "
        f"without a reference state, in which {len(pairs)} pairs of effects meet, by how much (µm, "
        "root mean square over points and frames) the model and the trial's program differ.",
        "",
        "| | dx | dy | dz |",
        "|---|---|---|---|",
    ]
    for name, of in (("median", np.median(apart, axis=0)), ("largest", apart.max(axis=0))):
        lines.append(f"| {name} | " + " | ".join(f"{value:.2f}" for value in of) + " |")
    wide = [one for one in found if (one.apart > ALLOWED).any()]
    lines += ["", f"More than a tenth of the least noise: {len(wide)}."]
    for one in wide:
        off = ", ".join(f"{1e3 * value:.1f}" for value in one.apart)
        lines.append(f"- draw {one.number}, {off} µm: {', '.join(one.drawn.effects)}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--number", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the table into it")
    args = parser.parse_args()
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        every = pool.map(partial(compared, args.seed), range(args.number))
        found = []
        for number, one in enumerate(every, start=1):
            found += [one] if one is not None else []
            print(f"\r{number} of {args.number} draws", end="", file=sys.stderr)
    print(file=sys.stderr)
    text = table(found, args.number, args.seed)
    print(text)
    if args.write:
        put(marked("two programs", text), args.write)


if __name__ == "__main__":
    main()
