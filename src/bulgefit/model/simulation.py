"""Which shapes does a membrane of known material take under given pressures?"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from bulgefit.errors import InputError, SolveError
from bulgefit.fem.equilibrium import NewtonError, solve
from bulgefit.fem.laws import LAWS
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import DEFAULT_REFINE, Mesh, disc, ellipse
from bulgefit.fem.path import Path
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.fem.relaxation import SLACK, TAUT, point_response
from bulgefit.fem.trace import TOLERANCE
from bulgefit.model.description import (
    Description,
    active_effects,
    checked,
    describe,
    null_values,
)
from bulgefit.model.parameters import Material, as_effects, as_values, material
from bulgefit.model.richardson import richardson
from bulgefit.model.smooth import smooth_value

__all__ = ["BALANCED_UP_TO", "Simulation", "simulate"]

Floats = NDArray[np.float64]

#: Pressures up to which every shape is balanced on its own; more are read off the dense output.
BALANCED_UP_TO = 20

#: Where paths start, MPa; lighter pressures start them lower.
_LOWEST = 1e-4


@dataclass(frozen=True, eq=False)
class Simulation:
    """Shapes of a membrane under pressures.

    Attributes
    ----------
    membrane : Membrane
    material : Material
    pressure : (k,) array, MPa
        As asked for, in that order.
    displacement : (k, n, 3) array, mm
    path : Path
        The traced path, for any other pressure up to the highest.
    error : float, mm
        Estimated error of the displacements against the exact solution on this mesh; 0 where
        every shape was balanced.
    wrinkled : (k,) int array
        Gauss points (4 a cell) without tension in some direction.
    stable : bool
        Whether all balanced shapes on the way were stable.
    factorisations : int
    seconds : float, s
        Wall time of the solution, first compilation included.
    mesh_error_taken_off, mesh_error : float or None, mm
        Largest change that took the mesh's error off, and largest of what is left of it; None
        where it was not taken off, or is not known.
    """

    membrane: Membrane
    material: Material
    pressure: Floats
    displacement: Floats
    path: Path
    error: float
    wrinkled: NDArray[np.int64]
    stable: bool
    factorisations: int
    seconds: float
    mesh_error_taken_off: float | None = None
    mesh_error: float | None = None

    def __repr__(self) -> str:
        loads = 10.0 * self.pressure
        return (
            f"Simulation({len(loads)} shapes from {loads.min():.4g} to {loads.max():.4g} bar, "
            f"{len(self.mesh.nodes)} nodes, {self.membrane.law})"
        )

    @property
    def mesh(self) -> Mesh:
        """The mesh."""
        return self.membrane.mesh

    @property
    def apex(self) -> Floats:
        """(k,) array, mm: dz of the node nearest the centre."""
        return np.asarray(self.displacement[:, self.mesh.apex, 2])

    def cell_fields(self, index: int) -> dict[str, Floats]:
        """Means over the cells at one pressure, in material axes (1 = warp, 2 = fill).

        Parameters
        ----------
        index : int
            Of the pressure.

        Returns
        -------
        dict of (m,) arrays
            `strain_11`, `strain_22`, `strain_12` (tensor components of the law's own strain:
            logarithmic under hencky, Green-Lagrange under svk; wrinkles included), `stress_11`,
            `stress_22`, `stress_12` (second Piola-Kirchhoff, MPa of the undeformed section) and
            `wrinkled` (share of the cell's Gauss points without tension in some direction).
        """
        membrane = self.membrane
        corners = (membrane.reference + self.displacement[index])[self.mesh.cells]
        f = np.einsum("mai,mgaj->mgij", corners, membrane.surface.gradient)
        c = np.einsum("mgki,mgkj->mgij", f, f)
        q, law = membrane.law_parameters(self.material.stiffness()), LAWS[membrane.law]
        out = np.empty((*c.shape[:2], 10))
        state = np.empty(c.shape[:2], dtype=np.int64)
        for at in np.ndindex(*state.shape):
            state[at] = point_response(
                c[at][0, 0], c[at][1, 1], c[at][0, 1], q, law, membrane.relaxation, out[at]
            )
        e11, e22, shear = law.strain(np.array([c[..., 0, 0], c[..., 1, 1], c[..., 0, 1]]))
        share = np.where(state == SLACK, 1, state != TAUT)
        return {
            "strain_11": e11.mean(axis=1),
            "strain_22": e22.mean(axis=1),
            "strain_12": 0.5 * shear.mean(axis=1),
            "stress_11": out[..., 1].mean(axis=1),
            "stress_22": out[..., 2].mean(axis=1),
            "stress_12": out[..., 3].mean(axis=1),
            "wrinkled": share.mean(axis=1),
        }


def simulate(
    parameters: Material | Mapping[str, float],
    pressure: ArrayLike,
    *,
    mesh: Mesh | None = None,
    refine: int = DEFAULT_REFINE,
    correct_mesh: bool = True,
    radius: float = 100.0,
    ellipticity: float = 0.0,
    thickness: float = 0.81,
    law: str = "hencky",
    angle: float = 0.0,
    effects: Mapping[str, float] | None = None,
    relaxation: bool = True,
    linear_solver: str | None = None,
    tolerance: float = TOLERANCE,
) -> Simulation:
    """Inflate a membrane that is clamped round its rim; flat and even unless effects say else.

    Parameters
    ----------
    parameters : Material or mapping
        A material, or E1, E2, G12 (MPa) and nu12 of an orthotropic one.
    pressure : (k,) array_like, MPa
        In any order (1 bar = 0.1 MPa). Up to `BALANCED_UP_TO` of them are balanced one by one;
        more are read off the dense output of the path, within `tolerance`.
    mesh : Mesh, optional
        By default bulgefit's own O-grid of the radius, `refine` times refined.
    refine : int
    correct_mesh : bool
        Take the error of bulgefit's own mesh off, as a finer one tells it; that of a given mesh
        stays.
    radius, thickness : float, mm
        `radius` is for the default mesh.
    ellipticity : float
        The clamp's semi-axes are radius (1 + ellipticity) along x and radius (1 - ellipticity)
        along y; for the default mesh.
    law : {"hencky", "svk"}
    angle : float, degree
        Warp axis turned from x, counter-clockwise seen from +z.
    effects : mapping of `effect.parameter` to value, optional
        Of shape, clamp, material and load; what cameras do changes no shape.
    relaxation : bool
        Tension-field relaxation: the fabric wrinkles instead of carrying compression.
    linear_solver : str, optional
    tolerance : float, mm
        Wanted error of the dense output, for a radius of 100 mm.

    Raises
    ------
    InputError
        Pressures, specimen or material cannot be.
    SolveError
        No equilibrium at some pressure; it says which one was reached.
    """
    began = time.perf_counter()
    loads = _pressures(pressure)
    for name, value, unit in (("radius", radius, "mm"), ("tolerance", tolerance, "mm")):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} must be positive, got {value:g} {unit}")
    if not np.isfinite(angle):
        raise InputError(f"angle must be finite, got {angle:g} degree")
    if not isinstance(parameters, Material):
        parameters = material(
            "orthotropic", **as_values(parameters, "material", "E1, E2, G12 (MPa) and nu12")
        )
    effects = as_effects(effects)
    own = mesh is None
    if not abs(ellipticity) < 1.0:
        raise InputError(f"ellipticity must lie between -1 and 1, got {ellipticity:g}")
    if mesh is None:
        mesh = ellipse(radius, ellipticity, refine)
    elif ellipticity:
        raise InputError("ellipticity: is for the default mesh; a given one has its own rim")
    if mesh.apex in mesh.rim:
        raise InputError(
            "mesh: its node nearest the centre (0, 0) lies on its rim; give a disc about the "
            "centre, with nodes inside"
        )
    stretch = np.array([1.0 + ellipticity, 1.0 - ellipticity])
    given = _described(mesh, stretch, parameters, loads, effects)
    membrane = Membrane(
        mesh,
        thickness,
        law,
        relaxation=relaxation,
        angle=np.deg2rad(angle) + given.angle,
        solver=linear_solver,
        fabric=given.fabric,
    )
    balanced = _pressures(given.load.balanced)
    with threadpool_limits(1):  # so that results do not depend on the machine's cores
        found = _balanced(membrane, given.stiffness, balanced, tolerance, parameters)
        correction, left = None, None
        if own and correct_mesh:
            correction, left = _mesh_error(
                membrane, radius, stretch, refine, found.displacement, parameters, effects,
                loads, tolerance,
            )  # fmt: skip
        displacement = found.displacement if correction is None else found.displacement + correction
        wrinkled = [
            membrane.state(u, p, given.stiffness, tangent=False).wrinkled
            for u, p in zip(found.displacement, balanced, strict=True)
        ]
    return Simulation(
        membrane=membrane,
        material=parameters,
        pressure=loads,
        displacement=displacement,
        path=found.path,
        error=found.error,
        wrinkled=np.array(wrinkled),
        stable=found.stable,
        factorisations=found.work,
        seconds=time.perf_counter() - began,
        mesh_error_taken_off=None if correction is None else float(np.abs(correction).max()),
        mesh_error=left,
    )


@dataclass(frozen=True, eq=False)
class _Solved:
    """Shapes of one mesh."""

    displacement: Floats
    path: Path
    error: float
    stable: bool
    work: int


def _balanced(
    membrane: Membrane, stiffness: Floats, loads: Floats, tolerance: float, made: Material
) -> _Solved:
    """A path, and each shape balanced on its own where they are few; raises SolveError."""
    path = trace_by_quarter(
        membrane,
        stiffness,
        (min(_LOWEST, loads.min()), loads.max()),
        tolerance=tolerance,
        parameters=made.values,
        beyond_ellipticity=True,
    )
    displacement, work, stable = path(loads), path.factorisations, bool(path.stable.all())
    if len(loads) > BALANCED_UP_TO:
        return _Solved(displacement, path, path.error_estimate, stable, work)
    for i, load in enumerate(loads):
        if np.isclose(load, path.pressure, rtol=1e-14, atol=0.0).any():
            continue
        try:
            balance = solve(membrane, displacement[i], load, stiffness, follow=True)
        except NewtonError as error:
            raise SolveError(
                f"no equilibrium near the traced path: {error.reason}",
                pressure=load,
                reached=path.pressure[path.pressure < load].max(),
                iteration=error.iteration,
                residual_norm=error.residual_norm,
                parameters=made.values,
            ) from error
        displacement[i] = balance.displacement
        work += balance.factorisations
        stable = stable and balance.stable
    return _Solved(displacement, path, 0.0, stable, work)


def _mesh_error(
    like: Membrane,
    radius: float,
    stretch: Floats,
    refine: int,
    here: Floats,
    made: Material,
    effects: Mapping[str, float],
    loads: Floats,
    tolerance: float,
) -> tuple[Floats | None, float | None]:
    """What takes the mesh's error off (k, n, 3) mm, and the largest of what is left of it, mm."""

    def on(other: int) -> Floats:
        circle = disc(radius, other)
        mesh = Mesh(circle.nodes * stretch, circle.cells)
        given = _described(mesh, stretch, made, loads, effects)
        membrane = Membrane(
            mesh, like.thickness, like.law, relaxation=like.relaxation, angle=like.angle,
            solver=like.forced, fabric=given.fabric,
        )  # fmt: skip
        balanced = _pressures(given.load.balanced)
        there = _balanced(membrane, given.stiffness, balanced, tolerance, made).displacement
        back = smooth_value(circle.nodes, like.mesh.nodes / stretch)
        return np.stack([back @ one for one in there])

    try:
        return richardson(refine, here, on)
    except SolveError:
        return None, None


def _described(
    mesh: Mesh, stretch: Floats, made: Material, loads: Floats, effects: Mapping[str, float]
) -> Description:
    """The specimen that material and effects describe; InputError."""
    checked(effects)
    values = {**made.constants(), **effects}
    nulls = null_values(made.constants()["nu12"])
    radius = float(np.hypot(*(mesh.nodes[mesh.rim] / stretch).T).max())
    active = active_effects(values, nulls)
    given = describe(mesh, radius, loads, None, values, active, stretch=stretch)
    if given.edge is not None:
        raise InputError("simulate: a rim that moves is known to fit and predict alone")
    return given


def _pressures(pressure: ArrayLike) -> Floats:
    try:
        loads = np.atleast_1d(np.asarray(pressure, dtype=np.float64))
    except (TypeError, ValueError):
        raise InputError(f"pressure must be numbers in MPa, got {pressure!r}") from None
    if loads.ndim != 1 or len(loads) == 0:
        raise InputError(f"pressure must be a list of numbers, got the shape {loads.shape}")
    bad = loads[~(np.isfinite(loads) & (loads > 0.0))]
    if len(bad):
        raise InputError(f"pressures must be above 0, got {10 * bad[0]:g} bar")
    return loads
