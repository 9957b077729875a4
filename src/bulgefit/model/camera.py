"""The camera's place: where the points are on the fabric, and what is reported of their motion.

Each effect's hook maps displacements at the points, one after the other. In the middle stands
what all effects together turn and shift the frame by: u_seen = R(X + u) + shift - X, with X where
a point stands before inflation; then come the lens, depth and the axes of the report (`MOTION`).
The map acts point by point, so its derivative by the displacement is a 3x3 matrix for each point
and frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bulgefit.effects.places import MOTION, Scene
from bulgefit.model.description import Active

__all__ = ["Places", "place", "scene_of", "see", "see_slope", "window_of"]

Floats = NDArray[np.float64]

#: Fixed-point corrections that undo the shape's outline: each leaves its size times the last.
_CORRECTIONS, _SETTLED = 60, 1e-14
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


def place(
    reference: Floats, radius: float, active: Active, stretch: Floats | float = 1.0
) -> Places:
    """Find points seen at `reference` (n, 3) mm: undo the cameras, then the clamp's outline.

    `stretch` is the clamp's semi-axes over its radius, where it is an ellipse.
    """
    position, centre = reference[:, :2], np.zeros(2)
    before = [(e, own) for e, own in active if e.order <= MOTION]
    for effect, own in reversed([(e, own) for e, own in active if e.order > MOTION]):
        position = effect.locate(own, position, radius)
    on_fabric = position
    for effect, own in reversed(before):
        on_fabric = effect.locate(own, on_fabric, radius)
        centre = centre + effect.centre(own)
    target = (on_fabric - centre) / (radius * stretch)
    outlines = [(effect, own) for effect, own in active if effect.uses("outline")]
    unit = target
    for _ in range(_CORRECTIONS if outlines else 0):
        there = unit
        for effect, own in outlines:
            there = effect.outline(own, there)
        miss = target - there
        unit = unit + miss
        if np.abs(miss).max() < _SETTLED:
            break
    return Places(position, unit)


def window_of(active: Active) -> float:
    """Square (mm²) of the radius of the window over which displacements are averaged."""
    return float(sum(effect.window(own) for effect, own in active))


def scene_of(
    reference: Floats, places: Places, pressure: Floats, radius: float, active: Active
) -> Scene:
    """What the cameras look at.

    Parameters
    ----------
    reference : (n, 3) array, mm
        As seen; heights that are all zero were not kept, and points stand at the model's height.
    pressure : (frames,) array, MPa
        Applied.
    """
    standing = np.column_stack([places.position, reference[:, 2]])
    bent = [(effect, own) for effect, own in active if effect.uses("height")]
    if bent and not reference[:, 2].any():
        height = sum((e.height(own, places.unit) for e, own in bent), np.zeros(len(reference)))
        standing = np.column_stack([places.position, height])
    scene = Scene(reference, places.position, standing, pressure, radius)
    turn, shift = np.zeros((2, len(pressure), 3))
    for effect, own in active:
        if effect.uses("motion"):
            turned, shifted = effect.motion(own, scene)
            turn, shift = turn + turned, shift + shifted
    return replace(scene, turn=turn, shift=shift)


def see(scene: Scene, active: Active, moved: Floats) -> Floats:
    """Displacements (frames, n, 3) mm as reported, of displacements `moved` of the fabric."""
    out = moved
    for effect, own in active:
        if effect.uses("see") and effect.order <= MOTION:
            out = effect.see(own, scene, out)
    if scene.turn.any():
        turn = Rotation.from_rotvec(scene.turn, degrees=True).as_matrix()
        out = np.matmul(scene.standing + out, turn.swapaxes(1, 2)) - scene.standing
    if scene.shift.any():
        out = out + scene.shift[:, None]
    for effect, own in active:
        if effect.uses("see") and effect.order > MOTION:
            out = effect.see(own, scene, out)
    return out


def see_slope(scene: Scene, active: Active, moved: Floats) -> Callable[[Floats], Floats]:
    """What takes changes (..., frames, n, 3) of the fabric's displacement to reported ones."""
    if not scene.turn.any() and not any(effect.uses("see") for effect, _ in active):
        return lambda change: change
    columns = []
    for axis in np.eye(3):
        ahead, behind = (see(scene, active, moved + h * axis) for h in (_STEP, -_STEP))
        columns.append((ahead - behind) / (2.0 * _STEP))
    slope = np.stack(columns, axis=-1)  # (frames, n, 3 reported, 3 of the fabric)
    return lambda change: np.einsum("fnij,...fnj->...fni", slope, change)
