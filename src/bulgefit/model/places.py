"""The five places of the virtual test: every effect is parameters with a null.

Names are `effect.parameter`. Where a null is not zero it is a test's own (nu12). The definitions
and signs stand with the terms: shape and clamp in `reference_surface`, material in `fabric_of`,
load in `applied_pressure` and `balanced_pressure`, camera in `bulgefit.model.camera`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.clamp import LEAST_COMPLIANCE
from bulgefit.fem.geometry import SHAPE
from bulgefit.fem.membrane import Fabric
from bulgefit.fem.mesh import Mesh

__all__ = [
    "CONSTANTS",
    "FOLD_ORDERS",
    "KNEE",
    "LAW",
    "LOAD",
    "MECHANICS",
    "applied_derivative",
    "applied_pressure",
    "balanced_derivative",
    "balanced_pressure",
    "fabric_of",
    "law_of",
    "reference_surface",
]

Floats = NDArray[np.float64]

#: Knee strain of a fabric whose slope does not change there: any value is a null.
KNEE = 0.01

#: Azimuthal orders of the further modes of `initial_shape` (cosine and sine each).
FOLD_ORDERS = (3, 4, 5, 6)

SHAPE_NAMES = (
    "initial_shape.h0",
    "initial_shape.hx",
    "initial_shape.hy",
    "initial_shape.c2",
    "initial_shape.s2",
    "initial_shape.h2",
    *(f"initial_shape.{kind}{order}" for order in FOLD_ORDERS for kind in "cs"),
)

#: What the stiffness matrix is made of.
CONSTANTS = ("E1", "E2", "G12", "poisson_ratio.nu12")

#: Parameters of the law: how they change a shape's forces follows from its strains alone.
LAW = (
    *CONSTANTS,
    "prestrain.slack_x",
    "prestrain.slack_y",
    "nonlinear_material.k_x",
    "nonlinear_material.k_y",
    "nonlinear_material.s_x",
    "nonlinear_material.s_y",
    "nonlinear_material.knee_x",
    "nonlinear_material.knee_y",
)

#: Parameters that change the balanced shapes at a given true pressure.
MECHANICS = (
    *LAW,
    *SHAPE_NAMES,
    "clamp_shape.ellipticity",
    "clamp_shape.radius_error",
    "clamp_slip.compliance",
    "axis_misalignment.angle",
    "stiffness_gradient.g_x",
    "stiffness_gradient.g_y",
)

#: Parameters that change the true pressure of a frame.
LOAD = ("pressure_offset.offset", "pressure_gain.gain", "creep.rate")


def semi_axes(values: Mapping[str, float]) -> Floats:
    """Rim semi-axes over the nominal radius along x and y: (1 + δ)(1 ± ellipticity)."""
    grown = 1.0 + values.get("clamp_shape.radius_error", 0.0)
    oval = values.get("clamp_shape.ellipticity", 0.0)
    return np.array([grown * (1.0 + oval), grown * (1.0 - oval)])


def initial_height(unit: Floats, values: Mapping[str, float]) -> Floats:
    """Stress-free height z0 (mm) at points (n, 2) of the unit disc.

    z0 = (1 - r²)(h0 + hx x + hy y + c2 (x² - y²) + s2 2xy + h2 r² + Σ_m r^m (c_m cos mφ +
    s_m sin mφ)), zero on the rim.
    """

    def of(name: str) -> float:
        return values.get(f"initial_shape.{name}", 0.0)

    x, y = unit.T
    square = x * x + y * y
    inside = of("h0") + of("hx") * x + of("hy") * y
    inside = inside + of("c2") * (x * x - y * y) + of("s2") * 2 * x * y + of("h2") * square
    turning = x + 1j * y
    for order in FOLD_ORDERS:
        power = turning**order
        inside = inside + of(f"c{order}") * power.real + of(f"s{order}") * power.imag
    return (1.0 - square) * inside


def reference_surface(mesh: Mesh, radius: float, values: Mapping[str, float]) -> Floats:
    """Stress-free positions (n, 3) mm of the nodes: oval rim and initial height."""
    unit = mesh.nodes / radius
    return np.column_stack([mesh.nodes * semi_axes(values), initial_height(unit, values)])


def fabric_of(mesh: Mesh, radius: float, values: Mapping[str, float]) -> Fabric:
    """The specimen that the parameters describe."""
    slope = np.array(
        [values.get("stiffness_gradient.g_x", 0.0), values.get("stiffness_gradient.g_y", 0.0)]
    )
    points = np.einsum("ga,max->mgx", SHAPE, mesh.nodes[mesh.cells]) / radius
    return replace(
        law_of(values),
        surface=reference_surface(mesh, radius, values),
        thickness=1.0 + points @ slope,
        compliance=max(values.get("clamp_slip.compliance", 0.0), LEAST_COMPLIANCE),
    )


def law_of(values: Mapping[str, float]) -> Fabric:
    """A flat, even specimen with what of the parameters (`LAW`) belongs to the law."""
    return Fabric(
        slack=(values.get("prestrain.slack_x", 0.0), values.get("prestrain.slack_y", 0.0)),
        gain=(
            values.get("nonlinear_material.k_x", 0.0) * values["E1"],
            values.get("nonlinear_material.k_y", 0.0) * values["E2"],
        ),
        bend=(
            values.get("nonlinear_material.s_x", 0.0) * values["E1"],
            values.get("nonlinear_material.s_y", 0.0) * values["E2"],
        ),
        knee=(
            values.get("nonlinear_material.knee_x", KNEE),
            values.get("nonlinear_material.knee_y", KNEE),
        ),
    )


def _softening(time: Floats | None, rate: float) -> Floats | float:
    """Stiffness that creep leaves, over the first frame's: 1 - rate per decade of time."""
    if time is None:
        return 1.0
    return 1.0 - rate * _decades(time)


def _decades(time: Floats) -> Floats:
    elapsed = np.asarray(time, dtype=float) - time[0]
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return np.log10(1.0 + np.maximum(elapsed, 0.0) / max(step, 1e-9))


def applied_pressure(recorded: Floats, values: Mapping[str, float]) -> Floats:
    """Pressure (MPa) on the fabric and its clamp: recorded = true (1 + gain) + offset (bar)."""
    offset = 0.1 * values.get("pressure_offset.offset", 0.0)
    return (recorded - offset) / (1.0 + values.get("pressure_gain.gain", 0.0))


def applied_derivative(name: str, recorded: Floats, values: Mapping[str, float]) -> Floats:
    """∂(applied pressure)/∂(a load parameter), (frames,)."""
    gain = 1.0 + values.get("pressure_gain.gain", 0.0)
    if name == "pressure_offset.offset":
        return np.full_like(recorded, -0.1 / gain)
    if name == "pressure_gain.gain":
        return -applied_pressure(recorded, values) / gain
    return np.zeros_like(recorded)


def balanced_pressure(recorded: Floats, time: Floats | None, values: Mapping[str, float]) -> Floats:
    """Pressure (MPa) that the model must balance in each frame.

    A fabric whose stiffness creeps down to a share c of what it was balances p as the fresh one
    balances p/c.
    """
    softening = _softening(time, values.get("creep.rate", 0.0))
    return applied_pressure(recorded, values) / softening


def balanced_derivative(
    name: str, recorded: Floats, time: Floats | None, values: Mapping[str, float]
) -> Floats:
    """∂(balanced pressure)/∂(a load parameter), (frames,)."""
    softening = _softening(time, values.get("creep.rate", 0.0))
    if name != "creep.rate":
        return applied_derivative(name, recorded, values) / softening
    assert time is not None
    return balanced_pressure(recorded, time, values) * _decades(time) / softening
