"""Which shapes does a described specimen take at its pressures, and how do they change?

Where the shapes mirror in both axes and only the moduli change, one path of a quarter of the
membrane serves all frames. Otherwise each frame is balanced at its own pressure: between
neighbouring parameter sets it starts from its last shape plus the derivative times the change,
mostly one factorisation a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fem.elasticity import orthotropic_stiffness_derivative
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import Mesh, ellipse
from bulgefit.fem.path import Path
from bulgefit.fem.quarter import Quarter, quarter_of, trace_by_quarter
from bulgefit.model.balancing import LEAST_PRESSURE, Found, Frames, at_rest, of_frame
from bulgefit.model.description import CONSTANTS, Description
from bulgefit.model.forces import Change, Forces
from bulgefit.model.setup import STUDY_LEVELS, Setup
from bulgefit.model.softening import Kept, kept_by, lost_mode
from bulgefit.parallel.threads import side_by_side

__all__ = ["Inflation", "Shapes", "about"]

Floats = NDArray[np.float64]

#: Paths start here (MPa) or at a tenth of the highest pressure; symmetry covers the rest to zero.
LIGHT_PRESSURE = 1e-4
#: Share of the radius by which rounding sets mirror images apart.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Shapes:
    """Balanced shapes at the frames' true pressures for one parameter set.

    Attributes
    ----------
    values : dict
        The parameters.
    displacement : (frames, n, 3) array, mm
        From the stress-free surface.
    derivative : dict of name to (frames, n, 3) array
        By the parameters that change them.
    stable : (frames,) bool array
    wrinkled : (frames,) array or None
        Share of the Gauss points in tension-field relaxation; None where it is not known.
    factorisations : int
        Spent on them, a path that led there included.
    error : float, mm
        Largest estimated error of the path's dense output; 0 where every frame was balanced.
    """

    values: dict[str, float]
    displacement: Floats
    derivative: dict[str, Floats]
    stable: NDArray[np.bool_]
    wrinkled: Floats | None = None
    factorisations: int = 0
    error: float = 0.0


@dataclass(eq=False)
class Inflation:
    """The membranes of one clamp radius and thickness; tests that are alike may share it.

    Parameters
    ----------
    radius, thickness : float, mm
    ellipticity : float
        Semi-axes of the clamp over its radius, less 1, + along x.
    highest : float, MPa
        Pressure up to which paths are traced.
    setup : Setup
    """

    radius: float
    thickness: float
    highest: float
    setup: Setup
    ellipticity: float = 0.0
    mesh: Mesh = field(init=False)
    _like: dict[bool, Membrane] = field(init=False, default_factory=dict, repr=False)
    _path: tuple[object, Description, Path] | None = field(init=False, default=None, repr=False)
    _found: dict[int, Found] | None = field(init=False, default=None, repr=False)

    def __post_init__(self) -> None:
        self.mesh = self.setup.mesh or ellipse(self.radius, self.ellipticity, self.setup.refine)
        if self.highest <= 0.0:
            raise InputError("no frame has a positive pressure")

    @classmethod
    def of(cls, tests: Sequence[BulgeTest], setup: Setup) -> Inflation:
        """Of tests of one clamp and thickness; InputError for a mesh of another clamp."""
        highest = max(float(test.pressure.max()) for test in tests)
        first = tests[0]
        made = cls(first.radius, first.thickness, highest, setup, first.ellipticity)
        rim = np.hypot(*(made.mesh.nodes[made.mesh.rim] / first.stretch).T)
        if np.abs(rim / first.radius - 1).max() > 1e-3:
            if first.ellipticity:
                a, b = first.semi_axes
                raise InputError(f"mesh: its rim is not the clamp's, of semi-axes {a:g}, {b:g} mm")
            raise InputError(
                f"mesh: its rim lies {rim.min():.6g} to {rim.max():.6g} mm from the centre (0, 0), "
                f"the clamp at {first.radius:g} mm; give a mesh of that disc"
            )
        return made

    def __getstate__(self) -> dict[str, object]:
        # what is as soon made as sent is made again
        return {**self.__dict__, "_like": {}, "_path": None, "_found": None}

    def membrane(self, given: Description, beside: Membrane | None = None) -> Membrane:
        """The membrane of a description, sharing the linear solver with those alike.

        And its surface with the one beside, where it lies as that.
        """
        slips = given.fabric.compliance is not None
        if beside is None or (beside.fabric.compliance is not None) != slips:
            beside = self._like.get(slips)
        made = Membrane(
            self.mesh,
            self.thickness,
            self.setup.law,
            relaxation=self.setup.relaxation,
            angle=given.angle,
            solver=self.setup.linear_solver,
            fabric=given.fabric,
            like=beside,
        )
        self._like.setdefault(slips, made)
        return made

    @contextmanager
    def remembering(self) -> Iterator[None]:
        """Balance no frame twice from one guess within the block: 3.5 MB are kept of each.

        As where the same shape is differentiated by other parameters, which are absent in it.
        """
        outer = self._found
        self._found = {} if outer is None else outer
        try:
            yield
        finally:
            self._found = outer

    def path(self, given: Description, values: Mapping[str, float], sensitivities: bool) -> Path:
        """The path of a specimen up to the highest pressure of all; the last one is kept.

        It is taken again for the very same path alone: one that was traced further, or with
        sensitivities, differs by the solver's tolerance, and results would tell what came before.
        """
        high = max(self.highest, float(np.max(given.load.balanced)))
        key = given.law_parameters, high, sensitivities
        kept = self._path  # read once: a descent in another thread may put its own here
        if kept is not None and kept[0] == key and kept[1].lies_as(given):
            return kept[2]
        if self.setup.interpolation == "study":
            above = min(int(np.searchsorted(STUDY_LEVELS, high)), len(STUDY_LEVELS) - 1)
            high = float(STUDY_LEVELS[above])
        path = trace_by_quarter(
            self.membrane(given),
            given.stiffness,
            (min(LIGHT_PRESSURE, 0.1 * high), high),
            tolerance=self.setup.tolerance,
            sensitivities=sensitivities,
            parameters=values,
            beyond_ellipticity=True,
        )
        self._path = key, given, path
        return path

    def along_path(
        self, given: Description, values: dict[str, float], changes: Mapping[str, Change]
    ) -> Shapes:
        """Shapes of a plain specimen that only the material's constants and the load change."""
        constants = [name for name in changes if name in CONSTANTS]
        pressure = np.maximum(given.load.balanced, 0.0)
        path = self.path(given, values, bool(constants))
        derivative: dict[str, Floats] = {}
        if constants:
            by_stiffness = orthotropic_stiffness_derivative(*(values[name] for name in CONSTANTS))
            columns = self._at(path.stiffness_sensitivity, pressure)
            by_constant = dict(
                zip(CONSTANTS, np.tensordot(by_stiffness.T, columns, 1), strict=True)
            )
            derivative |= {name: by_constant[name] for name in constants}
        loads = {name: change.rate for name, change in changes.items() if name not in CONSTANTS}
        if loads:
            by_pressure = self._by_pressure(path, pressure)
            # as in `balanced`: what is not inflated lies still
            by_pressure[at_rest(np.asarray(given.load.balanced))] = 0.0
            derivative |= {n: rate[:, None, None] * by_pressure for n, rate in loads.items()}
        at = np.minimum(np.searchsorted(path.pressure, pressure), len(path.pressure) - 1)
        first = int(np.argmin(path.stable)) if not path.stable.all() else len(path.stable)
        shapes = self._at(path, pressure)
        wrinkled = path.wrinkled[at] / (4.0 * len(path.cells))
        return Shapes(
            values, shapes, derivative, at < first, wrinkled,
            factorisations=path.factorisations, error=path.error_estimate,
        )  # fmt: skip

    def _by_pressure(self, path: Path, pressure: Floats) -> Floats:
        """∂u/∂p (frames, n, 3) mm/MPa, by a difference of the dense output in p^(1/3)."""
        s = np.cbrt(np.maximum(pressure, LEAST_PRESSURE))
        h = 1e-4 * s
        top = float(path.pressure[-1])
        low, high = (s - h) ** 3, np.minimum((s + h) ** 3, top)
        return np.asarray((path(high) - path(low)) / (high - low)[:, None, None])

    def _at(self, of: Callable[[Floats], Floats], pressure: Floats) -> Floats:
        """A path's field (..., frames, n, 3) at the frames' pressures."""
        if self.setup.interpolation == "dense":
            return of(pressure)
        levels = np.concatenate([[0.0], STUDY_LEVELS])
        if pressure.max() > levels[-1]:
            raise InputError("interpolation study: its levels end at 3 bar")
        after = np.clip(np.searchsorted(levels, pressure), 1, len(levels) - 1)
        share = (pressure - levels[after - 1]) / (levels[after] - levels[after - 1])
        needed, place = np.unique(np.concatenate([after - 1, after]), return_inverse=True)
        shapes = of(levels[needed])
        low, high = place[: len(pressure)], place[len(pressure) :]
        share = share[:, None, None]
        return np.asarray((1 - share) * shapes[..., low, :, :] + share * shapes[..., high, :, :])

    def balanced(
        self,
        given: Description,
        values: dict[str, float],
        changes: Mapping[str, Change],
        starts: Floats | None,
        threads: int,
        *,
        within: bool = False,
    ) -> Shapes:
        """Every frame balanced at its own pressure; raises SolveError.

        Parameters
        ----------
        starts : (k, frames, n, 3) array, mm, or None
            Displacements near balance, the likeliest first; default: those of a rough path.
        within : bool
            That path goes no further than it is stable.
        """
        membrane = self.membrane(given)
        pressure = np.maximum(np.asarray(given.load.balanced, dtype=float), LEAST_PRESSURE)
        work, loose = 0, False
        if starts is None:
            starts, work = self._starts(membrane, given, pressure, values, within=within)
            loose = membrane.fabric.lies_loosely
        starts[:, :, membrane.fixed] = 0.0
        if given.edge is not None:
            rim = self.mesh.rim
            starts[:, :, rim] = np.where(membrane.fixed[rim], given.edge, starts[:, :, rim])
        quarter = self._mirrored(membrane, given, changes, starts)
        part = membrane if quarter is None else quarter.even
        forces = Forces(part, given, changes, self.membrane) if changes else None
        # frame by frame into their places: they are hundreds of megabytes where fields are free
        derivative = np.empty((len(changes), *starts.shape[1:]))
        each = Frames(
            given, values, membrane, quarter, forces, starts, derivative, loose, self._found
        )
        found = side_by_side(each.balanced, range(len(pressure)), threads)
        return Shapes(
            values,
            np.array([frame.displacement for frame in found]),
            dict(zip(changes, derivative, strict=True)),
            np.array([frame.stable for frame in found]),
            np.array([frame.wrinkled for frame in found]) / (4.0 * len(self.mesh.cells)),
            factorisations=work + sum(frame.factorisations for frame in found),
        )

    def lost_mode(self, given: Description, shapes: Shapes, frame: int) -> Floats | None:
        """The mode (n, 3) in which the shape of a frame gives way; None where it does not."""
        own = of_frame(self.membrane(given), given, frame)
        pressure = max(float(given.load.balanced[frame]), LEAST_PRESSURE)
        return lost_mode(own, shapes.displacement[frame], pressure, given.stiffness)

    def kept_by(
        self,
        given: Description,
        changes: Mapping[str, Change],
        shapes: Shapes,
        frame: int,
        mode: Floats,
    ) -> Kept:
        """What keeps the shape of a frame from a mode (n, 3), by parameters of its derivatives."""
        membrane = self.membrane(given)
        return kept_by(
            of_frame(membrane, given, frame),
            Forces(membrane, given, changes, self.membrane),
            shapes.displacement[frame],
            max(float(given.load.balanced[frame]), LEAST_PRESSURE),
            given.stiffness,
            frame,
            {name: shapes.derivative[name][frame] for name in changes},
            mode,
        )

    def _mirrored(
        self,
        membrane: Membrane,
        given: Description,
        changes: Mapping[str, Change],
        starts: Floats,
    ) -> Quarter | None:
        """The quarter that starts (..., n, 3) are the images of, where all that changes keeps them.

        They are where a path of the quarter led to them.
        """
        moves = given.edge is not None or given.eased is not None
        if moves or not all(change.of_law and change.mirrors for change in changes.values()):
            return None
        quarter = quarter_of(membrane)
        if quarter is None:
            return None
        apart = float(np.abs(quarter.whole(starts[..., quarter.kept, :]) - starts).max())
        return quarter if apart <= _ROUNDING * self.radius else None

    def _starts(
        self,
        membrane: Membrane,
        given: Description,
        pressure: Floats,
        values: dict[str, float],
        *,
        within: bool,
    ) -> tuple[Floats, int]:
        """Displacements (3, frames, n, 3) to begin from, and their path's factorisations.

        Without interpolation it is the path of dense output, which is asked for beside the shapes;
        else a rough one.
        """
        if self.setup.interpolation == "none":
            path = self.path(given, values, sensitivities=False)
        else:
            low, high = float(pressure.min()), float(pressure.max())
            path = trace_by_quarter(
                membrane if given.eased is None else membrane.eased(float(given.eased.mean())),
                given.stiffness,
                (min(low, 0.5 * high), high),
                tolerance=0.05,
                parameters=values,
                beyond_ellipticity=not within,
            )
        starts = about(path, pressure)
        if given.edge is not None:
            # what the rim does fades towards the centre
            starts += np.einsum("fri,rn->fni", given.edge, _faded(self.mesh))
        return starts, path.factorisations


def about(path: Path, pressure: Floats) -> Floats:
    """A path's shapes (3, frames, n, 3) mm at pressures (frames,), and its levels about them."""
    within = pressure.clip(path.pressure[0], path.pressure[-1])
    above = np.searchsorted(path.pressure, within).clip(1, len(path.pressure) - 1)
    return np.stack([path(within), path.displacement[above - 1], path.displacement[above]])


def _faded(mesh: Mesh) -> Floats:
    """Weights (rim, n) that carry the rim's motion inwards, as (r/a)⁴ of the nearest rim nodes."""
    rim = mesh.nodes[mesh.rim]
    angle = np.arctan2(rim[:, 1], rim[:, 0])
    radius = np.hypot(*mesh.nodes.T) / np.hypot(*rim.T).max()
    turn = np.arctan2(mesh.nodes[:, 1], mesh.nodes[:, 0]) - angle[:, None]
    nearest = np.argmax(np.cos(turn), axis=0)
    out = np.zeros((len(rim), len(mesh.nodes)))
    out[nearest, np.arange(len(mesh.nodes))] = radius**4
    return out
