"""One specimen under all five places: displacements as the camera reports them, and derivatives.

Where the fit of moduli asks for objectives at thousands of points, the diagnosis asks for the
derivative of every measured value by every parameter. So shapes are balanced at the frames' own
pressures, and between neighbouring parameter sets each frame starts from its last shape plus the
derivative times the change: mostly one factorisation a frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import SolveError
from bulgefit.fem.clamp import LEAST_COMPLIANCE
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import Equilibrium, NewtonError, solve
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.trace import trace
from bulgefit.model.camera import (
    CAMERA,
    POINTS,
    camera_derivative,
    material_points,
    pressure_derivative,
    seen,
    through,
)
from bulgefit.model.places import (
    CONSTANTS,
    KNEE,
    LAW,
    LOAD,
    MECHANICS,
    applied_derivative,
    applied_pressure,
    balanced_derivative,
    balanced_pressure,
    fabric_of,
    law_of,
    semi_axes,
)
from bulgefit.model.smooth import SmoothField, smooth_field
from bulgefit.model.window import Window
from bulgefit.parallel.threads import side_by_side

__all__ = ["Prediction", "Shapes", "Specimen"]

Floats = NDArray[np.float64]

#: Differences of the out-of-balance force by a parameter: half the step.
_STEPS = {
    "E1": 1e-2,
    "E2": 1e-2,
    "G12": 1e-3,
    "axis_misalignment.angle": 1e-2,
    "nonlinear_material.k_x": 1e-2,
    "nonlinear_material.k_y": 1e-2,
    "nonlinear_material.s_x": 1e-3,
    "nonlinear_material.s_y": 1e-3,
    "nonlinear_material.knee_x": 1e-5,
    "nonlinear_material.knee_y": 1e-5,
}
_LENGTH_STEP, _RATIO_STEP = 1e-3, 1e-5


@dataclass(frozen=True, eq=False)
class Shapes:
    """Balanced shapes at the frames' true pressures for one parameter set.

    Attributes
    ----------
    values : dict
        The parameters.
    pressure : (frames,) array, MPa
        True.
    displacement : (frames, n, 3) array, mm
    derivative : dict of name to (frames, n, 3) array
        By the mechanical and load parameters that were asked for.
    stable : (frames,) bool array
    """

    values: dict[str, float]
    pressure: Floats
    displacement: Floats
    derivative: dict[str, Floats]
    stable: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Reported displacements and their derivatives.

    Attributes
    ----------
    displacement : (frames, points, 3) array, mm
    derivative : (parameters, frames, points, 3) array
    shapes : Shapes
    """

    displacement: Floats
    derivative: Floats
    shapes: Shapes


@dataclass(eq=False)
class Specimen:
    """A test whose every effect can be varied.

    Parameters
    ----------
    test : BulgeTest
        Of one block.
    refine : int
        Of the mesh.
    law : str
    threads : int
        Frames that are balanced side by side; the result does not depend on it.
    """

    test: BulgeTest
    refine: int = 4
    law: str = "hencky"
    threads: int = 1
    correction: Floats | None = None
    _membrane: Membrane | None = field(default=None, repr=False)
    _window: Window | None = field(default=None, repr=False)
    _points: dict[tuple[float, ...], tuple[SmoothField, SmoothField]] = field(
        default_factory=dict, repr=False
    )

    def __post_init__(self) -> None:
        (block,) = self.test.blocks
        self.reference = np.asarray(block.reference, dtype=np.float64)
        self.measured = block.displacement
        self.recorded = np.asarray(self.test.pressure, dtype=np.float64)
        self.time = None if self.test.time is None else np.asarray(self.test.time, np.float64)
        self.mesh = disc(self.test.radius, self.refine)

    def __reduce__(self) -> tuple[Any, ...]:
        # what comes from the test, or is as soon made as sent, is made again; the window is not
        known = self.test, self.refine, self.law, self.threads, self.correction
        return Specimen, (*known, None, self._window)

    def nulls(self) -> dict[str, float]:
        """The parameters of the baseline: everything unmodelled at its null."""
        knees = dict.fromkeys(("nonlinear_material.knee_x", "nonlinear_material.knee_y"), KNEE)
        return {"poisson_ratio.nu12": self.test.poisson_ratio, **knees}

    def membrane(self, values: Mapping[str, float]) -> Membrane:
        """The membrane of a parameter set, sharing the linear solver."""
        made = Membrane(
            self.mesh,
            self.test.thickness,
            self.law,
            angle=np.deg2rad(values.get("axis_misalignment.angle", 0.0)),
            fabric=fabric_of(self.mesh, self.test.radius, values),
            like=self._membrane,
        )
        if self._membrane is None:
            self._membrane = made
        return made

    def shapes(
        self,
        values: Mapping[str, float],
        names: Iterable[str] = (),
        near: Shapes | None = None,
    ) -> Shapes:
        """Balance every frame; derivatives by `names` (mechanical and load ones are used).

        Parameters
        ----------
        values : mapping
            E1, E2, G12 (MPa) and any effect's parameters.
        near : Shapes, optional
            Of a neighbouring parameter set, with derivatives: the start.

        Raises
        ------
        SolveError
        """
        given = {**self.nulls(), **values}
        membrane = self.membrane(given)
        stiffness = _stiffness(given)
        pressure = np.maximum(balanced_pressure(self.recorded, self.time, given), 1e-6)
        guesses = self._guesses(membrane, stiffness, pressure, given, near)
        names = list(names)
        forces = _Forces(self, given, [name for name in names if name in MECHANICS])
        load = {
            name: balanced_derivative(name, self.recorded, self.time, given)
            for name in names
            if name in LOAD
        }

        def balanced(frame: int) -> tuple[Floats, bool, Floats]:
            """Shape, whether it is stable, and fields (columns, n, 3) by `forces` and pressure."""
            balance = _solved(membrane, guesses[frame], pressure[frame], stiffness, given)
            columns = forces.at(balance)
            columns += [-membrane.pressure_force(balance.displacement)] if load else []
            if not columns:
                return balance.displacement, balance.stable, np.empty((0, *guesses[0].shape))
            solved = balance.factor.solve(np.asfortranarray(-np.stack(columns, axis=1)))
            fields = membrane.spread(np.ascontiguousarray(solved.T))
            return balance.displacement, balance.stable, fields

        shapes, stable, fields = zip(
            *side_by_side(balanced, range(len(pressure)), self.threads), strict=True
        )
        derivative = {
            name: np.array([field[place] for field in fields])
            for place, name in enumerate(forces.names)
        }
        for name, slope in load.items():
            by_pressure = np.array([field[-1] for field in fields])
            derivative[name] = slope[:, None, None] * by_pressure
        return Shapes(given, pressure, np.array(shapes), derivative, np.array(stable))

    def _guesses(
        self,
        membrane: Membrane,
        stiffness: Floats,
        pressure: Floats,
        values: dict[str, float],
        near: Shapes | None,
    ) -> Floats:
        """Displacements (frames, n, 3) near balance: from a neighbour, or from a rough path."""
        if near is not None:
            return near.displacement + sum(
                (
                    (values.get(name, 0.0) - near.values.get(name, 0.0)) * change
                    for name, change in near.derivative.items()
                ),
                np.zeros_like(near.displacement),
            )
        low, high = float(pressure.min()), float(pressure.max())
        path = trace(
            membrane,
            stiffness,
            (min(low, 0.5 * high), high),
            tolerance=0.05,
            parameters=values,
            beyond_ellipticity=True,
        )
        low, high = path.pressure[0], path.pressure[-1]
        return np.array([path(min(max(p, low), high))[0] for p in pressure])

    def predict(
        self,
        values: Mapping[str, float],
        names: Sequence[str] = (),
        near: Shapes | None = None,
    ) -> Prediction:
        """Reported displacements, with derivatives by `names` in order; raises SolveError."""
        shapes = self.shapes(values, names, near)
        return self.observe(shapes, names)

    def observe(self, shapes: Shapes, names: Sequence[str] = ()) -> Prediction:
        """What the camera reports of given shapes."""
        given = shapes.values
        averaged, plain = self._operators(given)
        moved = _apply(averaged.value, shapes.displacement)
        applied = np.maximum(applied_pressure(self.recorded, given), 1e-6)
        place = (self.reference, applied, self.test.radius, given)
        displacement = seen(moved, *place)
        if self.correction is not None:
            displacement = displacement + self.correction
        rows = np.empty((len(names), *displacement.shape))
        for row, name in zip(rows, names, strict=True):
            row[:] = 0.0
            if name in shapes.derivative:
                row += through(_apply(averaged.value, shapes.derivative[name]), applied, given)
            if name in LOAD:
                by_name = applied_derivative(name, self.recorded, given)
                row += by_name[:, None, None] * pressure_derivative(moved, *place)
            if name in CAMERA and name != "dic_smoothing.window":
                row += camera_derivative(name, moved, *place)
            motion = self._point_motion(name, given)
            if motion is not None:
                by_x = _apply(averaged.by_x, shapes.displacement)
                by_y = _apply(averaged.by_y, shapes.displacement)
                change = motion[:, :1] * by_x + motion[:, 1:] * by_y
                row += through(change, applied, given)
            if name == "dic_smoothing.window":
                row += through(self._window_derivative(shapes, plain), applied, given)
        return Prediction(displacement, rows, shapes)

    def _unit_points(self, values: Mapping[str, float]) -> Floats:
        """Measured points on the mesh (its circle, mm): the oval rim is mapped back."""
        return material_points(self.reference, values) / semi_axes(values)

    def _operators(self, values: Mapping[str, float]) -> tuple[SmoothField, SmoothField]:
        """Operators at the measured points: averaged over the window, and not."""
        key = tuple(
            values.get(name, 0.0)
            for name in (
                *POINTS,
                "clamp_shape.ellipticity",
                "clamp_shape.radius_error",
                "dic_smoothing.window",
            )
        )
        found = self._points.get(key)
        if found is None:
            points = self._unit_points(values)
            plain = smooth_field(self.mesh.nodes, points)
            window = key[-1]
            mean = self._window_of_mesh().mean(points, window) if window > 0.0 else plain
            found = mean, plain
            if len(self._points) > 8:
                self._points.clear()
            self._points[key] = found
        return found

    def _window_of_mesh(self) -> Window:
        if self._window is None:
            self._window = Window(self.mesh.nodes, self.test.radius)
        return self._window

    def _window_derivative(self, shapes: Shapes, plain: SmoothField) -> Floats:
        """∂/∂(window²) of the averaged field, (frames, n, 3): by a difference in window²."""
        at = shapes.values.get("dic_smoothing.window", 0.0) ** 2
        points = self._unit_points(shapes.values)
        window = self._window_of_mesh()
        high = window.value(points, float(np.sqrt(at + 4.0)))
        low = window.value(points, float(np.sqrt(at - 4.0))) if at > 4.0 else plain.value
        span = 8.0 if at > 4.0 else at + 4.0
        return (_apply(high, shapes.displacement) - _apply(low, shapes.displacement)) / span

    def _point_motion(self, name: str, values: Mapping[str, float]) -> Floats | None:
        """∂(points on the mesh)/∂(a parameter), (n, 2); None where they stay."""
        axes = semi_axes(values)
        if name in ("registration.x0", "registration.y0"):
            out = np.zeros((len(self.reference), 2))
            column = 0 if name.endswith("x0") else 1
            out[:, column] = -1.0 / axes[column]
            return out
        if name == "dic_scale.scale":
            return -self.reference[:, :2] / (1.0 + values.get(name, 0.0)) ** 2 / axes
        if name in ("clamp_shape.ellipticity", "clamp_shape.radius_error"):
            step = 1e-6
            up, down = dict(values), dict(values)
            up[name] = values.get(name, 0.0) + step
            down[name] = values.get(name, 0.0) - step
            return (self._unit_points(up) - self._unit_points(down)) / (2 * step)
        return None


class _Forces:
    """∂R/∂(mechanical parameters) at fixed displacement, by differences of R."""

    def __init__(self, specimen: Specimen, values: dict[str, float], names: list[str]) -> None:
        self.names = names
        self._membrane = specimen.membrane(values)
        self._law = [name for name in names if name in LAW]
        steps = [_step(name) for name in self._law]
        self._before, self._after = (
            np.array(
                [
                    _law_parameters({**values, name: values.get(name, 0.0) + sign * step})
                    for name, step in zip(self._law, steps, strict=True)
                ]
            )
            for sign in (-1.0, 1.0)
        )
        self._spans = 2.0 * np.array(steps)
        self._others = {n: _Difference(specimen, values, n) for n in names if n not in LAW}

    def at(self, balance: Equilibrium) -> list[Floats]:
        """(N,) arrays at a balance, one for each name."""
        found = {name: one.force(balance) for name, one in self._others.items()}
        if self._law:
            changes = self._membrane.law_changes(balance.displacement, self._before, self._after)
            found |= dict(zip(self._law, changes / self._spans[:, None], strict=True))
        return [found[name] for name in self.names]


def _step(name: str) -> float:
    return _STEPS.get(name, _LENGTH_STEP if name.startswith("initial_shape") else _RATIO_STEP)


def _law_parameters(values: Mapping[str, float]) -> tuple[float, ...]:
    return law_of(values).law_parameters(_stiffness(values))


class _Difference:
    """∂R/∂(a parameter of shape or clamp) at fixed displacement, by two assemblies."""

    def __init__(self, specimen: Specimen, values: dict[str, float], name: str) -> None:
        self._scale = 1.0
        step = _step(name)
        here = values.get(name, 0.0)
        low, high = here - step, here + step
        if name == "clamp_slip.compliance":
            # to one side, since there is none below the least; exact, as the force goes with 1/c
            low = max(here, LEAST_COMPLIANCE)
            high = low * (1 + 1e-3)
            self._scale = high / low
        pairs = [{**values, name: v} for v in (low, high)]
        self._membranes = tuple(specimen.membrane(v) for v in pairs)
        self._stiffness = tuple(_stiffness(v) for v in pairs)
        self._span = high - low

    def force(self, balance: Equilibrium) -> Floats:
        """(N,) array at the balance."""
        low, high = (
            m.state(balance.displacement, balance.pressure, q, tangent=False).residual
            for m, q in zip(self._membranes, self._stiffness, strict=True)
        )
        return self._scale * (high - low) / self._span


def _solved(
    membrane: Membrane, guess: Floats, pressure: float, stiffness: Floats, values: dict[str, float]
) -> Equilibrium:
    """Balance one frame; raises SolveError."""
    try:
        return solve(membrane, guess, float(pressure), stiffness, follow=True)
    except NewtonError as error:
        raise SolveError(
            f"no equilibrium near the last shape: {error.reason}",
            pressure=float(pressure),
            reached=float(pressure),
            iteration=error.iteration,
            residual_norm=error.residual_norm,
            parameters=values,
        ) from error


def _stiffness(values: Mapping[str, float]) -> Floats:
    e1, e2, g12, nu12 = (values[name] for name in CONSTANTS)
    return orthotropic_stiffness(e1, e2, g12, nu12)


def _apply(operator: object, nodal: Floats) -> Floats:
    """Sparse (points, nodes) operator on (frames, n, 3) fields."""
    frames, n, _ = nodal.shape
    flat = np.moveaxis(nodal, 1, 0).reshape(n, frames * 3)
    return np.moveaxis((operator @ flat).reshape(-1, frames, 3), 0, 1)  # type: ignore[operator]
