"""Does a path reach 3 bar, or say rightly why not? Random materials, fabrics and laws.

python benchmarks/robustness.py N [--seed S] [--refine R] prints the table of docs/verification.md.

Each set is traced from 0.001 to 3 bar. What comes out is checked by other means than the path's
own: equilibria by their residual and by the balance of work, U(p2) - U(p1) = ∫ p dV along the path;
answers by what they state: a limit pressure by a path to just below it and by descent that finds no
shape above; a loss of ellipticity by a stable path to just below it, and the
shape at its pressure, where the acoustic tensor is not positive definite.
"""

from __future__ import annotations

import argparse
import json
import os
import sys

os.environ.update(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from bulgefit.errors import Cause, InputError, SolveError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import NewtonError, solve
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.path import Path
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.fem.trace import trace

RANGE = (1e-4, 0.3)  # MPa
THICKNESS = 0.81  # mm
LAWS = ("hencky", "svk", "yarn")


@dataclass(frozen=True)
class Case:
    """One random set; moduli in MPa, angle in degrees, heights in mm."""

    law: str
    moduli: tuple[float, float, float]
    nu12: float
    angle: float
    slack: tuple[float, float]
    heights: tuple[float, ...]
    compliance: float | None

    def membrane(self, refine: int) -> Membrane:
        mesh = disc(100.0, refine)
        surface = None
        if any(self.heights):
            x, y = mesh.nodes.T / 100.0
            h0, hx, hy, c2, s2 = self.heights
            height = h0 + hx * x + hy * y + c2 * (x * x - y * y) + s2 * 2 * x * y
            surface = np.column_stack([mesh.nodes, (1 - x * x - y * y) * height])
        fabric = Fabric(surface=surface, slack=self.slack, compliance=self.compliance)
        return Membrane(mesh, THICKNESS, self.law, angle=np.radians(self.angle), fabric=fabric)


def draw(rng: np.random.Generator) -> Case:
    """A set; a third each have slack, an initial shape, a slipping clamp, turned axes."""
    e1, e2 = np.exp(rng.uniform(np.log(20.0), np.log(5000.0), 2))
    g12 = float(np.exp(rng.uniform(np.log(0.5), np.log(500.0))))
    has = rng.random(4) < 1 / 3
    slack, heights = rng.uniform(-0.02, 0.02, 2), rng.uniform(-10.0, 10.0, 5)
    return Case(
        law=str(rng.choice(LAWS)),
        moduli=(float(e1), float(e2), g12),
        nu12=float(rng.uniform(0.0, 0.45)),
        angle=float(rng.uniform(-90.0, 90.0)) if has[3] else 0.0,
        slack=(float(slack[0]), float(slack[1])) if has[0] else (0.0, 0.0),
        heights=tuple(heights.tolist()) if has[1] else (0.0,) * 5,
        compliance=float(rng.uniform(0.0, 0.1)) if has[2] else None,
    )


def stored(membrane: Membrane, shape: np.ndarray, stiffness: np.ndarray) -> tuple[float, float]:
    """Stored energy (N mm) and volume (mm³) at a shape."""
    energy, at_one = (
        membrane.state(shape, p, stiffness, tangent=False).potential for p in (0.0, 1.0)
    )
    return energy, energy - at_one


def faults(membrane: Membrane, stiffness: np.ndarray, path: Path) -> list[str]:
    """What is wrong with a path that claims equilibria."""
    found = []
    # N: what 1e-8 mm take. Newton's last correction is below 1e-9 mm, the stiffness of a cell a
    # few times D t, and at a rim that slips there are the clamp's springs
    allowed = np.full_like(membrane.reference, 1e-8 * stiffness.max() * THICKNESS)
    if membrane.clamp is not None:
        allowed[membrane.clamp.rim, :2] += 1e-8 * np.abs(membrane.clamp.stiffness).sum(axis=2)
    for shape, p in zip(path.displacement, path.pressure, strict=True):
        state = membrane.state(shape, float(p), stiffness, tangent=False)
        if (np.abs(state.residual) > membrane.gather(allowed)).any():
            found.append("residual")
            break
    if not any(_balances(membrane, stiffness, path, solved=solved) for solved in (False, True)):
        found.append("work")
    return found


def _balances(membrane: Membrane, stiffness: np.ndarray, path: Path, *, solved: bool) -> bool:
    """Whether the energy stored between the ends is p2 V2 - p1 V1 - ∫ V dp to a thousandth.

    With the volumes of the dense output; `solved`: of shapes that are balanced from it, or from the
    levels' own mean where it is too coarse for that.
    """
    at, weight = np.polynomial.legendre.leggauss(3 if solved else 6)
    levels = np.cbrt(path.pressure)
    work = 0.0
    for first, (low, high) in enumerate(pairwise(levels)):
        s = 0.5 * (low + high) + 0.5 * (high - low) * at
        mean = path.displacement[first : first + 2].mean(axis=0)
        for k, shape in enumerate(path(s**3)):
            if solved:
                found = _balanced(membrane, stiffness, float(s[k] ** 3), (shape, mean))
                if found is None:
                    return False
                shape = found
            volume = stored(membrane, shape, stiffness)[1]
            work += 0.5 * (high - low) * weight[k] * volume * 3 * s[k] ** 2
    (u1, v1), (u2, v2) = (stored(membrane, path.displacement[k], stiffness) for k in (0, -1))
    complementary = path.pressure[-1] * v2 - path.pressure[0] * v1 - work
    return bool(abs(u2 - u1 - complementary) <= 1e-3 * abs(u2 - u1))


def _balanced(
    membrane: Membrane, stiffness: np.ndarray, p: float, starts: tuple[np.ndarray, ...]
) -> np.ndarray | None:
    """The shape that balances a pressure, from the first start that leads to one."""
    for start in starts:
        with suppress(NewtonError):
            return solve(membrane, start, p, stiffness).displacement
    return None


def doubts(membrane: Membrane, stiffness: np.ndarray, error: SolveError) -> list[str]:
    """What speaks against an answer, by other paths than the one that gave it."""
    if error.cause is Cause.LIMIT_PRESSURE:
        try:
            below = trace(membrane, stiffness, (RANGE[0], 0.999 * error.reached))
        except SolveError:
            return ["no path to just below it"]
        try:
            solve(membrane, below.displacement[-1], 1.01 * error.reached, stiffness)
        except NewtonError:
            return []
        return ["an equilibrium above it"]
    if error.cause is Cause.LOSS_OF_ELLIPTICITY:
        try:
            below = trace(membrane, stiffness, (RANGE[0], 0.999 * error.reached))
        except SolveError:
            return ["no path to just below it"]
        # a branch that is close to its limit pressure, too, changes fast below it
        last = _balanced(membrane, stiffness, error.reached, (below.displacement[-1],))
        last = below.displacement[-1] if last is None else last
        if membrane.acoustic_margin(last, stiffness) >= 0.0:
            return ["elliptic beside it"]
        return [] if below.stable.all() else ["unstable below it"]
    return [error.reason]


def outcome(case: Case, refine: int) -> dict[str, object]:
    """Trace a set and check what comes out."""
    try:
        stiffness = orthotropic_stiffness(*case.moduli, case.nu12)
    except InputError:
        return {"outcome": Cause.INADMISSIBLE.name, "seconds": 0.0, "faults": []}
    membrane = case.membrane(refine)
    start = time.process_time()
    try:
        path = trace_by_quarter(membrane, stiffness, RANGE)
    except SolveError as error:
        took = time.process_time() - start
        return {
            "outcome": error.cause.name, "seconds": took, "reached": 10 * error.reached,
            "faults": doubts(membrane, stiffness, error),
        }  # fmt: skip
    took = time.process_time() - start
    return {
        "outcome": "stable" if path.stable.all() else "unstable", "seconds": took,
        "levels": len(path.pressure), "error": path.error_estimate,
        "faults": faults(membrane, stiffness, path),
    }  # fmt: skip


def table(found: list[tuple[Case, dict[str, Any]]]) -> list[str]:
    """Counts of outcomes by law, and times, as lines of Markdown."""
    count = Counter((str(f["outcome"]), case.law) for case, f in found)
    names = sorted({name for name, _ in count})
    lines = ["| outcome | " + " | ".join(LAWS) + " |", "|---|" + "---|" * len(LAWS)]
    lines += [f"| {n} | " + " | ".join(str(count[n, law]) for law in LAWS) + " |" for n in names]
    wrong = Counter(fault for _, f in found for fault in f["faults"])
    times = np.array([f["seconds"] for _, f in found if f["seconds"] > 0.0])
    rough = sum(f.get("error", 0.0) > 1e-3 for _, f in found)
    middle = float(np.median(times))
    return [
        *lines, "",
        f"Faults: {dict(wrong) or 'none'}. Dense output beyond its tolerance in {rough} paths.",
        f"Median {middle:.3f} s, longest {times.max():.2f} s, "
        f"{int((times > 20 * middle).sum())} over 20 times the median.",
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--refine", type=int, default=4)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    for law in LAWS:  # compile
        outcome(Case(law, (300.0, 200.0, 50.0), 0.2, 0.0, (0.0, 0.0), (0.0,) * 5, None), 1)
    found = []
    for k in range(args.count):
        case = draw(rng)
        found.append((case, outcome(case, args.refine)))
        print(k, case, json.dumps(found[-1][1]), file=sys.stderr, flush=True)
    print("\n".join(table(found)))


if __name__ == "__main__":
    main()
