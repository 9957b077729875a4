"""Growth of a path's cost with the mesh, by solver."""

from __future__ import annotations

from forward_timing import (  # pins the threads
    LEVELS,
    STIFFNESS,
    THICKNESS,
    in_turn,
    mirrored,
    seconds,
)

import numpy as np  # isort: skip

from bulgefit.fem.linear import SOLVERS, has_pardiso
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh, disc
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.fem.trace import trace

#: Refinements of our disc, and those that are too much for a banded matrix.
REFINEMENTS, DENSE_ABOVE = (4, 6, 8, 10, 12, 14, 18, 24), 14

ADVICE = """\
What to choose: nothing for meshes such as the default one. For fine meshes install
`bulgefit[pardiso]` (x86-64); from 4,000 free displacements it is then used by itself. Without it,
banded Cholesky serves up to 30,000 and SuperLU beyond; a path keeps up to five factors, so bands
of 30,000 displacements take about 0.7 GB. A geometric nested dissection was tried as SuperLU's
order: its factors have a quarter to a third more entries than those of minimum degree, and take
as long or longer."""


def growth() -> list[str]:
    """The section's lines.

    Material as in the other sections, but svk: on fine meshes hencky loses ellipticity at so soft
    a shear modulus.
    """
    names = [name for name in SOLVERS if name != "pardiso" or has_pardiso()]
    rows, quarters = [], []
    paths: dict[str, list[tuple[int, float]]] = {name: [] for name in names}
    by_quarter: dict[str, list[tuple[int, float]]] = {name: [] for name in names}
    for refine in REFINEMENTS:
        mesh = disc(100.0, refine)
        chosen = type(Membrane(mesh, THICKNESS).linear)
        cells, times = "", ""
        for name in names:
            size, free, seconds_ = _quarter(mesh, name)
            by_quarter[name].append((size, seconds_))
            times += f" | {seconds_:.4f}"
            if name == "banded" and refine > DENSE_ABOVE:
                cells += " | - | - | -"
                continue
            membrane = Membrane(mesh, THICKNESS, "svk", solver=name)
            size, found = membrane.linear.size, _measure(membrane)
            paths[name].append((size, found["path"]))
            mark = "**" if type(membrane.linear) is chosen else ""
            cells += f" | {1e3 * found['factorisation']:.2f} | {1e3 * found['substitution']:.2f}"
            cells += f" | {mark}{found['path']:.3f}{mark}"
            assembly = found["assembly"]
        rows.append(f"| {size} | {1e3 * assembly:.2f}{cells} |")
        quarters.append(f"| {size} | {free}{times} |")
    head = "".join(f" | {n}: ms a factorisation | ms a substitution | s a path" for n in names)
    return [
        "## Growth with the mesh",
        "",
        "A path is 0.001 to 3 bar (svk), traced whole; the automatic choice is in bold. Assembly "
        "is that of a tangent.",
        "",
        "| free displacements | ms an assembly" + head + " |",
        "|" + "---|" * (2 + 3 * len(names)),
        *rows,
        "",
        *_slopes(paths),
        "",
        "By quarter, in s a path; the whole is not factorised, and the solver that is named serves "
        "the quarter:",
        "",
        "| free displacements | of the quarter | " + " | ".join(names) + " |",
        "|" + "---|" * (2 + len(names)),
        *quarters,
        "",
        *_slopes(by_quarter),
        "",
        *ADVICE.splitlines(),
    ]


def _quarter(mesh: Mesh, solver: str) -> tuple[int, int, float]:
    """Free displacements of the whole and of its quarter, and seconds of a path by quarter."""
    membrane = Membrane(mesh, THICKNESS, "svk", solver=solver)
    quarter = mirrored(membrane)
    span = LEVELS[0], LEVELS[-1]
    path = trace_by_quarter(membrane, STIFFNESS, span)
    own = trace(quarter.even, STIFFNESS, span)
    if path.factorisations != own.factorisations + len(quarter.odd) * len(path.pressure):
        raise ArithmeticError("the fabric is not stable, and was traced whole")
    times = seconds(
        lambda: trace_by_quarter(membrane, STIFFNESS, span),
        5 if membrane.linear.size < 12_000 else 1,
        warm=True,
    )
    return membrane.linear.size, quarter.even.linear.size, times


def _measure(membrane: Membrane) -> dict[str, float]:
    """Seconds of the parts and of a whole path."""
    small = membrane.linear.size < 12_000
    path = trace(membrane, STIFFNESS)
    shape, pressure = path(0.1)[0], 0.1
    state = membrane.state(shape, pressure, STIFFNESS)
    factor = membrane.factorise(state)
    found = in_turn(
        {
            "assembly": lambda: membrane.state(shape, pressure, STIFFNESS),
            "factorisation": lambda: membrane.factorise(state),
            "substitution": lambda: factor.solve(state.residual),
        },
        9 if small else 3,
    )
    found["path"] = seconds(
        lambda: trace(membrane, STIFFNESS, (LEVELS[0], LEVELS[-1])), 5 if small else 1, warm=True
    )
    return found


def _slopes(paths: dict[str, list[tuple[int, float]]]) -> list[str]:
    """Log-log slopes of a path's time in the free displacements."""
    lines = []
    for label, allowed in (
        ("the fastest solver of each size", set(paths)),
        ("the fastest without PARDISO", set(paths) - {"pardiso"}),
        *((name, {name}) for name in paths),
    ):
        best: dict[int, float] = {}
        for name in allowed:
            for size, time in paths[name]:
                best[size] = min(time, best.get(size, np.inf))
        points = np.array(sorted(best.items()))
        slope = np.polyfit(np.log(points[:, 0]), np.log(points[:, 1]), 1)[0]
        lines.append(
            f"- {label}: {slope:.2f} ({points[0, 0]:.0f} to {points[-1, 0]:.0f} displacements)"
        )
    return ["Log-log slopes of a path's time in the free displacements (wanted: 1.6):", "", *lines]
