"""Balanced shapes of a made test: its own mesh, load and fabric, free of mesh error.

Shapes are balanced on a mesh (`hexagon`) and on one twice as coarse, whose nodes it shares;
Richardson's extrapolation then takes off the leading error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from bulgefit.errors import BulgefitError, SolveError
from bulgefit.fem.equilibrium import NewtonError, solve
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import Mesh
from bulgefit.fem.path import Path
from bulgefit.fem.trace import trace
from bulgefit.trial.cloth import evenness, law_of, stiffness, turn_ply
from bulgefit.trial.draw import Draw, sheared
from bulgefit.trial.hexagon import FINENESS, TwoPlies, hexagon
from bulgefit.trial.rim import Course, lift, positions, soften_sector

__all__ = ["Shapes", "UnstableDrawError", "balance", "path_of"]

Floats = NDArray[np.float64]

#: Error of the dense output, mm.
_TOLERANCE = 2e-4
#: Share of the shear stiffness with which a fabric must be stable as well. Where shear is so soft
#: that bands are about to form, meshes differ by hundredths of a millimetre, and a finer one finds
#: no shape where a coarser one does.
_SOFTER = 0.9


class UnstableDrawError(BulgefitError):
    """The fabric has no stable shape somewhere in the range of pressures."""


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
    drawn: Draw, course: Course, *, radius: float, thickness: float, fineness: int = FINENESS
) -> Shapes:
    """Balance every frame.

    Parameters
    ----------
    course : Course
        What each frame asks of fabric and clamp.
    radius, thickness : float, mm
    fineness : int
        A multiple of 8.

    Raises
    ------
    UnstableDrawError
    """
    place = {"radius": radius, "thickness": thickness}
    meshes = [hexagon(n) for n in (fineness // 2, fineness)]
    _traced(sheared(drawn, _SOFTER), meshes[1], course, **place)
    coarse, fine = (_balanced(drawn, mesh, course, **place) for mesh in meshes)
    away, shared = KDTree(meshes[1].nodes).query(meshes[0].nodes)
    assert away.max() < 1e-9, "fineness is no multiple of 8: the meshes are not nested"
    nodes = [positions(drawn, mesh.nodes, radius) for mesh in meshes]
    return Shapes(nodes[1], fine, nodes[0], (fine[:, shared] - coarse) / 3.0)


def path_of(
    drawn: Draw,
    mesh: Mesh,
    pressure: Floats,
    *,
    radius: float,
    thickness: float,
    compliance: float | None = None,
    sensitivities: bool = False,
) -> tuple[Membrane, Path]:
    """Membrane of a draw on a unit mesh, and its path over the pressures (MPa).

    Raises
    ------
    UnstableDrawError
    """
    membrane = _membrane(drawn, mesh, radius, thickness, compliance)
    span = float(pressure.min()), float(pressure.max())
    try:
        path = trace(
            membrane, stiffness(drawn), span, tolerance=_TOLERANCE, sensitivities=sensitivities
        )
    except SolveError as error:
        raise UnstableDrawError(str(error)) from error
    if not path.stable.all():
        raise UnstableDrawError("the tangent is not positive definite everywhere")
    return membrane, path


def _traced(
    drawn: Draw, mesh: Mesh, course: Course, radius: float, thickness: float
) -> tuple[Membrane, Path]:
    """The path by what is the same in all frames, or the mean over them."""
    slips = course.compliance
    return path_of(
        drawn,
        mesh,
        course.pressure / course.soft,
        radius=radius,
        thickness=thickness,
        compliance=None if slips is None else float(slips.mean()),
    )


def _balanced(drawn: Draw, mesh: Mesh, course: Course, radius: float, thickness: float) -> Floats:
    """Displacement (frames, n, 3) mm on one mesh."""
    slips = course.compliance
    membrane, path = _traced(drawn, mesh, course, radius, thickness)
    if course.steady:
        return path(course.pressure)
    # each frame has a fabric or a clamp of its own; how far the one before it lay off the path is
    # where the search starts
    shapes, off = [], np.zeros_like(membrane.reference)
    rise = lift(drawn, mesh.nodes[mesh.rim])
    for frame, (p, c) in enumerate(zip(course.pressure, course.soft, strict=True)):
        slip = None if slips is None else float(slips[frame])
        own = _membrane(drawn, mesh, radius, float(c) * thickness, slip, like=membrane)
        near = path(p / c)[0]
        start = near + off
        start[mesh.rim, 2] = course.lift[frame] * rise
        try:
            found = solve(own, start, float(p), stiffness(drawn))
        except NewtonError as error:
            raise UnstableDrawError(str(error)) from error
        if not found.stable:
            raise UnstableDrawError("the tangent is not positive definite everywhere")
        off = found.displacement - near
        shapes.append(found.displacement)
    return np.array(shapes)


def _membrane(
    drawn: Draw,
    mesh: Mesh,
    radius: float,
    thickness: float,
    compliance: float | None,
    like: Membrane | None = None,
) -> Membrane:
    if "rotated_ply" in drawn.effects:
        mesh = TwoPlies.of(mesh)
    places = positions(drawn, mesh.nodes, radius)
    flat = not places[:, 2].any()
    membrane = Membrane(
        type(mesh)(places[:, :2].copy(), mesh.cells),
        thickness,
        angle=np.deg2rad(drawn.mounted + drawn.get("axis_misalignment.angle")),
        fabric=Fabric(
            surface=None if flat else places,
            thickness=evenness(drawn, mesh, radius),
            compliance=compliance,
            **law_of(drawn),
        ),
        like=like,
    )
    if "rotated_ply" in drawn.effects:
        turn_ply(membrane, drawn)
    if "slipping_sector" in drawn.effects:
        assert membrane.clamp is not None
        assert compliance is not None
        soften_sector(membrane.clamp, drawn, compliance)
    return membrane
