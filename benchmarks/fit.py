"""Time fits: 1.84 million points, growth with points, workers, and methods against each other.

    python benchmarks/fit.py [--only scale,methods,growth,workers,cases] [--data ../shared/data]
                             [--write docs/fit.md]

Each fit runs in a process of its own and starts from a file, through the public functions. With
--write the page gets the sections that are run. The section cases compares two methods on made
tests and, where ../shared/data is there, on the study's.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

import argparse
import itertools
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from sections import marked, put

HERE = Path(__file__).resolve().parents[1]
FRAMES = 49
NOISE = 0.02
#: The made material, MPa, and the bounds of its fits.
TRUTH = {"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}
BOUNDS = {"E1": (100.0, 500.0), "E2": (50.0, 400.0), "G12": (5.0, 100.0)}
#: Reach: forward paths, s on 2 cores, GB; log-log slope in points; efficiency of 2 workers.
REACH = (35, 6.0, 0.6)
REACH_SLOPE, REACH_EFFICIENCY = 1.05, 85
#: Points a frame of the large test, 1.84 million in all.
LARGE = 37_500
#: Methods that are compared on the large test.
METHODS = ("gauss-newton", "L-BFGS-B", "SLSQP", "TNC", "Nelder-Mead")
#: Refits that the workers share, and how often each way is timed.
REFITS, REPEATS = 48, 2


def make(file: Path, points: int, frames: int, truth: dict[str, float], refine: int = 7) -> None:
    """Write a made test of points that cover the disc evenly, on a mesh finer than the fits'."""
    from bulgefit.fem.membrane import Membrane
    from bulgefit.fem.mesh import disc
    from bulgefit.fem.trace import trace
    from bulgefit.model.observation import operators
    from bulgefit.model.parameters import material

    mesh = disc(100.0, refine)
    pressure = np.linspace(0.005, 0.3, frames)
    path = trace(Membrane(mesh), material("orthotropic", **truth).stiffness(), (1e-4, 0.3))
    rng = np.random.default_rng(0)
    radius = 97 * np.sqrt((np.arange(points) + 0.5) / points)
    angle = np.pi * (1 + 5**0.5) * np.arange(points)
    where = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(points)])
    operator, nodal = operators(mesh, where, "shape"), path(pressure)
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
    from bulgefit import Setup, fit, read_test

    test = read_test(job["file"])
    read = time.perf_counter()
    result = fit(
        test,
        job["objective"],
        method=job["method"],
        starts=job["starts"],
        workers=job["workers"],
        bounds=job["bounds"],
        setup=Setup(correct_mesh=job["correct_mesh"]),
    )
    # among themselves: the last descent takes another mesh error off than the starts did
    ends = [d.best.value for d in result.descents]
    return {
        "seconds": time.perf_counter() - began,
        "fit": time.perf_counter() - read,
        "cpu": time.process_time() - spent,
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2,
        "paths": result.evaluations,
        "failed": result.failures,
        "converged": sum(d.converged for d in result.descents),
        "at_best": int(sum(end <= np.nanmin(ends) * 1.001 for end in ends)),
        "value": result.value,
        "values": result.material.values,
        **work(test, result.material),
    }


def work(test: Any, at: Any) -> dict[str, float]:
    """Seconds of one path with derivatives, and of one pass over the data: the least of three."""
    from bulgefit.fitting.objective import Objective
    from bulgefit.parallel.threads import one_blas_thread

    target = Objective([test], "e_w")

    def least(job: Callable[[], Any]) -> float:
        times = []
        for _ in range(3):
            began = time.perf_counter()
            job()
            times.append(time.perf_counter() - began)
        return min(times)

    values = at.constants()
    names = [tuple(values)]
    # a path that was just traced is kept: each time another one, by a hair
    others = (({**values, "E1": values["E1"] * (1.0 + 1e-9 * i)},) for i in itertools.count(1))
    with one_blas_thread():
        shapes = target.shapes([values], names)
        return {
            "path": least(lambda: target.shapes(next(others), names)),
            "pass": least(lambda: target.slope(shapes, names, [np.eye(4)])),
        }


def begin(**job: Any) -> subprocess.Popen[str]:
    """Start `run`, or `share`, in a process of its own."""
    usual = {"task": "run", "objective": "e_w", "method": "gauss-newton", "workers": 1}
    job = {**usual, "bounds": BOUNDS, "correct_mesh": True, **job, "file": str(job["file"])}
    words = [sys.executable, __file__, "--run", json.dumps(job)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


def result(begun: subprocess.Popen[str]) -> dict[str, Any]:
    """What the process found."""
    said, _ = begun.communicate()
    if begun.returncode:
        raise SystemExit(begun.returncode)
    return json.loads(said.splitlines()[-1])


def apart(**job: Any) -> dict[str, Any]:
    """`run` in a process of its own."""
    return result(begin(**job))


def table(heads: Iterable[str], rows: Iterable[Iterable[object]]) -> list[str]:
    """A Markdown table."""
    heads = list(heads)
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    return [*lines, *("| " + " | ".join(str(c) for c in row) + " |" for row in rows), ""]


def large(folder: Path) -> Path:
    """The test of 1.84 million points, made once."""
    file = folder / "large.npz"
    if not file.is_file():
        make(file, LARGE, FRAMES, TRUTH)
    return file


def scale(folder: Path) -> list[str]:
    """The test of 1.84 million points."""
    file = large(folder)
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
        f"## {FRAMES * LARGE / 1e6:.2f} million points ({FRAMES} frames of {LARGE}), 5 starts",
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
    rows, sizes, passes, fits, peaks = [], [], [], [], []
    for total in (1e5, 1e6, 1e7):
        points = round(total / FRAMES)
        file = folder / f"{points}.npz"
        make(file, points, FRAMES, TRUTH)
        found = apart(file=file, starts=1)
        file.unlink()
        sizes.append(FRAMES * points)
        passes.append(found["pass"])
        fits.append(found["seconds"])
        peaks.append(found["peak"])
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
    slopes = [np.polyfit(np.log(sizes), np.log(t), 1)[0] for t in (passes, fits, peaks)]
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
        f"Log-log slopes: a pass {slopes[0]:.2f}, the whole {slopes[1]:.2f}, the peak "
        f"{slopes[2]:.2f} (reach: {REACH_SLOPE}). A fit has costs that do not grow, its paths.",
        "",
    ]


def methods(folder: Path) -> list[str]:
    """Every method from the same starts on the large test."""
    file, starts, rows = large(folder), 3, []
    for method in METHODS:
        found = apart(file=file, starts=starts, method=method, workers=1)
        values = found["values"]
        rows.append(
            (
                method,
                found["paths"],
                f"{found['paths'] / starts:.1f}",
                found["failed"],
                f"{found['converged']}/{starts}",
                f"{found['at_best']}/{starts}",
                f"{found['fit']:.1f}",
                f"{found['value']:.6f}",
                ", ".join(f"{k} {values[k]:.2f}" for k in ("E1", "E2", "G12")),
            )
        )
    return [
        "## Methods on the same test",
        "",
        f"e_w from {starts} starts, the same for all, one worker; at most 100 paths a start. "
        "*At the optimum*: starts that ended within 0.1 % of the method's best value. Nelder-Mead "
        "uses paths without derivatives.",
        "",
        *table(
            ("method", "paths", "a start", "failed", "converged", "at the optimum", "s",
             "e_w, mm", "found, MPa"),
            rows,
        ),
    ]  # fmt: skip


def share(job: dict[str, Any]) -> dict[str, Any]:
    """Refit in this process's workers: seconds to start them, and for the refits."""
    from contextlib import ExitStack

    from bulgefit import bootstrap, fit, read_test
    from bulgefit.parallel.workers import open_executor

    test = read_test(job["file"])
    found = fit(test, bounds=job["bounds"], starts=1)
    with ExitStack() as stack:
        began = time.perf_counter()
        options = {"workers": job["workers"], "processes": job["kind"] == "processes"}
        if job["kind"] == "Dask":
            from distributed import LocalCluster

            cluster = LocalCluster(
                n_workers=job["workers"], threads_per_worker=1, dashboard_address=":0"
            )
            options = {"scheduler": stack.enter_context(cluster).scheduler_address}
        executor = stack.enter_context(open_executor(**options))
        bootstrap(found, test, replicates=2 * job["workers"], seed=1, executor=executor)
        ready = time.perf_counter()
        refits = bootstrap(found, test, replicates=job["refits"], executor=executor)
        done = time.perf_counter()
    return {"start": ready - began, "seconds": done - ready, "values": refits.values.tolist()}


def workers(folder: Path) -> list[str]:
    """Refits shared by two workers, against one worker and against two runs side by side."""
    file, kinds = large(folder), ("threads", "processes", "Dask")
    seconds: dict[tuple[str, str], list[float]] = {}
    starts: dict[str, list[float]] = {kind: [] for kind in kinds}
    values = []
    for _ in range(REPEATS):
        for kind in kinds:
            job = {"file": file, "kind": kind, "refits": REFITS, "task": "share"}
            for way, count, runs in (("one", 1, 1), ("two", 2, 1), ("apart", 1, 2)):
                begun = [
                    begin(**job | {"workers": count, "refits": REFITS // runs}) for _ in range(runs)
                ]
                told = [result(one) for one in begun]
                seconds.setdefault((kind, way), []).append(max(t["seconds"] for t in told))
                if runs == 1:
                    values.append(told[0]["values"])
                if way == "two":
                    starts[kind].append(told[0]["start"])
    rows = []
    for kind in kinds:
        one, two, beside = (np.array(seconds[kind, way]) for way in ("one", "two", "apart"))
        rows.append(
            (
                kind,
                f"{np.median(starts[kind]):.1f}",
                *(f"{np.median(t):.1f}" for t in (one, two, beside)),
                f"{100 * np.median(one / two) / 2:.0f} %",
                f"{100 * np.median(beside / two):.0f} %",
            )
        )
    same = all(v == values[0] for v in values)
    return [
        "## Two workers",
        "",
        f"{REFITS} bootstrap refits of the same test; medians of {REPEATS} interleaved repeats, "
        "workers started and kernels loaded (*start, s*), data sent within the time. *Efficiency*: "
        "one worker's time over twice that of two. *Of two runs*: the time of two separate runs "
        "side by side, half the refits each, over that of two workers: what they lose by working "
        "together, whatever else the machine does meanwhile. "
        f"Reach: {REACH_EFFICIENCY} %.",
        "",
        *table(
            ("workers", "start, s", "one, s", "two, s", "two runs, s", "efficiency",
             "of two runs"),
            rows,
        ),
        f"All refits of all ways are {'the same to the last bit' if same else 'NOT THE SAME'}.",
        "",
    ]  # fmt: skip


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


def compared(folder: Path, data: Path) -> list[str]:
    """Gauss-Newton against L-BFGS-B from the same starts."""
    rows, totals = [], {"gauss-newton": 0, "L-BFGS-B": 0}
    better = dict.fromkeys(totals, 0)
    starts = 3
    for name, file, objective, bounds in cases(folder, data):
        cells, values = [], {}
        for method in totals:
            found = apart(
                file=file, starts=starts, objective=objective, method=method, bounds=bounds,
                correct_mesh=False,
            )  # fmt: skip
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
        "within 0.1 % of the best value of their method. The mesh's error is left in: taken off at "
        "each one's own end, in shapes that are not stable, it would be another one, and so the "
        "objective.",
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


def main() -> None:
    """Run what was asked for and write the sections."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", default="scale,methods,growth,workers,cases")
    parser.add_argument("--data", type=Path, default=HERE.parent / "shared/data")
    parser.add_argument("--write", type=Path, help="page that gets the sections")
    parser.add_argument("--run", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        job = json.loads(args.run)
        print(json.dumps({"run": run, "share": share}[job["task"]](job)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        known: dict[str, Callable[[], list[str]]] = {
            "scale": lambda: scale(folder),
            "methods": lambda: methods(folder),
            "growth": lambda: growth(folder),
            "workers": lambda: workers(folder),
            "cases": lambda: compared(folder, args.data),
        }
        for key in args.only.split(","):
            before = os.getloadavg()[0]
            text = "\n".join(known[key]()).strip() + (
                f"\n\nOther work on the machine: load {before:.1f} on {os.cpu_count()} cores when "
                "this began."
            )
            made = marked(key, text)
            print(made, flush=True)
            # after each, so that a benchmark that is interrupted leaves what it found
            if args.write is not None:
                put(made, args.write)


if __name__ == "__main__":
    main()
