"""Which shapes does a membrane of known material take under given pressures?"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.frames import dataframe, labelled
from bulgefit.errors import InputError
from bulgefit.fem.laws import LAWS
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import DEFAULT_REFINE, Mesh
from bulgefit.fem.path import Path
from bulgefit.fem.relaxation import TAUT, point_response
from bulgefit.fem.trace import TOLERANCE
from bulgefit.model.description import Description, checked
from bulgefit.model.inflation import Inflation
from bulgefit.model.mesh_error import correct_mesh as correct_mesh_of
from bulgefit.model.mesh_error import corrected, mesh_remainder
from bulgefit.model.parameters import Material, as_effects, as_values, material
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest
from bulgefit.parallel.threads import one_blas_thread
from bulgefit.shown import Drawn

__all__ = ["BALANCED_UP_TO", "Simulation", "simulate"]

Floats = NDArray[np.float64]

#: Pressures up to which every shape is balanced on its own; more are read off the dense output.
BALANCED_UP_TO = 20


@dataclass(frozen=True, eq=False)
class Simulation(Drawn):
    """Shapes of a membrane under pressures.

    Attributes
    ----------
    membrane : Membrane
    material : Material
    pressure : (k,) array, MPa
        As asked for, in that order.
    displacement : (k, n, 3) array, mm
    error : float, mm
        Estimated error of the displacements against the exact solution on this mesh; 0 where
        every shape was balanced.
    tolerance : float, mm
        What it was to be at most; beside a singular point there may be no balanced shape near by.
    wrinkled : (k,) int array
        Gauss points (4 a cell) without tension in some direction.
    stable : bool
        Whether all shapes are stable.
    elliptic : (k,) bool array
        Whether the law is elliptic all over each shape: where it is not, nothing keeps the fabric
        from bands of shear, and shapes depend on the mesh.
    factorisations : int
        Spent on the shapes, those of other meshes left out.
    seconds : float, s
        Wall time of the solution, first compilation included.
    mesh_corrected : (k,) bool array or None
        Whether the mesh's error was taken off each shape: it stays in those that other meshes do
        not have alike, as beyond ellipticity. None where it was not to be.
    mesh_error_taken_off, mesh_error : float or None, mm
        Largest change that took the mesh's error off, and largest of what is left of it; None
        where it was not taken off, or is not known.
    inflation : Inflation
    description : Description
        Of the specimen.
    """

    membrane: Membrane
    material: Material
    pressure: Floats
    displacement: Floats
    error: float
    tolerance: float
    wrinkled: NDArray[np.int64]
    stable: bool
    elliptic: NDArray[np.bool_]
    factorisations: int
    seconds: float
    mesh_corrected: NDArray[np.bool_] | None
    mesh_error_taken_off: float | None
    mesh_error: float | None
    inflation: Inflation
    description: Description

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

    @cached_property
    def path(self) -> Path:
        """The path up to the highest pressure; traced when first asked for.

        By the pressure that acts, which effects of the load set apart from the recorded one, and on
        this mesh: its error is left in.

        Raises
        ------
        InputError
            The rim moves from frame to frame: no path goes through its shapes.
        """
        if self.description.edge is not None or self.description.eased is not None:
            raise InputError(
                "there is no path where effects move the rim or ease the clamp frame by frame: "
                "simulate the pressures themselves"
            )
        with one_blas_thread():
            return self.inflation.path(self.description, self.material.values, sensitivities=False)

    @property
    def apex(self) -> Floats:
        """(k,) array, mm: dz of the node nearest the centre."""
        return np.asarray(self.displacement[:, self.mesh.apex, 2])

    def to_dict(self) -> dict[str, Any]:
        """Pressures, apex and how well they are known, as JSON types."""
        return {
            "law": self.membrane.law,
            "parameters": dict(self.material.values),
            "pressure_bar": (10.0 * self.pressure).tolist(),
            "apex_mm": self.apex.tolist(),
            "wrinkled": self.wrinkled.tolist(),
            "stable": self.stable,
            "elliptic": self.elliptic.tolist(),
            "error_mm": self.error,
            "mesh_corrected": None if self.mesh_corrected is None else self.mesh_corrected.tolist(),
            "mesh_error_mm": self.mesh_error,
        }

    def to_dataframe(self) -> Any:
        """A row a pressure: apex and wrinkled Gauss points; needs `bulgefit[pandas]`."""
        columns = {"pressure_bar": 10.0 * self.pressure, "apex_mm": self.apex}
        return dataframe({**columns, "wrinkled": self.wrinkled})

    def to_xarray(self) -> Any:
        """Displacement (mm) by shape, node and component; needs `bulgefit[xarray]`."""
        return labelled(
            self.displacement,
            ("shape", "node", "component"),
            {
                "component": ["dx", "dy", "dz"],
                "pressure_bar": ("shape", 10.0 * self.pressure),
                **{f"{a}_mm": ("node", self.membrane.reference[:, i]) for i, a in enumerate("xyz")},
            },
            name="displacement",
            unit="mm",
        )

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
        q, law = membrane.law_parameters(self.description.stiffness), LAWS[membrane.law]
        out = np.empty((*c.shape[:2], 10))
        state = np.empty(c.shape[:2], dtype=np.int64)
        for at in np.ndindex(*state.shape):
            state[at] = point_response(
                c[at][0, 0], c[at][1, 1], c[at][0, 1], q, law, membrane.relaxation, out[at]
            )
        e11, e22, shear = law.strain(np.array([c[..., 0, 0], c[..., 1, 1], c[..., 0, 1]]))
        return {
            "strain_11": e11.mean(axis=1),
            "strain_22": e22.mean(axis=1),
            "strain_12": 0.5 * shear.mean(axis=1),
            "stress_11": out[..., 1].mean(axis=1),
            "stress_22": out[..., 2].mean(axis=1),
            "stress_12": out[..., 3].mean(axis=1),
            "wrinkled": (state != TAUT).mean(axis=1),
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
        more are read off the dense output of the path, within `tolerance`; where it does not come
        as near, as beyond ellipticity, they are balanced, too.
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
    law : str
        "hencky", "svk", "yarn", or one that an installed package brings.
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
    for name, length in (("radius", radius), ("thickness", thickness)):
        if not isinstance(length, Real) or not 0.0 < length < np.inf:
            raise InputError(f"{name} must be a length above 0 mm, got {length!r}")
    for name, number in (("angle", angle), ("ellipticity", ellipticity)):
        if not isinstance(number, Real) or not np.isfinite(number):
            raise InputError(f"{name} must be a finite number, got {number!r}")
    if not isinstance(parameters, Material):
        parameters = material(
            "orthotropic", **as_values(parameters, "material", "E1, E2, G12 (MPa) and nu12")
        )
    setup = Setup(
        law=law,
        mesh=mesh,
        refine=refine,
        relaxation=relaxation,
        interpolation="none" if len(loads) <= BALANCED_UP_TO else "dense",
        tolerance=tolerance,
        linear_solver=linear_solver,
        correct_mesh=correct_mesh,
    )
    virtual = _virtual(mesh, radius, ellipticity, thickness, angle, loads, setup)
    values = {**parameters.constants(), **as_effects(effects)}
    return _simulated(virtual, parameters, values, began)


def _simulated(
    virtual: VirtualTest, made: Material, values: dict[str, float], began: float
) -> Simulation:
    """Shapes at a virtual test's pressures; InputError, SolveError."""
    checked(values)
    balanced = _pressures(virtual.load(values).balanced)
    with one_blas_thread():  # so that results do not depend on the machine's cores
        shapes = virtual.shapes(values)
        correct_mesh_of(virtual, shapes)
        left = mesh_remainder(virtual, shapes)
        given = virtual.description(values)
        membrane = virtual.inflation.membrane(given)
        wrinkled = [
            membrane.state(u, p, given.stiffness, tangent=False).wrinkled
            for u, p in zip(shapes.displacement, balanced, strict=True)
        ]
        elliptic = [membrane.is_elliptic(u, given.stiffness) for u in shapes.displacement]
    displacement, correction = shapes.displacement, virtual.correction
    return Simulation(
        membrane=membrane,
        material=made,
        pressure=virtual.recorded,
        displacement=displacement if correction is None else displacement + correction,
        error=shapes.error,
        tolerance=virtual.setup.tolerance * virtual.inflation.radius / 100.0,
        wrinkled=np.array(wrinkled),
        stable=bool(shapes.stable.all()),
        elliptic=np.array(elliptic),
        factorisations=shapes.factorisations,
        seconds=time.perf_counter() - began,
        mesh_corrected=corrected(virtual, shapes) if virtual.setup.corrects_mesh else None,
        mesh_error_taken_off=None if correction is None else float(np.abs(correction).max()),
        mesh_error=None if left is None else float(np.abs(left).max()),
        inflation=virtual.inflation,
        description=given,
    )


def _virtual(
    mesh: Mesh | None,
    radius: float,
    ellipticity: float,
    thickness: float,
    angle: float,
    loads: Floats,
    setup: Setup,
) -> VirtualTest:
    """The virtual twin of a test in which no point is measured."""
    if not abs(ellipticity) < 1.0:
        raise InputError(f"ellipticity must lie between -1 and 1, got {ellipticity:g}")
    if mesh is not None:
        if ellipticity:
            raise InputError("ellipticity: is for the default mesh; a given one has its own rim")
        if mesh.apex in mesh.rim:
            raise InputError(
                "mesh: its node nearest the centre (0, 0) lies on its rim; give a disc about the "
                "centre, with nodes inside"
            )
        radius = float(np.hypot(*mesh.nodes[mesh.rim].T).max())
    test = BulgeTest(
        "simulation", (), loads, radius, thickness, ellipticity=ellipticity, warp_angle=angle
    )
    # any outline will do: there are no points that a mesh could fail to cover
    inflation = Inflation(radius, thickness, float(loads.max()), setup, ellipticity)
    return VirtualTest(test, setup, inflation=inflation)


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
