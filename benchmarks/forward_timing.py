"""What the forward benchmarks share: one thread, medians, the case. Import before numpy."""

from __future__ import annotations

import os

os.environ.update(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

import numpy as np

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh, disc
from bulgefit.fem.path import Path as ShapePath
from bulgefit.fem.quarter import Quarter, quarter_of
from bulgefit.fem.trace import trace

HERE = Path(__file__).resolve().parent
STUDY_MESH = HERE.parents[1] / "shared/data/abaqus/mesh.npz"
CONSTANTS = (303.0, 229.0, 5.0, 0.24)  # E1, E2, G12 MPa, nu12
STIFFNESS = orthotropic_stiffness(*CONSTANTS)
LEVELS = np.linspace(0.001, 3.0, 200) / 10  # MPa
THICKNESS = 0.81  # mm


def seconds(job: Callable[[], object], repeats: int, *, warm: bool = False) -> float:
    """Median processor time of a job, after a first call that is not counted unless `warm`."""
    if not warm:
        job()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        job()
        times.append(time.process_time() - start)
    return median(times)


def in_turn(
    jobs: Mapping[str, Callable[[], object]], repeats: int, *, batch: int = 1
) -> dict[str, float]:
    """Median processor time of each job; they take turns, so that they meet the same machine.

    A turn runs a short job once uncounted, to find its data in the fast memory, then `batch` times.
    """
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for turn in range(repeats + 1):
        for name, job in jobs.items():
            if batch > 1:
                job()
            start = time.process_time()
            for _ in range(batch):
                job()
            if turn:
                times[name].append((time.process_time() - start) / batch)
    return {name: median(found) for name, found in times.items()}


def at_levels(membrane: Membrane, traced: Callable[..., ShapePath] = trace) -> np.ndarray:
    """Shapes (mm) at the levels, from a path that is traced for them."""
    return traced(membrane, STIFFNESS)(LEVELS)


def mirrored(membrane: Membrane) -> Quarter:
    """The quarter of a membrane that is alike in both mirrors."""
    quarter = quarter_of(membrane)
    if quarter is None:
        raise ArithmeticError("the membrane is not alike in both mirrors")
    return quarter


def study_mesh() -> tuple[str, Mesh]:
    """The study's mesh, or our own where it is absent."""
    if not STUDY_MESH.is_file():
        return "own", disc()
    with np.load(STUDY_MESH) as data:
        return "study", Mesh.from_arrays(data["nodes"], data["cells"])
