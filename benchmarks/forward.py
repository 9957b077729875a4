"""Time one forward path, its gradient and its growth with the mesh; write docs/performance.md.

    python benchmarks/forward.py [--repeats 9] [--peers fenicsx,felupe,calculix] [--rounds 3]
                                 [--no-growth] [--dolfinx-python /usr/bin/python3] [--write FILE]

One thread, medians of processor time: on an idle machine the same as time by the clock, on a busy
one the fairer of the two. Peers solve the same mesh, law and pressure levels, each in a process of
its own that times the solution alone; we and they take turns, round by round. A peer that is not
installed is said so and left out.
"""

from __future__ import annotations

from forward_timing import (  # first: pins the threads
    CONSTANTS,
    HERE,
    LEVELS,
    STIFFNESS,
    THICKNESS,
    at_levels,
    in_turn,
    mirrored,
    seconds,
    study_mesh,
)

import argparse  # isort: skip
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.linalg import lapack
from scipy.sparse.csgraph import reverse_cuthill_mckee

from bulgefit.fem.equilibrium import flat_guess, solve
from bulgefit.fem.linear import BandedFactor, SparseLU, has_pardiso
from bulgefit.fem.membrane import Membrane, State
from bulgefit.fem.mesh import Mesh
from bulgefit.fem.path import Path as ShapePath
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.fem.trace import trace
from forward_gradient import gradients
from forward_growth import growth


def factorisations(mesh: Mesh, law: str, shape: np.ndarray, repeats: int) -> dict[str, float]:
    """Seconds of one factorisation of the same tangent, by every way at hand."""
    jobs: dict[str, Callable[[], object]] = {}
    for name in ["banded", "superlu"] + ["pardiso"] * has_pardiso():
        membrane = Membrane(mesh, THICKNESS, law, solver=name)
        state = membrane.state(shape, 0.1, STIFFNESS)
        jobs[name] = partial(membrane.factorise, state)
        if name == "superlu":
            jobs["rcm"] = partial(lapack.dpbtrf, rcm_band(membrane, state), lower=1)
    return in_turn(jobs, repeats, batch=5)


def rcm_band(membrane: Membrane, state: State) -> np.ndarray:
    """The tangent's lower band in the order of scipy's reverse Cuthill-McKee."""
    linear = membrane.linear
    assert isinstance(linear, SparseLU)
    assert state.tangent is not None
    full = linear.matrix(state.tangent).tocsr()
    order = reverse_cuthill_mckee(full, symmetric_mode=True)
    entries = full[order][:, order].tocoo()
    below = entries.row - entries.col
    band = np.zeros((below.max() + 1, linear.size), order="F")
    band[below[below >= 0], entries.col[below >= 0]] = entries.data[below >= 0]
    return band


def operations(membrane: Membrane) -> Counter[str]:
    """How often a path with its levels assembles and substitutes."""
    count: Counter[str] = Counter()
    state, substitute = Membrane.state, BandedFactor.solve

    def counted_state(
        self: Membrane,
        *at: Any,
        tangent: bool = True,
        along: tuple[np.ndarray, float] | None = None,
    ) -> State:
        name = "tangent" if tangent else "residual"
        count[name if along is None else f"{name}, slope's too"] += 1
        return state(self, *at, tangent=tangent, along=along)

    def counted_solve(self: BandedFactor, right: np.ndarray) -> np.ndarray:
        count["substitution" if right.ndim == 1 else "substitution, slope's too"] += 1
        return substitute(self, right)

    with (
        patch.object(Membrane, "state", counted_state),
        patch.object(BandedFactor, "solve", counted_solve),
    ):
        trace(membrane, STIFFNESS)
    return count


def largest_error(membrane: Membrane, path: ShapePath) -> float:
    """Error (mm) of the dense output at the 200 levels, against balanced shapes of the whole."""
    return max(
        np.abs(solve(membrane, shape, p, STIFFNESS, follow=True).displacement - shape).max()
        for shape, p in zip(path(LEVELS), LEVELS, strict=True)
    )


def one_path(mesh: Mesh, law: str, repeats: int) -> tuple[list[str], list[str]]:
    """The rows of a path by quarter and whole, and those of where the time goes."""
    membrane = Membrane(mesh, THICKNESS, law)
    quarter = mirrored(membrane)
    part = trace(quarter.even, STIFFNESS)
    paths = {"quarter": trace_by_quarter(membrane, STIFFNESS), "whole": trace(membrane, STIFFNESS)}
    path = paths["whole"]
    shape = path(0.1)[0]
    state = membrane.state(shape, 0.1, STIFFNESS)
    factor = membrane.factorise(state)
    count = operations(membrane)
    slope = path.slope[-1], 3.0 * np.cbrt(0.1) ** 2
    two = np.array([state.residual, state.residual]).T
    one = in_turn(
        {
            "quarter": partial(at_levels, membrane, trace_by_quarter),
            "whole": partial(at_levels, membrane),
            "levels of the quarter": lambda: trace(quarter.even, STIFFNESS),
            "stability of the rest": lambda: quarter.stable(part, STIFFNESS),
            "tangent": lambda: membrane.state(shape, 0.1, STIFFNESS),
            "tangent, slope's too": lambda: membrane.state(shape, 0.1, STIFFNESS, along=slope),
            "residual": lambda: membrane.state(shape, 0.1, STIFFNESS, tangent=False),
            "residual, slope's too": lambda: membrane.state(
                shape, 0.1, STIFFNESS, tangent=False, along=slope
            ),
            "substitution": lambda: factor.solve(state.residual),
            "substitution, slope's too": lambda: factor.solve(two),
            "dense output": lambda: path(LEVELS),
        },
        3 * repeats,
        batch=5,
    )
    each = factorisations(mesh, law, shape, 3 * repeats)
    n, best = path.factorisations, min(each, key=each.__getitem__)
    ways = " | ".join(f"{1e3 * each[w]:.2f}" if w in each else "-" for w in WAYS)
    own = len(quarter.odd) * len(part.pressure)
    counts = {"quarter": f"{part.factorisations} + {own} of a quarter", "whole": str(n)}
    rows = [
        f"| {law} | {name} | {1e3 * one[name]:.1f} | {counts[name]} | {len(found.pressure)} "
        f"| {largest_error(membrane, found):.1e} | {ways} "
        f"| {one[name] / (n * each[best]):.2f} ({best}) | {found(0.3)[0, mesh.apex, 2]:.5f} |"
        for name, found in paths.items()
    ]
    totals = {name: one.pop(name) for name in paths}
    levels = len(part.pressure)
    by_quarter = {
        name: (levels, one.pop(name) / levels)
        for name in ("levels of the quarter", "stability of the rest")
    }
    by_quarter["dense output"] = (1, one["dense output"])
    whole = {"factorisation": (n, each["banded"])}
    whole |= {name: (count.get(name, 1), time) for name, time in one.items()}
    shares = [
        line
        for name, parts in (("quarter", by_quarter), ("whole", whole))
        for line in _shares(f"| {law} | {name}", totals[name], parts)
    ]
    return rows, shares


def _shares(head: str, total: float, parts: dict[str, tuple[int, float]]) -> list[str]:
    """Rows on what each part, so many times so many seconds, takes of the whole."""
    rest = total - sum(k * time for k, time in parts.values())
    return [
        *(
            f"{head} | {name} | {k} | {1e3 * time:.2f} | {100 * k * time / total:.0f} % |"
            for name, (k, time) in parts.items()
        ),
        f"{head} | Python and the rest | | | {100 * rest / total:.0f} % |",
    ]


#: Ways to factorise, and what the page calls them.
WAYS = {
    "rcm": "LAPACK band, RCM",
    "banded": "LAPACK band, our order",
    "superlu": "SuperLU, MMD",
    "pardiso": "PARDISO",
}


def paths(name: str, mesh: Mesh, repeats: int) -> list[str]:
    """The section on one path."""
    found = [one_path(mesh, law, repeats) for law in ("hencky", "svk")]
    ways = " | ".join(f"ms: {way}" for way in WAYS.values())
    return [
        f"## One path, 0.001 to 3 bar, 200 levels ({name} mesh)",
        "",
        "*Quarter*: as fits and `simulate` trace it, the membrane being alike in both mirrors; "
        "*whole*: as where it is not. The error is the dense output's against the "
        "balanced shape of the whole membrane, the largest of all nodes and of all 200 levels "
        "(wanted: 1e-3). The ms are those of one factorisation of the whole tangent. The limit is "
        "the whole path's factorisations alone, each by the fastest way (wanted: 1.5 of it).",
        "",
        f"| law | traced | ms a path | factorisations | solved levels | error, mm | {ways} "
        "| path / limit | apex at 3 bar, mm |",
        "|" + "---|" * (8 + len(WAYS)),
        *(row for rows, _ in found for row in rows),
        "",
        "Where the time goes:",
        "",
        "| law | traced | what | times | ms each | of the path |",
        "|---|---|---|---|---|---|",
        *(line for _, shares in found for line in shares),
        "",
        *LIMIT.splitlines(),
    ]


LIMIT = """\
The limit is that of any program that factorises the whole tangent. A path by quarter stays below
it since the tangent of its shapes is a quarter as large and its band a third as wide; the other
three quarters of the displacements are factorised once a level, to see that the fabric is stable
against them.

A path of the whole is not at 1.5 times the limit. A factor serves a whole level, at the price of
more residuals and substitutions, which are cheaper than it: that lowers the limit more than the
path. Beside factorisations there are substitutions, which read the whole factor from beyond the
second cache twice, tangents, whose 78 entries a cell go to scattered places of a band that is
cleared first, and residuals. "Slope's too": the path's slope is found by the way, with a second
right-hand side."""


#: How many times what FEniCSx takes for the levels compiling may take: 15 s where that takes 5.7 s.
COMPILING = 15.0 / 5.7

#: Peers' scripts, and how many times faster is wanted.
PEERS = {"fenicsx": ("FEniCSx", 40), "felupe": ("felupe", 90), "calculix": ("CalculiX", None)}


def against_peers(
    mesh: Mesh, names: list[str], rounds: int, dolfinx_python: str
) -> tuple[list[str], list[str], dict[str, float]]:
    """Rows of the table of peers, a line on each that is absent, and the others' seconds."""
    membrane = Membrane(mesh, THICKNESS, "svk")
    apex = float(trace(membrane, STIFFNESS)(0.3)[0, mesh.apex, 2])
    ways = {"traced by quarter": trace_by_quarter, "traced whole": trace}
    ours: dict[str, list[float]] = {way: [] for way in ways}
    absent: list[str] = []
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.npz"
        first = flat_guess(membrane, LEVELS[0], STIFFNESS)[:, 2].max()
        np.savez(
            case, nodes=mesh.nodes, cells=mesh.cells, rim=mesh.rim, levels=LEVELS,
            stiffness=STIFFNESS, constants=CONSTANTS, thickness=THICKNESS, radius=membrane.radius,
            first_height=first,
        )  # fmt: skip
        for turn in range(rounds):
            for way, traced in ways.items():
                ours[way].append(seconds(partial(at_levels, membrane, traced), 5))
            for name in names:
                if name == "calculix" and turn > 0:
                    continue  # minutes: once is enough
                python = dolfinx_python if name == "fenicsx" else sys.executable
                answer = ask([python, str(HERE / "peers" / f"{name}_case.py"), str(case)])
                if isinstance(answer, str):
                    absent.append(f"{PEERS[name][0]} was not measured: {answer}")
                    names = [other for other in names if other != name]
                else:
                    found[name].append(answer)
    rows = [
        f"| bulgefit, all levels to 1e-3 mm, {way} | {median(times):.4f} | {rounds} | | | | |"
        for way, times in ours.items()
    ]
    for name, answers in found.items():
        if answers:
            time_, last = median(a["seconds"] for a in answers), answers[-1]
            wanted = PEERS[name][1]
            faster = " and ".join(f"{time_ / median(times):.0f}" for times in ours.values())
            rows.append(
                f"| {last['version']} | {time_:.2f} | {len(answers)} | {last['iterations']} "
                f"| {faster} | {wanted or '-'} "
                f"| {last['apex_mm'] - apex:+.5f} |"
            )
    took = {n: median(a["seconds"] for a in answers) for n, answers in found.items() if answers}
    return rows, absent, took


def ask(command: list[str]) -> dict[str, Any] | str:
    """A peer's answer, or the last line of why it has none."""
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=900)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if run.returncode:
        return (run.stderr.strip().splitlines() or ["no message"])[-1]
    return json.loads(run.stdout.strip().splitlines()[-1])


#: Prints the processor time of imports and a first path, and that of a second path.
FIRST_PATH = """
import time; start = time.process_time()
import numpy as np
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.quarter import trace_by_quarter
for _ in range(2):
    stiffness = np.array([316.8, 239.4, 57.5, 5.0])
    trace_by_quarter(Membrane(disc(), 0.81), stiffness, sensitivities=True)
    print(time.process_time() - start); start = time.process_time()
"""


def first_run(rounds: int, fenicsx: float | None) -> list[str]:
    """Processor time that a first and a second process compile, cache empty; what they say.

    Beside it what FEniCSx took for the levels (s), since machines and their hours differ.
    """
    spent: dict[str, list[float]] = {"first": [], "second": []}
    said = {}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            for process, times in spent.items():
                run = subprocess.run(
                    [sys.executable, "-c", FIRST_PATH],
                    env={**os.environ, "NUMBA_CACHE_DIR": folder},
                    capture_output=True, text=True, check=True,
                )  # fmt: skip
                whole, path = (float(line) for line in run.stdout.split())
                times.append(whole - path)
                said[process] = run.stderr.strip() or "nothing"
    first, second = (median(times) for times in spent.values())
    return [
        "## First run", "",
        f"Compiling, cache empty: {first - second:.1f} s (wanted: 15). With the imports "
        f"{first:.1f} s, {min(spent['first']):.1f} to {max(spent['first']):.1f} in {rounds} "
        f"rounds. It says: `{said['first']}`.", "",
        *_in_fenicsx(first - second, fenicsx),
        f"A second process: {second:.1f} s, the imports and the reading of the cache. It says "
        f"{said['second']}.",
    ]  # fmt: skip


def _in_fenicsx(seconds_: float, fenicsx: float | None) -> list[str]:
    if fenicsx is None:
        return []
    return [
        f"Compiling takes {seconds_ / fenicsx:.1f} times what FEniCSx took just before for the "
        f"levels above (wanted: {COMPILING:.1f} times).",
        "",
    ]


def main() -> None:
    """Measure, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--peers", default=",".join(PEERS), help="which, with commas; '' for none")
    parser.add_argument("--rounds", type=int, default=3, help="of the peers and of first runs")
    parser.add_argument("--no-growth", action="store_true")
    parser.add_argument("--dolfinx-python", default="/usr/bin/python3")
    parser.add_argument("--write", type=Path, default=HERE.parent / "docs/performance.md")
    options = parser.parse_args()
    name, mesh = study_mesh()
    lines = [
        "# Performance of the membrane solver",
        "",
        f"Made by `python benchmarks/forward.py`; Python {platform.python_version()}, one thread, "
        "medians of processor time.",
        "",
        *paths(name, mesh, options.repeats),
    ]
    peers = [name for name in options.peers.split(",") if name]
    took: dict[str, float] = {}
    if peers:
        rows, absent, took = against_peers(mesh, peers, options.rounds, options.dolfinx_python)
        lines += [
            "", f"## Against others: svk, 200 levels ({name} mesh)", "",
            "Each in turn, round by round; imports and compilation are not counted. FEniCSx and "
            "felupe start every level from the shape of the one before; FEniCSx has its "
            "fastest direct solver here (PETSc's LU), felupe SuperLU with `MMD_AT_PLUS_A`. "
            "CalculiX is timed as a program, once, and starts with an imperfection of 0.1 mm; its "
            "automatic increments stop at every level.", "",
            "| program | s | rounds | Newton iterations | bulgefit is faster by | wanted "
            "| apex at 3 bar less ours, mm |",
            "|---|---|---|---|---|---|---|", *rows, *([""] if absent else []), *absent,
        ]  # fmt: skip
    start_up = first_run(options.rounds, took.get("fenicsx"))
    lines += ["", *gradients(mesh, options.repeats)]
    if not options.no_growth:
        lines += ["", *growth()]
    lines += ["", *start_up]
    page = "\n".join(lines) + "\n"
    print(page)
    options.write.write_text(page)


if __name__ == "__main__":
    main()
