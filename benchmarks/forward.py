"""Time one forward path and its growth with the mesh.

    python benchmarks/forward.py [--repeats 5] [--write docs/performance.md]

One thread, medians. Peers are not compared yet.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import platform
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import flat_guess
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh, disc
from bulgefit.fem.trace import trace

STUDY_MESH = Path(__file__).resolve().parents[2] / "shared/data/abaqus/mesh.npz"
STIFFNESS = orthotropic_stiffness(303.0, 229.0, 5.0, 0.24)
LEVELS = np.linspace(0.001, 3.0, 200) / 10  # MPa


def seconds(job: Callable[[], object], repeats: int) -> float:
    """Median wall time of a job, compiled and warm."""
    job()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        job()
        times.append(time.perf_counter() - start)
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
    state = membrane.state(path(0.1)[0], 0.1, STIFFNESS)
    total = seconds(lambda: trace(membrane, STIFFNESS)(LEVELS), repeats)
    factor = seconds(lambda: membrane.factorise(state), 5 * repeats)
    return {
        "seconds": total,
        "factorisations": path.factorisations,
        "one factorisation": factor,
        "ratio": total / (path.factorisations * factor),
        "with sensitivities": seconds(
            lambda: trace(membrane, STIFFNESS, sensitivities=True), repeats
        ),
        "apex": float(path(0.3)[0, mesh.apex, 2]),
    }


def growth() -> list[tuple[int, str, float]]:
    """Free displacements, solver, and seconds for an assembly and a factorisation."""
    rows = []
    for refine in (4, 8, 14, 24):
        membrane = Membrane(disc(100.0, refine), 0.81)
        shape = flat_guess(membrane, 0.01, STIFFNESS)

        def iteration(membrane: Membrane = membrane, shape: np.ndarray = shape) -> object:
            return membrane.factorise(membrane.state(shape, 0.01, STIFFNESS))

        name = type(membrane.linear).__name__
        rows.append((membrane.linear.size, name, seconds(iteration, 2)))
    return rows


def main() -> None:
    """Measure and print; write the page on request."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--write", type=Path)
    options = parser.parse_args()
    name, mesh = study_mesh()
    lines = [
        "# Performance",
        "",
        f"Made by `python benchmarks/forward.py`; Python {platform.python_version()}, one thread.",
        "",
        f"## One path, 0.001 to 3 bar, 200 levels ({name} mesh)",
        "",
        "| law | s | factorisations | ms each | total / factorisations | s with sensitivities "
        "| apex at 3 bar, mm |",
        "|---|---|---|---|---|---|---|",
    ]
    for law in ("hencky", "svk"):
        row = one_path(mesh, law, options.repeats)
        lines.append(
            f"| {law} | {row['seconds']:.3f} | {row['factorisations']} "
            f"| {1e3 * row['one factorisation']:.2f} | {row['ratio']:.2f} "
            f"| {row['with sensitivities']:.3f} | {row['apex']:.5f} |"
        )
    rows = growth()
    sizes, times = np.array([r[0] for r in rows]), np.array([r[2] for r in rows])
    slope = np.polyfit(np.log(sizes), np.log(times), 1)[0]
    lines += ["", "## Growth: one assembly and factorisation", ""]
    lines += ["| free displacements | solver | s |", "|---|---|---|"]
    lines += [f"| {size} | {solver} | {t:.4f} |" for size, solver, t in rows]
    lines += ["", f"Log-log slope {slope:.2f}.", "", "Peers are not measured yet."]
    page = "\n".join(lines) + "\n"
    print(page)
    if options.write:
        options.write.write_text(page)


if __name__ == "__main__":
    main()
