"""Time one forward path and its growth with the mesh.

    python benchmarks/forward.py [--repeats 5] [--peers fenicsx,felupe,calculix] [--no-growth]
                                 [--dolfinx-python /usr/bin/python3] [--write docs/performance.md]

One thread, medians of processor time: on an idle machine the same as time by the clock, on a busy
one the fairer of the two. Peers solve the same mesh, law and pressure levels, each in a process of
its own that times the solution alone; we and they take turns, round by round. A peer that is not
installed is said so and left out.
"""

from __future__ import annotations

import os

os.environ.update(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

import argparse
import json
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import flat_guess, solve
from bulgefit.fem.linear import SOLVERS, has_pardiso
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh, disc
from bulgefit.fem.trace import trace

HERE = Path(__file__).resolve().parent
STUDY_MESH = HERE.parents[1] / "shared/data/abaqus/mesh.npz"
CONSTANTS = (303.0, 229.0, 5.0, 0.24)  # E1, E2, G12 MPa, nu12
STIFFNESS = orthotropic_stiffness(*CONSTANTS)
LEVELS = np.linspace(0.001, 3.0, 200) / 10  # MPa


def seconds(job: Callable[[], object], repeats: int) -> float:
    """Median processor time of a job, compiled and warm."""
    job()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        job()
        times.append(time.process_time() - start)
    return median(times)


def study_mesh() -> tuple[str, Mesh]:
    """The study's mesh, or our own where it is absent."""
    if not STUDY_MESH.is_file():
        return "own", disc()
    with np.load(STUDY_MESH) as data:
        return "study", Mesh.from_arrays(data["nodes"], data["cells"])


def one_path(mesh: Mesh, law: str, repeats: int) -> dict[str, float]:
    """A path with its 200 levels, against its factorisations alone."""
    membrane = Membrane(mesh, 0.81, law)
    path = trace(membrane, STIFFNESS)
    shapes = path(LEVELS)
    balanced = [
        solve(membrane, shape, pressure, STIFFNESS, follow=True).displacement
        for shape, pressure in zip(shapes, LEVELS, strict=True)
    ]
    state = membrane.state(path(0.1)[0], 0.1, STIFFNESS)
    total = seconds(lambda: trace(membrane, STIFFNESS)(LEVELS), repeats)
    factor = seconds(lambda: membrane.factorise(state), 5 * repeats)
    return {
        "seconds": total,
        "levels": len(path.pressure),
        "error": float(np.abs(shapes - np.array(balanced)).max()),
        "factorisations": path.factorisations,
        "one factorisation": factor,
        "ratio": total / (path.factorisations * factor),
        "with sensitivities": seconds(
            lambda: trace(membrane, STIFFNESS, sensitivities=True)(LEVELS), repeats
        ),
        "apex": float(path(0.3)[0, mesh.apex, 2]),
    }


#: Peers' scripts, and the times that issue 3 asks us to be faster.
PEERS = {"fenicsx": ("FEniCSx", 40), "felupe": ("felupe", 90), "calculix": ("CalculiX", None)}


def against_peers(
    mesh: Mesh, names: list[str], rounds: int, dolfinx_python: str
) -> tuple[list[str], list[str]]:
    """Rows of the table of peers, and a line on each that is absent."""
    membrane = Membrane(mesh, 0.81, "svk")
    apex = float(trace(membrane, STIFFNESS)(0.3)[0, mesh.apex, 2])
    absent, ours, found = [], [], {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.npz"
        first = flat_guess(membrane, LEVELS[0], STIFFNESS)[:, 2].max()
        np.savez(
            case, nodes=mesh.nodes, cells=mesh.cells, rim=mesh.rim, levels=LEVELS,
            stiffness=STIFFNESS, constants=CONSTANTS, thickness=0.81, radius=membrane.radius,
            first_height=first,
        )  # fmt: skip
        for turn in range(rounds):
            ours.append(seconds(lambda: trace(membrane, STIFFNESS)(LEVELS), 5))
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
    rows = [f"| bulgefit, all levels to 1e-3 mm | {median(ours):.3f} | {rounds} | | | | |"]
    for name, answers in found.items():
        if answers:
            time_, last = median(a["seconds"] for a in answers), answers[-1]
            wanted = PEERS[name][1]
            rows.append(
                f"| {last['version']} | {time_:.2f} | {len(answers)} | {last['iterations']} "
                f"| {time_ / median(ours):.0f} | {wanted or '-'} "
                f"| {last['apex_mm'] - apex:+.5f} |"
            )
    return rows, absent


def ask(command: list[str]) -> dict[str, float] | str:
    """A peer's answer, or the last line of why it has none."""
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=900)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if run.returncode:
        return (run.stderr.strip().splitlines() or ["no message"])[-1]
    return json.loads(run.stdout.strip().splitlines()[-1])


#: Refinements of our disc, and those that are too much for a banded matrix.
REFINEMENTS, DENSE_ABOVE = (4, 6, 8, 10, 12, 14, 18, 24), 14


def growth() -> tuple[list[str], list[str]]:
    """Rows of free displacements and milliseconds by solver, and a line on each slope.

    Material as above, but svk: on fine meshes hencky loses ellipticity at so soft a shear modulus.
    """
    names = [name for name in SOLVERS if name != "pardiso" or has_pardiso()]
    rows, best = [], {True: [], False: []}
    for refine in REFINEMENTS:
        mesh, row, times = disc(100.0, refine), "", {}
        shape = flat_guess(Membrane(mesh, 0.81, "svk"), 0.01, STIFFNESS)
        chosen = type(Membrane(mesh, 0.81).linear)
        for name in names:
            if name == "banded" and refine > DENSE_ABOVE:
                row += " | - | -"
                continue
            membrane = Membrane(mesh, 0.81, "svk", solver=name)
            state = membrane.state(shape, 0.01, STIFFNESS)
            factor = membrane.factorise(state)
            assembly, factorisation, back = (
                seconds(job, 3)
                for job in (
                    lambda membrane=membrane, shape=shape: membrane.state(shape, 0.01, STIFFNESS),
                    lambda membrane=membrane, state=state: membrane.factorise(state),
                    lambda factor=factor, state=state: factor.solve(state.residual),
                )
            )
            # a level of a path: a Newton step with its tangent, and three corrections
            times[name] = assembly + factorisation + 3 * back
            mark = "**" if type(membrane.linear) is chosen else ""
            row += f" | {1e3 * assembly:.2f} | {mark}{1e3 * factorisation:.2f}{mark}"
        rows.append(f"| {membrane.linear.size}{row} |")
        size = membrane.linear.size
        best[True].append((size, min(times.values())))
        best[False].append((size, min(t for name, t in times.items() if name != "pardiso")))
    head = "| free displacements" + "".join(f" | {n}: assembly | factorisation" for n in names)
    table = [head + " |", "|" + "---|" * (1 + 2 * len(names)), *rows]
    slopes = []
    for with_pardiso, points in best.items():
        if with_pardiso and not has_pardiso():
            continue
        slope = np.polyfit(*np.log(np.array(points)).T, 1)[0]
        label = "the best solver" if with_pardiso else "the best without PARDISO"
        slopes.append(f"Log-log slope of one step with {label}: {slope:.2f}.")
    return table, slopes


def first_run() -> float:
    """Seconds of processor time that a first run compiles, cache empty."""
    with tempfile.TemporaryDirectory() as folder:
        script = (
            "import time; start = time.process_time()\n"
            "import numpy as np\n"
            "from bulgefit.fem.membrane import Membrane\n"
            "from bulgefit.fem.mesh import disc\n"
            "from bulgefit.fem.trace import trace\n"
            "for _ in range(2):\n"
            "    trace(Membrane(disc(), 0.81), np.array([316.8, 239.4, 57.5, 5.0]))\n"
            "    print(time.process_time() - start); start = time.process_time()\n"
        )
        run = subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "NUMBA_CACHE_DIR": folder},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
    first, second = (float(line) for line in run.stdout.split())
    return first - second


def main() -> None:
    """Measure and print; write the page on request."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--peers", default=",".join(PEERS), help="which, with commas; '' for none")
    parser.add_argument("--no-growth", action="store_true")
    parser.add_argument("--dolfinx-python", default="/usr/bin/python3")
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    name, mesh = study_mesh()
    lines = [
        "# Performance of the membrane solver",
        "",
        f"Made by `python benchmarks/forward.py`; Python {platform.python_version()}, one thread, "
        "medians of processor time.",
        "",
        f"## One path, 0.001 to 3 bar, 200 levels ({name} mesh)",
        "",
        "The limit is the path's factorisations alone. The error is the dense output's against the "
        "balanced shape, the largest of all nodes and of all 200 levels.",
        "",
        "| law | s | factorisations | solved levels | error, mm | ms a factorisation "
        "| path / limit | s with derivatives | derivatives / path | apex at 3 bar, mm |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for law in ("hencky", "svk"):
        row = one_path(mesh, law, options.repeats)
        lines.append(
            f"| {law} | {row['seconds']:.3f} | {row['factorisations']} | {row['levels']} "
            f"| {row['error']:.1e} | {1e3 * row['one factorisation']:.2f} | {row['ratio']:.2f} "
            f"| {row['with sensitivities']:.3f} "
            f"| {row['with sensitivities'] / row['seconds']:.2f} | {row['apex']:.5f} |"
        )
    peers = [name for name in options.peers.split(",") if name]
    if peers:
        rows, absent = against_peers(mesh, peers, options.repeats, options.dolfinx_python)
        lines += [
            "", f"## Against others: svk, 200 levels ({name} mesh)", "",
            "Each in turn, round by round; imports and compilation are not counted. FEniCSx and "
            "felupe start every level from the shape of the one before; FEniCSx has its "
            "fastest direct solver here (PETSc's LU), felupe SuperLU with `MMD_AT_PLUS_A`. "
            "CalculiX is timed as a program, once, and starts with an imperfection of 0.1 mm and "
            "automatic increments no longer than the distance of levels.", "",
            "| program | s | rounds | Newton iterations | bulgefit is faster by | wanted "
            "| apex at 3 bar less ours, mm |",
            "|---|---|---|---|---|---|---|", *rows, *([""] if absent else []), *absent,
        ]  # fmt: skip
    if not options.no_growth:
        table, slopes = growth()
        lines += [
            "", "## Growth with the mesh: milliseconds, the automatic choice in bold", "", *table,
            "", *slopes, "",
            "What to choose: nothing up to 4,000 free displacements, which the default mesh is "
            "well within. For finer meshes install `bulgefit[pardiso]` (x86-64); it is then used "
            "by itself. Without it, banded Cholesky serves up to 16,000 and SuperLU beyond; a path "
            "keeps up to five factors, which at 25,000 take 1.2 GB as bands and 0.7 GB in SuperLU.",
        ]  # fmt: skip
    lines += ["", "## First run", "", f"Compiles for {first_run():.1f} s; later runs do not."]
    page = "\n".join(lines) + "\n"
    print(page)
    if options.write:
        options.write.write_text(page)


if __name__ == "__main__":
    main()
