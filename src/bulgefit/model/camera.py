"""The camera's place: where the points are on the fabric, and what is reported of their motion.

Each effect's hook maps displacements at the points, one after the other. In the middle stands
what all effects together turn and shift the frame by: u_seen = R(X + u) + shift - X, with X where
a point stands before inflation; then come the lens, depth and the axes of the report (`MOTION`).
The map acts point by point, so its derivative by the displacement is a 3x3 matrix for each point
and frame.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.places import MOTION, Scene
from bulgefit.effects.registry import acting
from bulgefit.model.description import Active
from bulgefit.model.opening import Opening

__all__ = ["Passage", "Places", "face_of", "heights_seen", "place", "scene_of", "window_of"]

Floats = NDArray[np.float64]
#: What takes changes (..., frames, n, 3) mm to others.
Slope = Callable[[Floats], Floats]

#: Half the step (mm) of differences by the displacement, for maps of third order in it at most.
_STEP = 1e-2


@dataclass(frozen=True, eq=False)
class Places:
    """Where measured points are.

    Attributes
    ----------
    position : (n, 2) array, mm
        In the cameras' frame, where nothing is bent: what the lens sees.
    unit : (n, 2) array
        On the unit disc of the mesh.
    """

    position: Floats
    unit: Floats


def place(reference: Floats, radius: float, active: Active, opening: Opening) -> Places:
    """Find points seen at `reference` (n, 3) mm: undo the cameras, then the clamp's outline."""
    position, centre = reference[:, :2], np.zeros(2)
    before = [(e, own) for e, own in active if e.order <= MOTION]
    for effect, own in reversed([(e, own) for e, own in active if e.order > MOTION]):
        position = effect.locate(own, position, radius)
    on_fabric = position
    for effect, own in reversed(before):
        on_fabric = effect.locate(own, on_fabric, radius)
        centre = centre + effect.centre(own)
    return Places(position, opening.unit(on_fabric - centre))


def window_of(active: Active) -> float:
    """Square (mm²) of the radius of the window over which displacements are averaged."""
    return float(sum(effect.window(own) for effect, own in active))


def face_of(active: Active) -> float:
    """Share of the thickness by which the face that is seen lies above the middle."""
    return float(sum(effect.face(own) for effect, own in active))


def heights_seen(reference: Floats, places: Places, radius: float, active: Active) -> Floats:
    """Heights (n,) mm of points before inflation as the cameras report them.

    What the fabric's shape and the reference image have together, but for the plane that a
    report's heights are counted from.
    """
    out = np.zeros(len(reference))
    for effect, own in active:
        out = effect.see_height(own, out + effect.height(own, places.unit))
        out = out + effect.at_rest(own, reference, radius)[:, 2]
    return out


def scene_of(
    reference: Floats,
    places: Places,
    pressure: Floats,
    highest: float,
    radius: float,
    active: Active,
    elapsed: Floats | None = None,
) -> Scene:
    """What the cameras look at.

    Parameters
    ----------
    reference : (n, 3) array, mm
        As seen; heights that are all zero were not kept, and points stand at the model's height.
    pressure : (frames,) array, MPa
        Applied.
    highest : float, MPa
        Of all frames of the test.
    elapsed : (frames,) array, optional
        Share of the test's time that has passed.
    """
    standing = np.column_stack([places.position, reference[:, 2]])
    bent = [(effect, own) for effect, own in active if effect.uses("height")]
    if bent and not reference[:, 2].any():
        height = sum((e.height(own, places.unit) for e, own in bent), np.zeros(len(reference)))
        standing = np.column_stack([places.position, height])
    scene = Scene(reference, places.position, standing, pressure, highest, radius, elapsed=elapsed)
    turn, shift = np.zeros((2, len(pressure), 3))
    for effect, own in active:
        if effect.uses("motion"):
            turned, shifted = effect.motion(own, scene)
            turn, shift = turn + turned, shift + shifted
    return replace(scene, turn=turn, shift=shift)


class Passage:
    """Displacements on their way through the cameras, effect by effect.

    What one effect changes need not be looked at from the start: it is a change of what reaches the
    next, and the slopes of what follows take it to the report.

    Parameters
    ----------
    scene : Scene
    active : list of (Effect, values)
        In the order in which they act.
    moved : (frames, n, 3) array, mm
        Displacements of the fabric.
    """

    def __init__(self, scene: Scene, active: Active, moved: Floats) -> None:
        self._scene = scene
        seen = [(effect, own) for effect, own in active if effect.uses("see")]
        before = [(e, own) for e, own in seen if e.order <= MOTION]
        #: Effects before and after the frame's motion, which stands between them as None.
        self._steps: list[tuple[Effect, dict[str, float]] | None] = [
            *before,
            None,
            *(pair for pair in seen if pair[0].order > MOTION),
        ]
        self._motion = len(before)
        self._reached = [moved]
        self._slopes: dict[int, Slope] = {}

    def reported(self) -> Floats:
        """Displacements (frames, n, 3) mm as reported."""
        return self._at(len(self._steps))

    def through(self) -> Slope:
        """What takes changes (..., frames, n, 3) of the fabric's displacement to reported ones."""
        return self._from(0)

    def of_effect(self, effect: Effect, below: Own, above: Own) -> Floats:
        """Change of the report from values of an effect that has no other hook than `see`."""
        step, there = self._place(effect)
        reaching = self._at(step)
        change = effect.see(above, self._scene, reaching) - effect.see(below, self._scene, reaching)
        return self._from(step + there)(change)

    def of_motion(self, below: Scene, above: Scene) -> Floats:
        """Change of the report from scenes that differ in nothing but turn and shift."""
        reaching = self._at(self._motion)
        change = _moved(above, reaching) - _moved(below, reaching)
        return self._from(self._motion + 1)(change)

    def _place(self, effect: Effect) -> tuple[int, bool]:
        """The step that an effect is, or would stand before; and whether it is there."""
        order = list(acting())
        ranks = [
            (False, len(order)) if step is None else _rank(step[0], order) for step in self._steps
        ]
        own = _rank(effect, order)
        return bisect_left(ranks, own), own in ranks

    def _at(self, step: int) -> Floats:
        """What reaches a step."""
        while len(self._reached) <= step:
            self._reached.append(self._taken(len(self._reached) - 1, self._reached[-1]))
        return self._reached[step]

    def _taken(self, step: int, out: Floats) -> Floats:
        pair = self._steps[step]
        return _moved(self._scene, out) if pair is None else pair[0].see(pair[1], self._scene, out)

    def _from(self, first: int) -> Slope:
        """What takes changes of what reaches a step to reported ones."""
        if first not in self._slopes:
            self._slopes[first] = self._slope(first)
        return self._slopes[first]

    def _slope(self, first: int) -> Slope:
        rest = [k for k in range(first, len(self._steps)) if k != self._motion]
        turns = first <= self._motion and bool(self._scene.turn.any())
        if not rest:
            if not turns:
                return lambda change: change
            turn = _turn(self._scene).swapaxes(1, 2)
            return lambda change: np.matmul(change, turn)

        def onwards(out: Floats) -> Floats:
            for step in range(first, len(self._steps)):
                out = self._taken(step, out)
            return out

        columns, reaching = [], self._at(first)
        for axis in np.eye(3):
            ahead, behind = (onwards(reaching + h * axis) for h in (_STEP, -_STEP))
            columns.append((ahead - behind) / (2.0 * _STEP))
        slope = np.stack(columns, axis=-1)  # (frames, n, 3 reported, 3 that reach the step)
        return lambda change: np.einsum("fnij,...fnj->...fni", slope, change)


def _rank(effect: Effect, order: list[str]) -> tuple[bool, int]:
    """Where an effect acts among the others and the motion."""
    return effect.order > MOTION, order.index(effect.id)


def _turn(scene: Scene) -> Floats:
    """The frame's rotation (frames, 3, 3)."""
    return np.asarray(Rotation.from_rotvec(scene.turn, degrees=True).as_matrix())


def _moved(scene: Scene, out: Floats) -> Floats:
    """Displacements (frames, n, 3) mm as a frame shows them that has turned and shifted."""
    if scene.turn.any():
        standing = scene.standing
        out = np.matmul(standing + out, _turn(scene).swapaxes(1, 2)) - standing
    return out + scene.shift[:, None] if scene.shift.any() else out
