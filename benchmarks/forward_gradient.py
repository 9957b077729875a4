"""Cost of an objective's gradient in forward paths, by the number of parameters.

Three parameters are the moduli, whose derivatives come from four columns of the plane-stress
stiffness. For more, the thickness of as many sectors of the disc.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from unittest.mock import patch

from forward_timing import LEVELS, STIFFNESS, THICKNESS, at_levels, in_turn  # pins the threads

import numpy as np  # isort: skip

from bulgefit.fem.equilibrium import Equilibrium
from bulgefit.fem.kernels import assemble
from bulgefit.fem.laws import LAWS
from bulgefit.fem.membrane import NO_FIELDS, NO_RATES, NO_TANGENT, ONCE, Membrane
from bulgefit.fem.mesh import Mesh
from bulgefit.fem.path import Path
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.fem.sensitivity import parameter_sensitivity
from bulgefit.fem.trace import trace


def sector_forces(membrane: Membrane, count: int, shape: np.ndarray) -> np.ndarray:
    """∂R/∂(relative thickness) of `count` sectors, (count, N)."""
    centre = membrane.mesh.nodes[membrane.mesh.cells].mean(axis=1)
    turn = np.arctan2(centre[:, 1], centre[:, 0]) / (2.0 * np.pi) + 0.5
    sector = np.minimum((turn * count).astype(int), count - 1)
    out = np.empty((count, *membrane.reference.shape))
    for k in range(count):
        mine = sector == k
        assemble(
            membrane.reference + shape, membrane.mesh.cells[mine],
            membrane.surface.gradient[mine], membrane.weight[mine],
            membrane.law_parameters(STIFFNESS), LAWS[membrane.law], membrane.relaxation, 0.0,
            membrane.share[mine], membrane.linear.scatter[mine], ONCE, out[k],
            NO_TANGENT, NO_FIELDS, NO_RATES, NO_FIELDS,
        )  # fmt: skip
    return membrane.gather(out)


def gradient(path: Path, misfit: np.ndarray) -> np.ndarray:
    """Derivative of ½ Σ misfit² over 200 levels and all nodes by every parameter."""
    assert path.sensitivity is not None
    assert path.sensitivity_slope is not None
    weight = np.concatenate(path.weights(LEVELS), axis=2)
    # the weights of dx and dy are the same: they have one parity
    on_levels = weight[0].T @ misfit.reshape(len(misfit), -1)
    on_levels = on_levels.reshape(len(on_levels), *misfit.shape[1:])
    on_levels[:, :, 2] = weight[2].T @ misfit[:, :, 2]
    count = len(path.pressure)
    return np.einsum("lkni,lni->k", path.sensitivity, on_levels[:count]) + np.einsum(
        "lkni,lni->k", path.sensitivity_slope, on_levels[count:]
    )


def with_columns(membrane: Membrane, count: int) -> np.ndarray:
    """Objective's gradient by the thickness of `count` sectors."""

    def columns(
        membrane: Membrane, balance: Equilibrium, slope: np.ndarray, stiffness: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        return parameter_sensitivity(
            membrane, balance, slope, stiffness,
            lambda shape, _: sector_forces(membrane, count, shape),
        )  # fmt: skip

    with patch("bulgefit.fem.tracing.levels.stiffness_sensitivity", columns):
        path = trace(membrane, STIFFNESS, sensitivities=True)
    return gradient(path, path(LEVELS))


def with_moduli(membrane: Membrane, traced: Callable[..., Path] = trace) -> np.ndarray:
    """Objective's gradient by the stiffness, from which that by the moduli follows."""
    path = traced(membrane, STIFFNESS, sensitivities=True)
    return gradient(path, path(LEVELS))


def gradients(mesh: Mesh, repeats: int) -> list[str]:
    """The section's lines."""
    rows = []
    for law in ("hencky", "svk"):
        membrane = Membrane(mesh, THICKNESS, law)
        found = in_turn(
            {
                "quarter": partial(at_levels, membrane, trace_by_quarter),
                "quarter 3": partial(with_moduli, membrane, trace_by_quarter),
                "path": partial(at_levels, membrane),
                "3": partial(with_moduli, membrane),
                "12": partial(with_columns, membrane, 12),
                "30": partial(with_columns, membrane, 30),
            },
            repeats,
        )
        path, three = found.pop("quarter"), found.pop("quarter 3")
        rows.append(f"| {law} | quarter | {path:.4f} | {three:.4f} | {three / path:.2f} | | | | |")
        path = found.pop("path")
        times = " | ".join(f"{t:.4f} | {t / path:.2f}" for t in found.values())
        rows.append(f"| {law} | whole | {path:.4f} | {times} |")
    return [
        "## A gradient of the objective, in forward paths",
        "",
        "The path with its derivatives, the misfit at 200 levels and all nodes, and its gradient, "
        "over the path with its 200 levels. Wanted: 1.5 for 3 parameters, 2.5 for 12. A sector's "
        "thickness is not alike in both mirrors, so the whole membrane is traced for it.",
        "",
        "| law | traced | s a path | s for 3 | paths | s for 12 | paths | s for 30 | paths |",
        "|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]
