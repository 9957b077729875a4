"""What the cameras report of balanced shapes, and how that changes with each parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.places import Scene
from bulgefit.effects.registry import acts_through, effect_named, own_values
from bulgefit.model.balancing import LEAST_PRESSURE
from bulgefit.model.camera import Passage, Places, face_of, scene_of, window_of
from bulgefit.model.description import Active, Values, active_effects, with_value
from bulgefit.model.inflation import Shapes
from bulgefit.model.observation import Operators, applied

if TYPE_CHECKING:
    from bulgefit.model.virtual_test import VirtualTest

__all__ = ["PLACING", "Prediction", "Sight"]

Floats = NDArray[np.float64]

#: Half the span of a difference by the square of the window, as a share of that: a wide one reaches
#: over where windows touch the rim, and what they average turns. Below a square (mm²) half of it is
#: that: windows are then within few cells of the grid, whose interpolation has kinks.
_WINDOW_STEP, _NARROW, _LEAST_WINDOW = 1e-3, 0.25, 1e-6
#: Hooks that move points over the fabric.
PLACING = ("locate", "centre", "outline")


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
        self.moves = [n for n in names if acts_through(n, *PLACING)]
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
        clock = self.virtual.clock
        elapsed = None if clock is None else clock.share[self.frames]
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
        hooks = ("see", "motion", *PLACING, "height", "load", "window", "face")
        return name in self.shapes.derivative and self._is_plain and not acts_through(name, *hooks)

    @property
    def _is_plain(self) -> bool:
        """Whether the cameras report the fabric's displacement as it is, but for a shift."""
        return not self.scene.turn.any() and not any(e.uses("see") for e, _ in self.active)

    def add(self, row: Floats, name: str) -> None:
        """Add the derivative by a name to a row (frames, points, 3)."""
        change = self._of_fabric(name)
        if change is not None:
            row += self.passage.through()(change)
        if acts_through(name, "see", "motion", "locate", "centre", "outline", "height", "load"):
            row += self._of_camera(name)

    def _of_fabric(self, name: str) -> Floats | None:
        """Change of the displacement at the points before the cameras' maps."""
        out = None
        if name in self.shapes.derivative or acts_through(name, "face"):
            out = self.operators(self._of_nodes(name))
        if name in self.moves:
            out = _sum(out, self._of_motion(name))
        if acts_through(name, "window"):
            out = _sum(out, self._of_window())
        return out

    def _of_nodes(self, name: str) -> Floats:
        """Change (frames, n, 3) of what is seen of the nodes."""
        change = self.shapes.derivative.get(name)
        own = np.zeros_like(self.middle) if change is None else _of_frames(change, self.frames)
        if self.face is not None:
            of_rest = self._of_rest(name) if acts_through(name, "height", "outline") else None
            own = self._of_face(own, of_rest)
        return own + self._of_distance(name) if acts_through(name, "face") else own

    @cached_property
    def _of_face(self) -> Callable[..., Floats]:
        """What takes changes of the middle to those of the face."""
        assert self.face is not None
        return self.face.slope(self.middle)

    def _of_distance(self, name: str) -> Floats:
        """Change (frames, n, 3) by a parameter that says how far off the middle the face lies."""
        (low, below), (high, above) = self._active_at(name)
        rate = self.virtual.test.thickness * (face_of(above) - face_of(below)) / (high - low)
        return rate * self.virtual.face_at(self.active, 0.0).lean(self.middle)

    def _of_rest(self, name: str) -> Floats:
        """Change (n, 3) of the nodes' stress-free positions."""
        (low, below), (high, above) = self._active_at(name)
        return (self.virtual.stress_free(above) - self.virtual.stress_free(below)) / (high - low)

    def _active_at(self, name: str) -> list[tuple[float, Active]]:
        """Values below and above a parameter's, and the active effects there."""
        nulls = self.virtual.nulls()
        ends = self.virtual.span(name, self.shapes.values)
        return [(value, with_value(self.active, name, value, nulls)) for value in ends]

    def _ends(self, name: str) -> tuple[list[tuple[dict[str, float], Active, Places]], float]:
        """Values, active effects and places of the points below and above a parameter's value."""
        ends = []
        for value, active in (about := self._active_at(name)):
            values = {**self.shapes.values, name: value}
            moves = name in self.moves
            places = self.virtual.place(self.reference, active) if moves else self.places
            ends.append((values, active, places))
        return ends, about[1][0] - about[0][0]

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
        if not acts_through(name, "motion", *elsewhere):
            return self._of_report(name)
        ends, span = self._ends(name)
        if not self.scene.turn.any() and not acts_through(name, "see", "motion", "locate"):
            depends = any(e.uses("see", "motion") for e, _ in self.active)
            if not depends:
                return np.zeros(1)
        scenes = [self._scene(values, active, places) for values, active, places in ends]
        if not acts_through(name, "see", *elsewhere):
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
