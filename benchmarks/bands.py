"""How much rougher does a frame get than earlier ones say, with bands of shear and without?

python benchmarks/bands.py N [--seed S] prints the table of docs/verification.md: of the random
materials of robustness.py, each on the default mesh and seen in 20 frames at points 7 mm apart,
those whose path is stable to 3 bar, and those that lose ellipticity, where many have bands, on a
path that goes on beyond. The roughest frame counts; without noise, and with 5 µm of it.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator

from bulgefit.errors import InputError, SolveError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.trace import trace
from bulgefit.gap.bands import excess_roughness
from robustness import RANGE, Case, draw

FRAMES = np.linspace(0.005, 0.3, 20)  # MPa
NOISE = (0.0, 0.005)  # mm
#: Between them the rule's threshold is to lie.
LIMITS = (0.0, 1.5, 2.5, 4.0, np.inf)


def points() -> np.ndarray:
    """7 mm apart up to 95 mm, off their grid by up to 1 mm, (points, 2)."""
    side = np.arange(-98.0, 99.0, 7.0)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    grid += np.random.default_rng(0).uniform(-1.0, 1.0, grid.shape)
    return grid[np.hypot(*grid.T) < 95.0]


def seen(case: Case, at: np.ndarray) -> tuple[str, np.ndarray] | None:
    """Which kind of path it is, and its frames (frames, points, 3); None where it has no 3 bar."""
    try:
        stiffness = orthotropic_stiffness(*case.moduli, case.nu12)
        membrane = case.membrane()
        membrane.law_parameters(stiffness)
        path = trace(membrane, stiffness, RANGE, beyond_ellipticity=True)
    except (InputError, SolveError):
        return None
    shapes = path(FRAMES)
    elliptic = min(membrane.acoustic_margin(shape, stiffness) for shape in shapes) >= 0.0
    if elliptic and not path.stable.all():
        return None
    nodes = membrane.mesh.nodes
    field = np.stack([CloughTocher2DInterpolator(nodes, shape)(at) for shape in shapes])
    return ("stable" if elliptic else "ellipticity lost"), field


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    at, found = points(), defaultdict[tuple[str, float], list[float]](list)
    for number in range(args.count):
        kind = seen(replace(draw(args.seed, number), refine=4), at)
        if number % 50 == 0:
            print(f"set {number} of {args.count}", file=sys.stderr)
        if kind is None:
            continue
        for noise in NOISE:
            drawn = noise * np.random.default_rng(number).standard_normal(kind[1].shape)
            found[kind[0], noise].append(float(excess_roughness(at, kind[1] + drawn).max()))
    heads = [f"{low:g} to {high:g}" for low, high in pairwise(LIMITS[:-1])]
    heads.append(f"over {LIMITS[-2]:g}")
    print("| path | noise, µm | sets | median | 99 % | most | " + " | ".join(heads) + " |")
    print("|---|---|---|---|---|---|" + "---|" * len(heads))
    for (kind_of, noise), excess in sorted(found.items(), key=lambda f: f[0][1], reverse=True):
        counts, _ = np.histogram(excess, LIMITS)
        middle, high = np.quantile(excess, (0.5, 0.99))
        cells = [kind_of, f"{1e3 * noise:g}", str(len(excess))]
        cells += [f"{v:.2f}" for v in (middle, high, max(excess))]
        print("| " + " | ".join(cells + [str(n) for n in counts.tolist()]) + " |")


if __name__ == "__main__":
    main()
