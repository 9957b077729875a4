"""The virtual bulge test: material parameters to displacements at the measured points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.errors import InputError
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import DEFAULT_REFINE, Mesh, disc
from bulgefit.fem.path import Path
from bulgefit.fem.quarter import trace_by_quarter
from bulgefit.model.observation import Observation, observe
from bulgefit.model.parameters import Material

__all__ = ["STUDY_LEVELS", "Fields", "Setup", "VirtualTests", "apex_blocks"]

Floats = NDArray[np.floating]

#: The study's pressure levels, MPa.
STUDY_LEVELS = np.linspace(0.001, 3.0, 200) * 0.1

#: Paths start here (MPa) or at a tenth of the highest pressure; symmetry covers the rest to zero.
LIGHT_PRESSURE = 1e-4


@dataclass(frozen=True)
class Setup:
    """How the virtual test is computed.

    Attributes
    ----------
    law : {"hencky", "svk"}
    mesh : Mesh or None
        None: a disc of the test's radius, `refine` times refined.
    refine : int
    relaxation : bool
        Tension-field relaxation.
    evaluation : {"shape", "rbf", "local-rbf"}
        Field evaluation at the measured points.
    interpolation : {"dense", "study"}
        In pressure: the path's dense output, or linear between the study's 200 levels.
    tolerance : float, mm
        Of the dense output, for a radius of 100 mm.
    linear_solver : str or None
        Force a linear solver; None chooses by size.
    """

    law: str = "hencky"
    mesh: Mesh | None = field(default=None, compare=False)
    refine: int = DEFAULT_REFINE
    relaxation: bool = True
    evaluation: str = "shape"
    interpolation: str = "dense"
    tolerance: float = 1e-3
    linear_solver: str | None = None

    def __post_init__(self) -> None:
        if self.interpolation not in ("dense", "study"):
            raise InputError(
                f"interpolation: {self.interpolation!r} is unknown; choose from dense, study"
            )


@dataclass(frozen=True, eq=False)
class Fields:
    """Nodal displacements of one test at the pressures of its frames.

    Attributes
    ----------
    displacement : (frames, n, 3) array, mm
    derivative : (parameters, frames, n, 3) array or None
        By the material's parameters (mm/MPa, mm).
    """

    displacement: Floats
    derivative: Floats | None


class VirtualTests:
    """Tests, and the membranes that stand for their specimens.

    Tests of the same radius and thickness share a membrane and so its path.

    Parameters
    ----------
    tests : sequence of BulgeTest
    setup : Setup
    """

    def __init__(self, tests: Sequence[BulgeTest], setup: Setup | None = None) -> None:
        if not tests:
            raise InputError("no bulge test was given")
        self.tests = tuple(tests)
        self.setup = setup or Setup()
        self._membranes: dict[tuple[float, float], Membrane] = {}
        for test in self.tests:
            key = (test.radius, test.thickness)
            if key not in self._membranes:
                self._membranes[key] = self._membrane(test)
        # the points are kept beside their operator, so that their id stays theirs
        self._observations: dict[tuple[int, float, float], tuple[Floats, Observation]] = {}

    def __getstate__(self) -> dict[str, object]:
        # an id means another array in another process, or none
        return {**self.__dict__, "_observations": {}}

    def _membrane(self, test: BulgeTest) -> Membrane:
        setup = self.setup
        mesh = setup.mesh or disc(test.radius, setup.refine)
        rim = np.hypot(*mesh.nodes[mesh.rim].T)
        if np.abs(rim / test.radius - 1).max() > 1e-3:
            raise InputError(
                f"mesh: its rim lies {rim.min():.6g} to {rim.max():.6g} mm from the centre (0, 0), "
                f"the clamp of {test.name} at {test.radius:g} mm; give a mesh of that disc"
            )
        return Membrane(
            mesh,
            test.thickness,
            setup.law,
            relaxation=setup.relaxation,
            solver=setup.linear_solver,
        )

    def membrane(self, test: BulgeTest) -> Membrane:
        """The membrane that stands for a test's specimen."""
        return self._membranes[test.radius, test.thickness]

    def observation(self, test: BulgeTest, block: Block) -> Observation:
        """Operator from the test's mesh to the points of a block, built once."""
        key = (id(block.reference), test.radius, test.thickness)
        if key not in self._observations:
            operator = observe(self.membrane(test).mesh, block.reference, self.setup.evaluation)
            self._observations[key] = block.reference, operator
        return self._observations[key][1]

    def paths(self, material: Material, *, derivatives: bool) -> dict[tuple[float, float], Path]:
        """One traced path per membrane; raises SolveError with the material's parameters."""
        return {
            key: trace_by_quarter(
                membrane,
                material.stiffness(),
                self._range(key),
                tolerance=self.setup.tolerance,
                sensitivities=derivatives,
                parameters=material.values,
                beyond_ellipticity=True,
            )
            for key, membrane in self._membranes.items()
        }

    def _range(self, key: tuple[float, float]) -> tuple[float, float]:
        high = max(float(t.pressure.max()) for t in self.tests if (t.radius, t.thickness) == key)
        if high <= 0.0:
            raise InputError("no frame has a positive pressure")
        if self.setup.interpolation == "study":
            above = min(int(np.searchsorted(STUDY_LEVELS, high)), len(STUDY_LEVELS) - 1)
            high = float(STUDY_LEVELS[above])
        return min(LIGHT_PRESSURE, 0.1 * high), high

    def fields(self, material: Material, *, derivatives: bool = False) -> list[Fields]:
        """Nodal displacements at every test's pressures; raises SolveError."""
        paths = self.paths(material, derivatives=derivatives)
        by_stiffness = material.stiffness_derivative() if derivatives else None
        found = []
        for test in self.tests:
            path = paths[test.radius, test.thickness]
            # frames at rest may read slightly below zero
            pressure = np.clip(test.pressure, 0.0, None)
            displacement = self._at(path, pressure)
            derivative = None
            if by_stiffness is not None:
                columns = self._at(path.stiffness_sensitivity, pressure)
                derivative = np.tensordot(by_stiffness.T, columns, 1)
            found.append(Fields(displacement, derivative))
        return found

    def _at(self, field: Callable[[Floats], Floats], pressure: Floats) -> Floats:
        """A path's field (..., frames, n, 3) at the frames' pressures."""
        if self.setup.interpolation == "dense":
            return field(pressure)
        levels = np.concatenate([[0.0], STUDY_LEVELS])
        if pressure.max() > levels[-1]:
            raise InputError("interpolation study: its levels end at 3 bar")
        after = np.clip(np.searchsorted(levels, pressure), 1, len(levels) - 1)
        share = (pressure - levels[after - 1]) / (levels[after] - levels[after - 1])
        needed, place = np.unique(np.concatenate([after - 1, after]), return_inverse=True)
        shapes = field(levels[needed])
        low, high = place[: len(pressure)], place[len(pressure) :]
        share = share[:, None, None]
        return (1 - share) * shapes[..., low, :, :] + share * shapes[..., high, :, :]

    def predict(self, material: Material) -> list[tuple[Floats, ...]]:
        """Displacements at the measured points: per test, one (k, points, 3) array per block."""
        return [
            tuple(
                self.observation(test, block)(fields.displacement[block.frames])
                for block in test.blocks
            )
            for test, fields in zip(self.tests, self.fields(material), strict=True)
        ]


def apex_blocks(test: BulgeTest) -> tuple[Block, ...]:
    """The measured point nearest the centre of each frame, its dz alone (dx, dy NaN)."""
    blocks = []
    for block in test.blocks:
        apex = test.apex[block.frames]
        for point in np.unique(apex[apex >= 0]):
            rows = np.flatnonzero(apex == point)
            displacement = np.full((len(rows), 1, 3), np.nan)
            displacement[:, 0, 2] = block.displacement[rows, point, 2]
            blocks.append(
                Block(block.reference[point : point + 1], block.frames[rows], displacement)
            )
    return tuple(blocks)
