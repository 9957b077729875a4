"""Time fits: 1.84 million points, growth with points, and the methods against each other.

    python benchmarks/fit.py [--only scale,growth,methods] [--data ../shared/data]
                             [--write docs/fit.md]

Each fit runs in a process of its own and starts from a file, through the public functions. The
methods are compared on made tests and, where ../shared/data is there, on the study's.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1]
FRAMES = 49
NOISE = 0.02
#: The made material, MPa, and the bounds of its fits.
TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
BOUNDS = {"E1": (100.0, 500.0), "E2": (50.0, 400.0), "G12": (5.0, 100.0)}
#: Reach of issue 3: forward paths, s on 2 cores, GB.
REACH = (35, 12.0, 1.2)


def make(file: Path, points: int, frames: int, truth: dict[str, float], refine: int = 7) -> None:
    """Write a made test of points that cover the disc evenly, on a mesh finer than the fits'."""
    from bulgefit.fem.membrane import Membrane
    from bulgefit.fem.mesh import disc
    from bulgefit.fem.trace import trace
    from bulgefit.model.observation import observe
    from bulgefit.model.parameters import material

    mesh = disc(100.0, refine)
    pressure = np.linspace(0.005, 0.3, frames)
    path = trace(Membrane(mesh), material("orthotropic", **truth).stiffness(), (1e-4, 0.3))
    rng = np.random.default_rng(0)
    radius = 97 * np.sqrt((np.arange(points) + 0.5) / points)
    angle = np.pi * (1 + 5**0.5) * np.arange(points)
    where = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(points)])
    operator, nodal = observe(mesh, where), path(pressure)
    seen = np.empty((frames, points, 3), dtype=np.float32)
    for i in range(frames):
        seen[i] = operator(nodal[i : i + 1])[0]
        seen[i] += NOISE * rng.standard_normal((points, 3), dtype=np.float32)
    np.savez(
        file,
        reference=where,
        displacement=seen,
        pressure=pressure,
        radius=100.0,
        thickness=0.81,
        poisson_ratio=truth["nu12"],
    )


def run(job: dict[str, Any]) -> dict[str, Any]:
    """Read and fit in this process; what it took."""
    began, spent = time.perf_counter(), time.process_time()
    from bulgefit import fit, read_test

    test = read_test(job["file"])
    read = time.perf_counter()
    result = fit(
        test,
        job["objective"],
        method=job["method"],
        starts=job["starts"],
        workers=job["workers"],
        bounds=job["bounds"],
    )
    return {
        "seconds": time.perf_counter() - began,
        "fit": time.perf_counter() - read,
        "cpu": time.process_time() - spent,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2,
        "paths": result.evaluations,
        "failed": result.failures,
        "converged": sum(d.converged for d in result.descents),
        "at_best": sum(d.best.value <= result.value * 1.001 for d in result.descents),
        "value": result.value,
        "values": result.material.values,
        **work(test, result.material),
    }


def work(test: Any, at: Any) -> dict[str, float]:
    """Seconds of one path with derivatives, and of one pass over the data: the least of three."""
    from bulgefit.inverse.objective import Objective
    from bulgefit.threads import one_blas_thread

    target = Objective([test], "e_w")

    def least(job: Callable[[], Any]) -> float:
        times = []
        for _ in range(3):
            began = time.perf_counter()
            job()
            times.append(time.perf_counter() - began)
        return min(times)

    with one_blas_thread():
        fields = target.virtual.fields(at, derivatives=True)
        return {
            "path": least(lambda: target.virtual.fields(at, derivatives=True)),
            "pass": least(lambda: target.slope(fields)),
        }


def apart(**job: Any) -> dict[str, Any]:
    """`run` in a process of its own."""
    job = {"objective": "e_w", "method": "gauss-newton", "workers": 1, "bounds": BOUNDS, **job}
    told = subprocess.run(
        [sys.executable, __file__, "--run", json.dumps(job | {"file": str(job["file"])})],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return json.loads(told.stdout.splitlines()[-1])


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> list[str]:
    """A Markdown table."""
    heads = list(heads)
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return [*lines, *("| " + " | ".join(str(c) for c in row) + " |" for row in rows), ""]


def scale(folder: Path) -> list[str]:
    """The test of 1.84 million points."""
    points = 37_500
    file = folder / "large.npz"
    make(file, points, FRAMES, TRUTH)
    apart(file=file, starts=1)  # compiles what is not compiled yet
    rows = []
    for workers in (1, 2):
        found = apart(file=file, starts=5, workers=workers)
        values = found["values"]
        rows.append(
            (
                workers,
                found["paths"],
                f"{found['converged']}/5",
                f"{found['at_best']}/5",
                f"{found['seconds']:.1f}",
                f"{found['cpu']:.1f}",
                f"{found['fit'] / (found['paths'] * found['path']):.2f}",
                f"{1e3 * found['path']:.0f}",
                f"{1e3 * found['pass']:.0f}",
                f"{found['peak']:.2f}",
                f"{found['value']:.6f}",
                ", ".join(f"{k} {values[k]:.2f}" for k in ("E1", "E2", "G12")),
            )
        )
    return [
        f"## {FRAMES * points / 1e6:.2f} million points ({FRAMES} frames of {points}), 5 starts",
        "",
        "Read from a file (float32) and fitted, e_w. *Ratio*: wall time of the fit over that of "
        "its forward paths with derivatives, one after the other. Reach: at most "
        f"{REACH[0]} paths, {REACH[1]:g} s on 2 cores, {REACH[2]} GB.",
        "",
        *table(
            ("workers", "paths", "converged", "at the optimum", "s, with reading", "CPU s", "ratio",
             "ms a path", "ms a pass over the data", "peak, GB", "e_w, mm", "found, MPa"),
            rows,
        ),
        f"Made with {', '.join(f'{k} {v:g}' for k, v in TRUTH.items())}, noise {NOISE} mm, on a "
        "mesh three times finer; that mesh is what separates the found values from these.",
        "",
    ]  # fmt: skip


def growth(folder: Path) -> list[str]:
    """1e5, 1e6 and 1e7 points."""
    rows, sizes, passes, fits = [], [], [], []
    for total in (1e5, 1e6, 1e7):
        points = round(total / FRAMES)
        file = folder / f"{points}.npz"
        make(file, points, FRAMES, TRUTH)
        found = apart(file=file, starts=1)
        file.unlink()
        sizes.append(FRAMES * points)
        passes.append(found["pass"])
        fits.append(found["seconds"])
        rows.append(
            (
                f"{FRAMES * points:,}",
                f"{1e3 * found['pass']:.1f}",
                f"{1e9 * found['pass'] / sizes[-1]:.1f}",
                f"{found['seconds']:.1f}",
                found["paths"],
                f"{found['peak']:.2f}",
            )
        )
    slopes = [np.polyfit(np.log(sizes), np.log(t), 1)[0] for t in (passes, fits)]
    return [
        "## Growth with points",
        "",
        *table(
            (
                "points",
                "ms a pass",
                "ns a point",
                "s, one start with reading",
                "paths",
                "peak, GB",
            ),
            rows,
        ),
        f"Log-log slopes: a pass {slopes[0]:.2f}, the whole {slopes[1]:.2f} (reach: 1.05).",
        "",
    ]


def cases(folder: Path, data: Path) -> list[tuple[str, Path, str, dict[str, Any]]]:
    """Name, file, objective and bounds of what the methods are compared on."""
    study = {"E1": (100, 400), "E2": (50, 300), "G12": (2, 10)}
    found = []
    for name, truth, bounds in (
        ("made, stiff shear", TRUTH, BOUNDS),
        ("made, soft shear", TRUTH | {"E1": 303, "E2": 229, "G12": 8}, study),
    ):
        file = folder / f"{name.replace(' ', '_')}.npz"
        make(file, 540, 20, truth, refine=5)
        found += [(name, file, objective, bounds) for objective in ("e", "e_w", "e_z")]
    for n in (1, 2, 4):
        for objective in ("e", "e_w", "e_z"):
            kind = "apex" if objective == "e_z" else "binned"
            file = data / f"dic/valmex_test{n}_{kind}.npz"
            if file.is_file():
                found.append((f"measured, test {n}", file, objective, study))
    return found


def methods(folder: Path, data: Path) -> list[str]:
    """Gauss-Newton against L-BFGS-B from the same starts."""
    rows, totals = [], {"gauss-newton": 0, "L-BFGS-B": 0}
    better = dict.fromkeys(totals, 0)
    starts = 3
    for name, file, objective, bounds in cases(folder, data):
        cells, values = [], {}
        for method in totals:
            found = apart(
                file=file, starts=starts, objective=objective, method=method, bounds=bounds
            )
            totals[method] += found["paths"]
            values[method] = found["value"]
            cells += [
                found["paths"],
                found["failed"],
                f"{found['converged']}, {found['at_best']}",
                f"{found['value']:.5f}",
            ]
        for method, other in (tuple(totals), tuple(totals)[::-1]):
            better[method] += values[method] < values[other] * (1 - 1e-5)
        rows.append((name, objective, *cells))
    return [
        "## Gauss-Newton against L-BFGS-B",
        "",
        f"{starts} starts, the same for both; *conv., best*: starts that converged, and that ended "
        "within 0.1 % of the best value of their method.",
        "",
        *table(
            ("test", "objective", "GN paths", "failed", "conv., best", "value, mm",
             "L-BFGS-B paths", "failed", "conv., best", "value, mm"),
            rows,
        ),
        f"Paths in all: Gauss-Newton {totals['gauss-newton']}, L-BFGS-B {totals['L-BFGS-B']}. The "
        f"better value (by more than 1e-5 of it): Gauss-Newton {better['gauss-newton']} times, "
        f"L-BFGS-B {better['L-BFGS-B']} times, of {len(rows)}.",
        "",
    ]  # fmt: skip


INTRODUCTION = """# How a fit searches, and what it costs

Made by `python benchmarks/fit.py`; {machine}, Python {python}. Do not edit: every figure is
measured.

A fit starts from scrambled-Sobol points of the bounds and descends from each by the same method:

- `gauss-newton` (default): the residuals are made linear in the coordinates (log moduli), and the
  sum of their absolute values is minimised within a trust region and the bounds, by reweighted
  least squares. Value and slope of the objective are those of all points, in one pass over them
  that allocates nothing of their size. Above 100,000 measured values the curvature alone comes
  from a fixed sample of the points: near the optimum the step still ends where the slope of all
  data vanishes, so the optimum is that of all data.
- `L-BFGS-B`, or any other scipy minimiser, with the exact gradient where it takes one.

A solve that fails is told to the minimiser as the worst value so far, and counted.
"""


def main() -> None:
    """Run what was asked for and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", default="scale,growth,methods")
    parser.add_argument("--data", type=Path, default=HERE.parent / "shared/data")
    parser.add_argument("--write", type=Path, help="write the page here (default: print it)")
    parser.add_argument("--run", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        print(json.dumps(run(json.loads(args.run))))
        return
    page = INTRODUCTION.format(machine=platform.machine(), python=platform.python_version())
    lines = [*page.splitlines(), ""]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sections: dict[str, Callable[[], list[str]]] = {
            "scale": lambda: scale(folder),
            "growth": lambda: growth(folder),
            "methods": lambda: methods(folder, args.data),
        }
        for key in args.only.split(","):
            section = sections[key]()
            print(*section, sep="\n", file=sys.stderr, flush=True)
            lines += section
    text = "\n".join(lines).rstrip() + "\n"
    if args.write is None:
        print(text)
    else:
        args.write.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
