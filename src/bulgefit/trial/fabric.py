"""Balanced shapes of a made test: its own mesh, load and fabric, free of mesh error.

The mesh is a hexagon of three rhombi inside six sectors (three cells meet at the centre), not
the square in a ring that diagnoses. Shapes are balanced on it and on one twice as coarse, whose
nodes it shares; Richardson's extrapolation then takes off the leading error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bulgefit.errors import BulgefitError, SolveError
from bulgefit.fem.clamp import LEAST_COMPLIANCE
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import NewtonError, solve
from bulgefit.fem.geometry import SHAPE
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import Mesh
from bulgefit.fem.path import Path
from bulgefit.fem.trace import trace
from bulgefit.trial.draw import Draw

__all__ = ["Shapes", "UnstableDrawError", "balance", "hexagon", "path_of", "softening", "true_load"]

Floats = NDArray[np.float64]

#: Cells along a rhombus: 7.5 FINENESS² cells, 4320.
FINENESS = 24
#: Half diagonal of the hexagon over the radius.
_CORE = 0.55
#: Error of the dense output, mm.
_TOLERANCE = 2e-4


class UnstableDrawError(BulgefitError):
    """The fabric has no stable shape somewhere in the range of pressures."""


def hexagon(fineness: int) -> Mesh:
    """The unit disc: a hexagon of three rhombi, and six sectors around it.

    The nodes of `hexagon(n)` are among those of `hexagon(2 n)` where n is a multiple of 4.

    Parameters
    ----------
    fineness : int
        Cells along a rhombus.
    """
    corner = _CORE * np.exp(1j * np.pi / 3 * np.arange(7))
    share = np.linspace(0.0, 1.0, fineness + 1)
    patches = [
        share[:, None] * corner[2 * k] + share[None, :] * corner[(2 * k + 2) % 6] for k in range(3)
    ]
    out = np.linspace(0.0, 1.0, 3 * fineness // 4 + 1)[:, None]
    for k in range(6):
        edge = (1 - share) * corner[k] + share * corner[k + 1]
        rim = np.exp(1j * np.pi / 3 * (k + share))
        patches.append((1 - out) * edge + out * rim)
    return _joined(patches)


def _joined(patches: Sequence[NDArray[np.complex128]]) -> Mesh:
    """One mesh of patches, each a grid of points x + iy, that share their sides."""
    points = np.concatenate([patch.ravel() for patch in patches])
    keys = np.round(np.stack([points.real, points.imag], axis=1), 9) + 0.0
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    cells, start = [], 0
    for patch in patches:
        grid = number.ravel()[start : start + patch.size].reshape(patch.shape)
        start += patch.size
        corners = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
        cells.append(np.stack(corners, axis=-1).reshape(-1, 4))
    chosen = points[first]
    return Mesh.from_arrays(np.stack([chosen.real, chosen.imag], axis=1), np.concatenate(cells))


@dataclass(frozen=True, eq=False)
class Shapes:
    """Balanced shapes of the frames.

    Attributes
    ----------
    nodes, fine : (n, 3) array, mm; (frames, n, 3) array, mm
        Stress-free positions and displacements on the fine mesh.
    coarse_nodes, correction : (m, 3) array, mm; (frames, m, 3) array, mm
        What is left of the mesh error, to be added: a smooth field on the coarse mesh.
    """

    nodes: Floats
    fine: Floats
    coarse_nodes: Floats
    correction: Floats


def balance(
    drawn: Draw,
    pressure: Floats,
    soft: Floats,
    *,
    radius: float,
    thickness: float,
    fineness: int = FINENESS,
) -> Shapes:
    """Balance every frame.

    Parameters
    ----------
    pressure : (frames,) array, MPa
        True.
    soft : (frames,) array
        Stiffness over its value in the first frame.
    radius, thickness : float, mm
    fineness : int
        A multiple of 8.

    Raises
    ------
    UnstableDrawError
    """
    place = {"radius": radius, "thickness": thickness}
    meshes = [hexagon(n) for n in (fineness // 2, fineness)]
    coarse, fine = (_balanced(drawn, mesh, pressure, soft, **place) for mesh in meshes)
    away, shared = KDTree(meshes[1].nodes).query(meshes[0].nodes)
    assert away.max() < 1e-9, "fineness is no multiple of 8: the meshes are not nested"
    nodes = [_positions(drawn, mesh.nodes, radius) for mesh in meshes]
    return Shapes(nodes[1], fine, nodes[0], (fine[:, shared] - coarse) / 3.0)


def true_load(drawn: Draw, recorded: Floats) -> Floats:
    """True pressure (MPa): recorded = true × (1 + gain) + offset, the offset in bar."""
    offset = drawn.get("pressure_offset.offset") / 10.0
    return (recorded - offset) / (1.0 + drawn.get("pressure_gain.gain"))


def softening(drawn: Draw, time: Floats) -> Floats:
    """Stiffness over that of the first frame: it falls by `rate` per decade of time.

    The clock of the decades starts at the first frame and counts median intervals of frames.
    """
    unit = float(np.median(np.diff(time)))
    return 1.0 - drawn.get("creep.rate") * np.log10(1.0 + (time - time[0]) / unit)


def path_of(
    drawn: Draw,
    mesh: Mesh,
    pressure: Floats,
    *,
    radius: float,
    thickness: float,
    sensitivities: bool = False,
) -> tuple[Membrane, Path]:
    """Membrane of a draw on a unit mesh, and its path over the pressures (MPa).

    Raises
    ------
    UnstableDrawError
    """
    membrane = _membrane(drawn, mesh, radius, thickness)
    span = float(pressure.min()), float(pressure.max())
    try:
        path = trace(
            membrane, _stiffness(drawn), span, tolerance=_TOLERANCE, sensitivities=sensitivities
        )
    except SolveError as error:
        raise UnstableDrawError(str(error)) from error
    if not path.stable.all():
        raise UnstableDrawError("the tangent is not positive definite everywhere")
    return membrane, path


def _balanced(
    drawn: Draw, mesh: Mesh, pressure: Floats, soft: Floats, radius: float, thickness: float
) -> Floats:
    """Displacement (frames, n, 3) mm on one mesh."""
    membrane, path = path_of(drawn, mesh, pressure / soft, radius=radius, thickness=thickness)
    if (soft == 1.0).all():
        return path(pressure)
    # a creeping fabric: each frame has a stiffness of its own, the clamp does not creep
    shapes = []
    for p, c in zip(pressure, soft, strict=True):
        weaker = _membrane(drawn, mesh, radius, float(c) * thickness, like=membrane)
        try:
            found = solve(weaker, path(p / c)[0], float(p), _stiffness(drawn), follow=True)
        except NewtonError as error:
            raise UnstableDrawError(str(error)) from error
        if not found.stable:
            raise UnstableDrawError("the tangent is not positive definite everywhere")
        shapes.append(found.displacement)
    return np.array(shapes)


def _stiffness(drawn: Draw) -> Floats:
    m = drawn.moduli
    return orthotropic_stiffness(m["E1"], m["E2"], m["G12"], drawn.nu12)


def _membrane(
    drawn: Draw, mesh: Mesh, radius: float, thickness: float, like: Membrane | None = None
) -> Membrane:
    positions = _positions(drawn, mesh.nodes, radius)
    flat = not positions[:, 2].any()
    slack = drawn.get("prestrain.slack_x"), drawn.get("prestrain.slack_y")
    gain = (
        drawn.get("nonlinear_material.k_x") * drawn.moduli["E1"],
        drawn.get("nonlinear_material.k_y") * drawn.moduli["E2"],
    )
    bend = (
        drawn.get("nonlinear_material.s_x") * drawn.moduli["E1"],
        drawn.get("nonlinear_material.s_y") * drawn.moduli["E2"],
    )
    knee = tuple(drawn.get(f"nonlinear_material.knee_{axis}", 1.0) for axis in "xy")
    slips = "clamp_slip" in drawn.effects
    sector = "slipping_sector" in drawn.effects
    membrane = Membrane(
        Mesh(positions[:, :2].copy(), mesh.cells),
        thickness,
        angle=np.deg2rad(drawn.get("axis_misalignment.angle")),
        fabric=Fabric(
            surface=None if flat else positions,
            thickness=_thickness(drawn, mesh, radius),
            slack=slack,
            gain=gain,
            bend=bend,
            knee=(knee[0], knee[1]),
            compliance=drawn.get("clamp_slip.compliance") if slips or sector else None,
        ),
        like=like,
    )
    if sector:
        _free_sector(membrane, drawn)
    return membrane


def _positions(drawn: Draw, unit: Floats, radius: float) -> Floats:
    """Stress-free positions (n, 3) mm of points of the unit disc."""
    x, y = unit.T
    square = x * x + y * y
    oval = drawn.get("clamp_shape.ellipticity")
    axes = (1.0 + drawn.get("clamp_shape.radius_error")) * np.array([1.0 + oval, 1.0 - oval])
    # three lobes: ρ³ cos 3(φ - turn) is smooth at the centre
    turned = (x + 1j * y) ** 3 * np.exp(-3j * np.deg2rad(drawn.get("lobed_rim.turn")))
    lobes = 1.0 + drawn.get("lobed_rim.lobe") * turned.real
    height = [drawn.get(f"initial_shape.{n}") for n in ("h0", "hx", "hy", "c2", "s2", "h2")]
    modes = np.stack([np.ones_like(x), x, y, x * x - y * y, 2.0 * x * y, square])
    z = (1.0 - square) * (height @ modes)
    return np.column_stack([radius * lobes[:, None] * unit * axes, z])


def _thickness(drawn: Draw, mesh: Mesh, radius: float) -> Floats:
    """Stiffness over the nominal one at the Gauss points, (cells, 4)."""
    x, y = np.moveaxis(np.einsum("ga,max->mgx", SHAPE, mesh.nodes[mesh.cells]), -1, 0)
    even = 1.0 + drawn.get("stiffness_gradient.g_x") * x + drawn.get("stiffness_gradient.g_y") * y
    width = drawn.get("soft_patch.width", 1.0) / radius
    centre = drawn.get("soft_patch.x") / radius, drawn.get("soft_patch.y") / radius
    distance = (x - centre[0]) ** 2 + (y - centre[1]) ** 2
    return even * (1.0 - drawn.get("soft_patch.drop") * np.exp(-0.5 * distance / width**2))


def _free_sector(membrane: Membrane, drawn: Draw) -> None:
    """Soften the springs of the rim in a sector; elsewhere they hold."""
    clamp = membrane.clamp
    assert clamp is not None
    angle = np.arctan2(clamp.radial[:, 1], clamp.radial[:, 0])
    middle = np.deg2rad(drawn.get("slipping_sector.middle"))
    away = np.abs(np.angle(np.exp(1j * (angle - middle))))
    half = np.deg2rad(drawn.get("slipping_sector.half_width"))
    share = np.where(away < half, np.cos(0.5 * np.pi * np.minimum(away / half, 1.0)) ** 2, 0.0)
    compliance = np.maximum(share * drawn.get("slipping_sector.compliance"), LEAST_COMPLIANCE)
    change = clamp.length / compliance - clamp.length / LEAST_COMPLIANCE
    clamp.stiffness += change[:, None, None] * clamp.radial[:, :, None] * clamp.radial[:, None, :]
