"""The virtual bulge test: parameters to displacements as the cameras would report them.

    parameters -> the effects' hooks fill the five places (`description`)
               -> the membrane balances each frame's pressure (`inflation`)
               -> the cameras see the cloth's face (`face`)
               -> the field is read at the measured points (`observation`, `window`)
               -> the cameras' hooks make of it what is reported (`camera`)

with the derivative of every reported value by every parameter that is asked for: what a parameter
does in each place is told by differences of that place alone, so an effect needs no more than its
hooks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import ends_about
from bulgefit.effects.places import Clock, Load
from bulgefit.effects.registry import acts_through, effect_named, own_values
from bulgefit.errors import InputError
from bulgefit.fem.mesh import Mesh
from bulgefit.model.camera import (
    Places,
    face_of,
    heights_seen,
    place,
    window_of,
)
from bulgefit.model.coarse import balanced_where_coarse
from bulgefit.model.description import (
    CONSTANTS,
    Active,
    Description,
    Values,
    active_effects,
    check_needs,
    checked,
    describe,
    gauss_points,
    load_on,
    null_values,
    surface_of,
    with_value,
)
from bulgefit.model.face import Face
from bulgefit.model.forces import Change
from bulgefit.model.inflation import Inflation, Shapes
from bulgefit.model.observation import Operators, operators
from bulgefit.model.opening import Opening
from bulgefit.model.setup import Setup
from bulgefit.model.sight import PLACING, Prediction, Sight
from bulgefit.model.smooth import smooth_field
from bulgefit.model.softening import Kept
from bulgefit.model.window import Window

__all__ = ["VirtualTest", "virtual_tests"]

Floats = NDArray[np.float64]

#: Sets of operators at the points that are kept: points that move make new ones.
_KEPT = 8
#: Of a modulus, the largest part by which a difference steps: it stays above zero, however soft.
_SOFT = 1e-3
#: Hooks that change shapes.
_SHAPING = ("outline", "height", "clamp", "material", "load")


class VirtualTest:
    """The virtual twin of a measured test, with every effect at hand.

    Parameters
    ----------
    test : BulgeTest
    setup : Setup, optional
    threads : int
        Frames that are balanced side by side; the result does not depend on it.
    inflation : Inflation, optional
        Shared with tests of the same clamp and thickness.
    held : mapping of str to float, optional
        Parameters (`effect.parameter`) that are known: they are so wherever they are not given.

    Attributes
    ----------
    correction : (frames, n, 3) array, mm, or None
        The mesh's error, taken off the nodes (see `bulgefit.model.mesh_error`).
    """

    def __init__(
        self,
        test: BulgeTest,
        setup: Setup | None = None,
        threads: int = 1,
        inflation: Inflation | None = None,
        held: Values | None = None,
    ) -> None:
        self.test, self.setup, self.threads = test, setup or Setup(), threads
        self.held = dict(held or {})
        self.inflation = inflation or Inflation.of([test], self.setup)
        self.mesh = self.inflation.mesh
        # where fields are read: stencils of a mesh that is stretched are no good ones
        self.circle = Mesh(test.on_circle(self.mesh.nodes), self.mesh.cells)
        self.recorded = np.asarray(test.pressure, dtype=np.float64)
        self.clock = _clock(test)
        self.correction: Floats | None = None
        self._window: Window | None = None
        self._operators: dict[object, tuple[Operators, Places]] = {}

    def __getstate__(self) -> dict[str, Any]:
        # what comes from the test, or is as soon made as sent, is made again
        state = {**self.__dict__, "_operators": {}}
        state.pop("gradients", None)
        return state

    def nulls(self) -> dict[str, float]:
        """Values at which the effects are absent where that is the test's own."""
        return null_values(self.test.poisson_ratio)

    def shapes(
        self,
        values: Values,
        names: Iterable[str] = (),
        near: Shapes | None = None,
        *,
        within: bool = False,
    ) -> Shapes:
        """Balance every frame.

        Parameters
        ----------
        values : mapping
            E1, E2, G12 (MPa) and any effect's parameters; nu12 is the test's unless given.
        names : iterable of str
            Parameters to differentiate by; those of the cameras change no shape.
        near : Shapes, optional
            Of a neighbouring parameter set, with derivatives: the start.
        within : bool
            Give up a path from rest where it loses stability, instead of going on beyond that.

        Raises
        ------
        InputError
            Unknown names, constants that are not admissible, or an effect that needs what the test
            has not.
        SolveError
        """
        given = self.given(values)
        checked([*given, *names])
        check_needs(given, self.test)
        here, changes = self._described(given, names)
        constant = all(name in CONSTANTS or c.of_law for name, c in changes.items())
        same = all(
            name in CONSTANTS or c.below.law_parameters == c.above.law_parameters
            for name, c in changes.items()
        )
        straight = here.fabric.is_straight
        straight = straight or not any(name in CONSTANTS for name in changes)
        along = self.setup.interpolation != "none"
        if along and here.is_plain and constant and same and straight:
            found = self.inflation.along_path(here, given, changes)
            if self.setup.interpolation == "study":
                return found
            return balanced_where_coarse(self.inflation, found, here, changes, self.threads)
        if self.setup.interpolation == "study":
            raise InputError("the study's way knows no effects beside the moduli")
        starts = None if near is None else self._ahead(near, given)[None]
        return self.inflation.balanced(here, given, changes, starts, self.threads, within=within)

    def lost_mode(self, shapes: Shapes, frame: int) -> Floats | None:
        """The mode (n, 3) in which the shape of a frame gives way; None where it does not."""
        here, _ = self._described(self.given(shapes.values), ())
        return self.inflation.lost_mode(here, shapes, frame)

    def kept_by(self, shapes: Shapes, names: Iterable[str], frame: int, mode: Floats) -> Kept:
        """What keeps the shape of a frame from a mode (n, 3), by those of names that change it.

        Parameters
        ----------
        shapes : Shapes
            With derivatives by the names.
        """
        here, changes = self._described(self.given(shapes.values), names)
        return self.inflation.kept_by(here, changes, shapes, frame, mode)

    def given(self, values: Values) -> dict[str, float]:
        """Values with what is held, and the test's own Poisson's ratio, where they have none."""
        return {"nu12": self.test.poisson_ratio, **self.held, **values}

    def _ahead(self, near: Shapes, values: Values) -> Floats:
        """Displacements (frames, n, 3) that a neighbour's derivatives lead to."""
        guess = near.displacement.copy()
        for name, change in near.derivative.items():
            step = self.value(name, values) - self.value(name, near.values)
            if step != 0.0:
                guess += step * change
        return guess

    def _described(
        self, values: Values, names: Iterable[str]
    ) -> tuple[Description, dict[str, Change]]:
        """What the values describe, and how that changes with the names that change it."""
        slips, active = False, active_effects(values, self.nulls())
        own = [name for name in names if _of_fabric(name)]
        thickening = self._thickening(own, active)
        while True:
            here = self._describe(values, active, slips=slips)
            changes = {
                n: Change(here, here, 1.0, thickening[n])
                if n in thickening
                else self._change(n, values, active, here, slips)
                for n in own
            }
            every = [here, *(d for c in changes.values() for d in (c.below, c.above))]
            # of a rim that is held and one that gives there is no difference
            if slips or len({d.fabric.compliance is None for d in every}) == 1:
                break
            slips = True
        return here, {
            name: change
            for name, change in changes.items()
            if not change.of_law
            or change.rate.any()
            or change.below.law_parameters != change.above.law_parameters
        }

    def _thickening(self, names: Iterable[str], active: Active) -> dict[str, Floats]:
        """∂ ln(thickness)/∂(name) at the Gauss points, (m, 4), of names of which that is known."""
        own_of = {effect.id: own for effect, own in active}
        out = dict[str, Floats]()
        for id_ in dict.fromkeys(name.partition(".")[0] for name in names if "." in name):
            effect = effect_named(id_)
            own = own_of.get(id_) or own_values(effect, {}, self.nulls())
            found = effect.thickening(own, gauss_points(self.mesh, self.test.semi_axes))
            out |= {f"{id_}.{name}": rate for name, rate in found.items()}
        return out

    def _describe(
        self,
        values: Values,
        active: Active,
        *,
        slips: bool,
        beside: Description | None = None,
        hooks: Iterable[str] = (),
    ) -> Description:
        test = self.test
        return describe(
            self.mesh, test.radius, self.recorded, self.clock, values, active,
            slips=slips, stretch=test.stretch, warp=test.warp_angle, beside=beside, hooks=hooks,
        )  # fmt: skip

    def description(self, values: Values) -> Description:
        """The specimen in its clamp under its load."""
        given = self.given(values)
        return self._describe(given, active_effects(given, self.nulls()), slips=False)

    def load(self, values: Values) -> Load:
        """Recorded, true and balanced pressures."""
        active = active_effects(self.given(values), self.nulls())
        return load_on(self.recorded, self.clock, active)

    def _change(
        self, name: str, values: Values, active: Active, here: Description, slips: bool
    ) -> Change:
        ends, nulls = self.span(name, values), self.nulls()
        hooks = (
            ["material"] if name in CONSTANTS else [h for h in _SHAPING if acts_through(name, h)]
        )
        below, above = (
            self._describe(
                {**values, name: value},
                active if name in CONSTANTS else with_value(active, name, value, nulls),
                slips=slips, beside=here, hooks=hooks,
            )
            for value in ends
        )  # fmt: skip
        return Change(below, above, ends[1] - ends[0])

    def span(self, name: str, values: Values) -> tuple[float, float]:
        """Values below and above a parameter's."""
        if name in CONSTANTS:
            step = CONSTANTS[name]
            if name != "nu12":
                step = min(step, _SOFT * values[name])
            return ends_about(values[name], step)
        effect, _, parameter = name.partition(".")
        return effect_named(effect).span(parameter, self.value(name, values))

    def value(self, name: str, values: Values) -> float:
        """A parameter's, or its null."""
        if name in values:
            return values[name]
        effect, _, parameter = name.partition(".")
        null = effect_named(effect).parameter(parameter).null
        return self.nulls()[name] if null is None else null

    def predict(
        self,
        values: Values,
        names: Sequence[str] = (),
        near: Shapes | None = None,
        block: int = 0,
    ) -> Prediction:
        """Reported displacements, with derivatives by `names` in order; raises SolveError."""
        return self.observe(self.shapes(values, names, near), names, block)

    def observe(
        self,
        shapes: Shapes,
        names: Sequence[str] = (),
        block: int = 0,
        points: slice | NDArray[np.intp] | None = None,
    ) -> Prediction:
        """What the cameras report of given shapes, in a block of the test.

        Parameters
        ----------
        points : slice or int array, optional
            Some of the block's points.
        """
        return self.sight(shapes, names, block, points).prediction()

    def sight(
        self,
        shapes: Shapes,
        names: Sequence[str] = (),
        block: int = 0,
        points: slice | NDArray[np.intp] | None = None,
    ) -> Sight:
        """As `observe`, with derivatives that are worked out when they are asked for."""
        return Sight(self, shapes, names, block, points)

    def heights(
        self, values: Values, names: Sequence[str] = (), block: int = 0
    ) -> tuple[Floats, Floats]:
        """Heights (n,) mm before inflation as the cameras report them, but for a plane.

        Also their derivatives (names, n): by values.
        """
        reference = np.asarray(self.test.blocks[block].reference, dtype=np.float64)
        nulls, radius, values = self.nulls(), self.test.radius, self.given(values)
        places = self.place(reference, active_effects(values, nulls))

        def seen(name: str, value: float) -> Floats:
            active = active_effects({**values, name: value}, nulls)
            at = self.place(reference, active) if acts_through(name, *PLACING) else places
            return heights_seen(reference, at, radius, active)

        out = np.zeros((len(names), len(reference)))
        for row, name in zip(out, names, strict=True):
            if acts_through(name, "height", "see_height", "at_rest", *PLACING):
                low, high = self.span(name, values)
                row += (seen(name, high) - seen(name, low)) / (high - low)
        return heights_seen(reference, places, radius, active_effects(values, nulls)), out

    def operators_at(
        self, active: Active, block: int, *, gradients: bool
    ) -> tuple[Operators, Places]:
        """Operators from the nodes to the points of a block, and where those are; kept."""
        where = tuple(
            (effect.id, *own.values())
            for effect, own in active
            if effect.uses("locate", "centre", "outline", "window")
        )
        key = (block, where)
        found = self._operators.get(key)
        square = window_of(active)
        if found is None or (gradients and not square and found[0].gradients is None):
            reference = np.asarray(self.test.blocks[block].reference, dtype=np.float64)
            places = self.place(reference, active)
            if square > 0.0:
                made = self.averages(places, square, active)
            else:
                at = self.test.radius * places.unit
                made = operators(self.circle, at, self.setup.evaluation, gradients=gradients)
            found = made, places
            if len(self._operators) > _KEPT:
                self._operators.clear()
            self._operators[key] = found
        return found

    def place(self, reference: Floats, active: Active) -> Places:
        """Find points seen at `reference` (n, 3) mm on the fabric."""
        return place(reference, self.test.radius, active, self.opening(active))

    def opening(self, active: Active) -> Opening:
        """The clamp's, as effects bend it."""
        return Opening(self.test.semi_axes, active)

    def averages(self, places: Places, square: float, active: Active) -> Operators:
        """Means over windows of this squared radius (mm²) round places."""
        opening = self.opening(active)
        return Operators(self.window.value(places.unit, float(np.sqrt(square)), opening), None)

    def face(self, active: Active) -> Face | None:
        """What the cameras see of the cloth; None where it is the middle."""
        share = face_of(active)
        return None if share == 0.0 else self.face_at(active, share * self.test.thickness)

    def face_at(self, active: Active, above: float) -> Face:
        """The face that lies so far (mm) above the middle."""
        return Face(self.gradients, self.stress_free(active), above)

    def stress_free(self, active: Active) -> Floats:
        """Stress-free positions (n, 3) mm of the nodes."""
        axes = self.test.semi_axes
        rest = surface_of(self.mesh.nodes / axes, active, axes)
        if rest is not None:
            return rest
        return np.column_stack([self.mesh.nodes, np.zeros(len(self.mesh.nodes))])

    @cached_property
    def gradients(self) -> sparse.csr_array:
        """Derivatives of nodal fields at the nodes, (2 n, n): see `Face`."""
        field = smooth_field(self.circle.nodes, self.circle.nodes)
        return sparse.csr_array(sparse.vstack([field.by_x, field.by_y]))

    @property
    def window(self) -> Window:
        """Means over windows of the mesh's fields; kept."""
        if self._window is None:
            self._window = Window(self.circle.nodes, self.test.radius)
        return self._window


def virtual_tests(
    tests: Sequence[BulgeTest], setup: Setup | None = None, threads: int = 1
) -> tuple[VirtualTest, ...]:
    """Virtual twins of several tests; those of one clamp and thickness share their paths.

    Raises
    ------
    InputError
        No test, or one without pressure.
    """
    if not tests:
        raise InputError("no bulge test was given")
    setup = setup or Setup()
    alike: dict[tuple[float, ...], list[BulgeTest]] = {}
    for test in tests:
        alike.setdefault(_clamped(test), []).append(test)
    inflations = {key: Inflation.of(group, setup) for key, group in alike.items()}
    return tuple(VirtualTest(test, setup, threads, inflations[_clamped(test)]) for test in tests)


def _clock(test: BulgeTest) -> Clock | None:
    """When its frames were taken; None where it does not tell."""
    if test.time is None or test.schedule is None:
        return None
    return Clock(np.asarray(test.time, np.float64), np.asarray(test.schedule, np.float64))


def _clamped(test: BulgeTest) -> tuple[float, ...]:
    """What tests have in common whose plain specimens balance alike."""
    return test.radius, test.ellipticity, test.thickness


def _of_fabric(name: str) -> bool:
    """Whether a parameter may change shapes: those of the cameras alone do not."""
    return name in CONSTANTS or effect_named(name.partition(".")[0]).uses(*_SHAPING)
