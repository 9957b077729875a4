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

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import ends_about
from bulgefit.effects.places import Load, Scene
from bulgefit.effects.registry import effect_named, own_values
from bulgefit.errors import InputError
from bulgefit.fem.mesh import Mesh
from bulgefit.model.camera import (
    Passage,
    Places,
    face_of,
    heights_seen,
    place,
    scene_of,
    window_of,
)
from bulgefit.model.description import (
    CONSTANTS,
    Active,
    Description,
    Values,
    active_effects,
    checked,
    describe,
    gauss_points,
    null_values,
    surface_of,
    with_value,
)
from bulgefit.model.face import Face
from bulgefit.model.forces import Change
from bulgefit.model.inflation import LEAST_PRESSURE, Inflation, Shapes
from bulgefit.model.observation import Operators, applied, operators
from bulgefit.model.opening import Opening
from bulgefit.model.setup import Setup
from bulgefit.model.smooth import smooth_field
from bulgefit.model.softening import Kept
from bulgefit.model.window import Window

__all__ = ["Prediction", "Sight", "VirtualTest", "virtual_tests"]

Floats = NDArray[np.float64]

#: Half the span of a difference by the square of the window, as a share of that: a wide one reaches
#: over where windows touch the rim, and what they average turns. Below a square (mm²) half of it is
#: that: windows are then within few cells of the grid, whose interpolation has kinks.
_WINDOW_STEP, _NARROW, _LEAST_WINDOW = 1e-3, 0.25, 1e-6
#: Sets of operators at the points that are kept: points that move make new ones.
_KEPT = 8
#: Of a modulus, the largest part by which a difference steps: it stays above zero, however soft.
_SOFT = 1e-3
#: Hooks that change shapes.
_SHAPING = ("outline", "height", "clamp", "material", "load")
#: Hooks that move points over the fabric.
_PLACING = ("locate", "centre", "outline")


@dataclass(frozen=True, eq=False)
class Prediction:
    """Reported displacements and their derivatives.

    Attributes
    ----------
    displacement : (frames, points, 3) array, mm
    derivative : (parameters, frames, points, 3) array
        By values; by their squares where that is the parameter's coordinate.
    shapes : Shapes
    """

    displacement: Floats
    derivative: Floats
    shapes: Shapes


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
        self.time = None if test.time is None else np.asarray(test.time, np.float64)
        self.correction: Floats | None = None
        self._window: Window | None = None
        self._operators: dict[object, tuple[Operators, Places]] = {}

    def __getstate__(self) -> dict[str, Any]:
        # what comes from the test, or is as soon made as sent, is made again
        state = {**self.__dict__, "_operators": {}}
        state.pop("gradients", None)
        return state

    @property
    def elapsed(self) -> Floats | None:
        """Share of the test's time that has passed (frames,); None where it tells no time."""
        if self.time is None:
            return None
        passed = self.time - self.time.min()
        return np.asarray(passed / max(float(passed.max()), 1e-9))

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
            Unknown names, or constants that are not admissible.
        SolveError
        """
        given = self.given(values)
        checked([*given, *names])
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
            return self.inflation.along_path(here, given, changes)
        if self.setup.interpolation == "study":
            raise InputError("the study's way knows no effects beside the moduli")
        guesses = None if near is None else self._ahead(near, given)
        return self.inflation.balanced(here, given, changes, guesses, self.threads, within=within)

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
            self.mesh, test.radius, self.recorded, self.time, values, active,
            slips=slips, stretch=test.stretch, beside=beside, hooks=hooks,
        )  # fmt: skip

    def description(self, values: Values) -> Description:
        """The specimen in its clamp under its load."""
        given = self.given(values)
        return self._describe(given, active_effects(given, self.nulls()), slips=False)

    def load(self, values: Values) -> Load:
        """Recorded, true and balanced pressures."""
        load = Load(self.recorded, self.time, self.recorded)
        for effect, own in active_effects(self.given(values), self.nulls()):
            load = effect.load(own, load)
        return load

    def _change(
        self, name: str, values: Values, active: Active, here: Description, slips: bool
    ) -> Change:
        ends, nulls = self.span(name, values), self.nulls()
        hooks = ["material"] if name in CONSTANTS else [h for h in _SHAPING if _uses(name, h)]
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
            at = self.place(reference, active) if _uses(name, *_PLACING) else places
            return heights_seen(reference, at, radius, active)

        out = np.zeros((len(names), len(reference)))
        for row, name in zip(out, names, strict=True):
            if _uses(name, "height", "see_height", "at_rest", *_PLACING):
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
        if share == 0.0:
            return None
        axes = self.test.semi_axes
        rest = surface_of(self.mesh.nodes / axes, active, axes)
        if rest is None:
            rest = np.column_stack([self.mesh.nodes, np.zeros(len(self.mesh.nodes))])
        return Face(self.gradients, rest, share * self.test.thickness)

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


class Sight:
    """One look of the cameras at shapes: values once, derivatives name by name.

    Attributes
    ----------
    displacement : (frames, points, 3) array, mm
        As reported.
    """

    def __init__(
        self,
        virtual: VirtualTest,
        shapes: Shapes,
        names: Sequence[str],
        block: int,
        points: slice | NDArray[np.intp] | None,
    ) -> None:
        self.virtual, self.shapes, self.names, self.block = virtual, shapes, names, block
        some = slice(None) if points is None else points
        self.points = some
        measured = virtual.test.blocks[block]
        self.frames = measured.frames
        self.reference = np.asarray(measured.reference, dtype=np.float64)[some]
        self.moves = [n for n in names if _uses(n, *_PLACING)]
        self.active = active_effects(shapes.values, virtual.nulls())
        made, places = virtual.operators_at(self.active, block, gradients=bool(self.moves))
        self.operators, self.places = made.of_points(some), _some(places, some)
        field = shapes.displacement
        if virtual.correction is not None:
            field = field + virtual.correction
        self.middle = _of_frames(field, self.frames)
        self.face = virtual.face(self.active)
        self.field = self.middle if self.face is None else self.face.seen(self.middle)
        self.moved = self.operators(self.field)
        self.scene = self._scene(shapes.values, self.active, self.places)
        self.passage = Passage(self.scene, self.active, self.moved)
        self.displacement = self.passage.reported()

    def _scene(self, values: Values, active: Active, places: Places) -> Scene:
        load = np.maximum(self.virtual.load(values).applied, LEAST_PRESSURE)
        applied, radius = load[self.frames], self.virtual.test.radius
        elapsed = self.virtual.elapsed
        if elapsed is not None:
            elapsed = elapsed[self.frames]
        return scene_of(self.reference, places, applied, float(load.max()), radius, active, elapsed)

    def prediction(self) -> Prediction:
        """With every derivative at every point."""
        return Prediction(self.displacement, self.derivative(), self.shapes)

    def derivative(self) -> Floats:
        """(names, frames, points, 3), as in `Prediction`."""
        rows = np.zeros((len(self.names), *self.displacement.shape))
        for row, name in zip(rows, self.names, strict=True):
            self.add(row, name)
        return rows

    def gathered(self, pull: Floats, group: NDArray[np.intp] | None = None) -> Floats:
        """Σ pull · ∂displacement/∂name over the points of each group, (names, groups, frames).

        What moves with the nodes alone needs no derivative at the points: with A from nodes to
        points, Σ pull · A v = (Aᵀ pull) · v, one product for all names.

        Parameters
        ----------
        pull : (frames, points, 3) array
        group : (points,) int array, optional
            Numbers of the groups, all of 0 to the largest; default: one group.
        """
        if group is None:
            group = np.zeros(pull.shape[1], dtype=np.intp)
        count = int(group.max(initial=-1)) + 1
        out = np.zeros((len(self.names), count, len(pull)))
        of_nodes = [self._is_of_nodes(name) for name in self.names]
        if any(of_nodes):
            fields = np.stack(
                [
                    self._of_nodes(name)
                    for name, own in zip(self.names, of_nodes, strict=True)
                    if own
                ]
            )
            out[of_nodes] = _gathered_by_nodes(self.operators, fields, pull, group, count)
        for one, name, own in zip(out, self.names, of_nodes, strict=True):
            if not own:
                row = np.zeros(self.displacement.shape)
                self.add(row, name)
                np.add.at(one, group, np.einsum("kmc,kmc->mk", row, pull))
        return out

    def _is_of_nodes(self, name: str) -> bool:
        """Whether what is reported changes as the nodes do, and by nothing else."""
        hooks = ("see", "motion", *_PLACING, "height", "load", "window", "face")
        return name in self.shapes.derivative and self._is_plain and not _uses(name, *hooks)

    @property
    def _is_plain(self) -> bool:
        """Whether the cameras report the fabric's displacement as it is, but for a shift."""
        return not self.scene.turn.any() and not any(e.uses("see") for e, _ in self.active)

    def add(self, row: Floats, name: str) -> None:
        """Add the derivative by a name to a row (frames, points, 3)."""
        change = self._of_fabric(name)
        if change is not None:
            row += self.passage.through()(change)
        if _uses(name, "see", "motion", "locate", "centre", "outline", "height", "load"):
            row += self._of_camera(name)

    def _of_fabric(self, name: str) -> Floats | None:
        """Change of the displacement at the points before the cameras' maps."""
        out = None
        if name in self.shapes.derivative or _uses(name, "face"):
            out = self.operators(self._of_nodes(name))
        if name in self.moves:
            out = _sum(out, self._of_motion(name))
        if _uses(name, "window"):
            out = _sum(out, self._of_window())
        return out

    def _of_nodes(self, name: str) -> Floats:
        """Change (frames, n, 3) of what is seen of the nodes.

        Of what turns the normals at rest, and of how far the face lies off, it is a difference.
        """
        change = self.shapes.derivative.get(name)
        own = np.zeros_like(self.middle) if change is None else _of_frames(change, self.frames)
        if _uses(name, "face") or (self.face is not None and _uses(name, "height", "outline")):
            here = self.virtual.value(name, self.shapes.values)
            ends = self.virtual.span(name, self.shapes.values)
            below, above = (self._seen_at(name, x, self.middle + (x - here) * own) for x in ends)
            return np.asarray((above - below) / (ends[1] - ends[0]))
        return own if self.face is None else self._of_face(own)

    @cached_property
    def _of_face(self) -> Callable[[Floats], Floats]:
        """What takes changes of the middle to those of the face."""
        assert self.face is not None
        return self.face.slope(self.middle)

    def _seen_at(self, name: str, value: float, middle: Floats) -> Floats:
        """What is seen of the nodes at another value of a parameter, and the middle's field."""
        face = self.virtual.face(with_value(self.active, name, value, self.virtual.nulls()))
        return middle if face is None else face.seen(middle)

    def _ends(self, name: str) -> tuple[list[tuple[dict[str, float], Active, Places]], float]:
        """Values, active effects and places of the points below and above a parameter's value."""
        low, high = self.virtual.span(name, self.shapes.values)
        ends = []
        for value in (low, high):
            values = {**self.shapes.values, name: value}
            active = with_value(self.active, name, value, self.virtual.nulls())
            moves = name in self.moves
            places = self.virtual.place(self.reference, active) if moves else self.places
            ends.append((values, active, places))
        return ends, high - low

    def _of_motion(self, name: str) -> Floats:
        """What points that move over the fabric see.

        Of means over windows it is a difference: the rim moves through those beside it.
        """
        ((_, low, below), (_, high, above)), span = self._ends(name)
        if (square := window_of(self.active)) > 0.0:
            ends = [self._averaged(*end) for end in ((below, square, low), (above, square, high))]
            return np.asarray((ends[1] - ends[0]) / span)
        motion = self.virtual.test.radius * (above.unit - below.unit) / span
        by_x, by_y = self.operators.slopes(self.field)
        return np.asarray(motion[:, :1] * by_x + motion[:, 1:] * by_y)

    def _of_window(self) -> Floats:
        """∂/∂(window²) of the averaged field: by a difference in it.

        Of windows alone: the field without one is interpolated otherwise, by up to a thousandth of
        a millimetre, which over a narrow span is a part of what a window does.
        """
        here = window_of(self.active)
        half = _WINDOW_STEP * here if here > _NARROW else _NARROW
        ends = [max(here - half, _LEAST_WINDOW), here + half]
        fields = [self._averaged(self.places, square, self.active) for square in ends]
        return np.asarray((fields[1] - fields[0]) / (ends[1] - ends[0]))

    def _averaged(self, places: Places, square: float, active: Active) -> Floats:
        """The field at places, averaged over windows of this squared radius (mm²)."""
        opening = self.virtual.opening(active)
        return applied(
            self.virtual.window.on_grid(places.unit, float(np.sqrt(square)), opening), self._laid
        )

    @cached_property
    def _laid(self) -> Floats:
        """The field on the grid that windows are laid over."""
        return self.virtual.window.laid(self.field)

    def _of_camera(self, name: str) -> Floats:
        """Change of what is reported at a fixed displacement of the fabric."""
        elsewhere = ("locate", "centre", "outline", "height", "load")
        if not _uses(name, "motion", *elsewhere):
            return self._of_report(name)
        ends, span = self._ends(name)
        if not self.scene.turn.any() and not _uses(name, "see", "motion", "locate"):
            depends = any(e.uses("see", "motion") for e, _ in self.active)
            if not depends:
                return np.zeros(1)
        scenes = [self._scene(values, active, places) for values, active, places in ends]
        if not _uses(name, "see", *elsewhere):
            return self.passage.of_motion(*scenes) / span
        below, above = (
            Passage(scene, active, self.moved).reported()
            for scene, (_, active, _) in zip(scenes, ends, strict=True)
        )
        return np.asarray((above - below) / span)

    def _of_report(self, name: str) -> Floats:
        """The same by a parameter of an effect that changes nothing but what is seen."""
        values, nulls = self.shapes.values, self.virtual.nulls()
        effect = effect_named(name.partition(".")[0])
        low, high = self.virtual.span(name, values)
        ends = (own_values(effect, {**values, name: value}, nulls) for value in (low, high))
        return self.passage.of_effect(effect, *ends) / (high - low)


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


def _clamped(test: BulgeTest) -> tuple[float, ...]:
    """What tests have in common whose plain specimens balance alike."""
    return test.radius, test.ellipticity, test.thickness


def _uses(name: str, *hooks: str) -> bool:
    """Whether a parameter is of an effect that has any of these hooks."""
    return "." in name and effect_named(name.partition(".")[0]).uses(*hooks)


def _of_fabric(name: str) -> bool:
    """Whether a parameter may change shapes: those of the cameras alone do not."""
    return name in CONSTANTS or effect_named(name.partition(".")[0]).uses(*_SHAPING)


def _gathered_by_nodes(
    operators: Operators, fields: Floats, pull: Floats, group: NDArray[np.intp], count: int
) -> Floats:
    """Σ pull · (fields at the points) over the points of each group, (names, groups, frames).

    Parameters
    ----------
    fields : (names, frames, nodes, 3) array
    """
    out = np.zeros((len(fields), count, len(pull)))
    order = np.argsort(group, kind="stable")
    ends = np.searchsorted(group[order], np.arange(count + 1))
    for g in range(count):
        own = order[ends[g] : ends[g + 1]]
        nodes, nodal = operators.of_points(own).transposed(pull[:, own])
        out[:, g] = np.einsum("kic,pkic->pk", nodal, fields[:, :, nodes])
    return out


def _some(places: Places, points: slice | NDArray[np.intp]) -> Places:
    return Places(places.position[points], places.unit[points])


def _sum(a: Floats | None, b: Floats) -> Floats:
    return b if a is None else a + b


def _of_frames(field: Floats, frames: NDArray[np.intp]) -> Floats:
    """The frames of a block from (frames, n, 3), without a copy where it has them all."""
    return field if len(frames) == len(field) else field[frames]
