"""What a camera reports of a made test: points, frames that move, and a lens that distorts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bulgefit.trial.draw import Draw
from bulgefit.trial.fabric import Shapes
from bulgefit.trial.gauge import true_load
from bulgefit.trial.rim import positions
from bulgefit.trial.window import NodalField, averaged, upright

__all__ = ["Setting", "material_points", "observe"]

Floats = NDArray[np.float64]

#: Where the rim is looked at, on the unit circle.
_LOOK = 2 * np.pi * np.arange(720) / 720
_CIRCLE = np.stack([np.cos(_LOOK), np.sin(_LOOK)], axis=1)


@dataclass(frozen=True, eq=False)
class Setting:
    """How a test is recorded.

    Attributes
    ----------
    reference : (n, 2) array, mm
        Points as the camera sees them before inflation.
    pressure : (frames,) array, MPa
        As recorded.
    time : (frames,) array, s
    radius, thickness : float, mm
        Nominal.
    mounted : float, degree
        As of a `Draw`.
    """

    reference: Floats
    pressure: Floats
    time: Floats
    radius: float = 100.0
    thickness: float = 0.81
    mounted: float = 0.0


def material_points(drawn: Draw, setting: Setting) -> Floats:
    """Points (n, 2) mm of the fabric, from the clamp's centre, that are seen at `reference`.

    Lengths are seen × (1 + scale), and the clamp's centre lies at (x0, y0).
    """
    centre = [drawn.get("registration.x0"), drawn.get("registration.y0")]
    straight = _undistorted(drawn, setting.reference, setting.radius)
    return straight / (1.0 + drawn.get("dic_scale.scale")) - centre


def observe(drawn: Draw, setting: Setting, shapes: Shapes) -> tuple[Floats, Floats]:
    """Reference heights (n,) mm and displacements (frames, n, 3) mm as seen, without noise.

    In the order of what happens: the fabric moves, and its face with it, the fixture moves it, the
    lens distorts what is then in front of it, and the axes of the report are turned. Points stand
    at their height before inflation, whether it is kept or not.
    """
    points = material_points(drawn, setting)
    above = drawn.get("surface_offset.share") * setting.thickness
    face = np.zeros((len(points), 3))
    if above != 0.0:
        face = above * (upright(shapes.nodes, points) - [0.0, 0.0, 1.0])
    points = points - face[:, :2]  # on the fabric, below what is seen
    height = NodalField(shapes.nodes[:, :2], points)(shapes.nodes)[:, 2] + face[:, 2]
    rim = positions(drawn, _CIRCLE, setting.radius)[:, :2]
    moved = averaged(shapes, points, drawn.get("dic_smoothing.window"), rim, above)
    straight = _undistorted(drawn, setting.reference, setting.radius)
    scale = 1.0 + drawn.get("dic_scale.scale")
    shown = _reference_state(drawn, setting.reference)
    start = np.column_stack([straight, scale * height]) + shown * [0.0, 0.0, 1.0]
    bar = 10.0 * true_load(drawn, setting.pressure)
    flat = bar / (bar + drawn.get("reference_state.flattening"))
    seen = scale * moved - flat[:, None, None] * shown
    seen = _framed(drawn, setting.pressure, start, seen)
    seen = seen + _drift(drawn, setting.time)[:, None, :]
    seen[..., :2] += _bent(drawn, len(seen), straight, setting.radius)
    distorted = _distorted(drawn, (start + seen)[..., :2], setting.radius)
    seen[..., :2] = distorted - setting.reference
    deep = 1.0 + drawn.get("depth_scale.scale_z")
    seen[..., 2] *= deep
    return deep * start[:, 2], _turned(drawn, seen)


def _reference_state(drawn: Draw, points: Floats) -> Floats:
    """Displacement (n, 3) mm that the reference image already shows."""
    out = np.zeros((len(points), 3))
    for wave in drawn.waves:
        out[:, wave.axis] += wave.amplitude * np.cos(points @ [wave.kx, wave.ky] + wave.phase)
    return out


def _framed(drawn: Draw, recorded: Floats, start: Floats, seen: Floats) -> Floats:
    """In the frame of a camera that moved: R (X + u) + shift - X."""
    axes = "xyz"
    turn, shift, turn_bar, shift_bar = (
        np.array([drawn.get(f"{effect}.{part}_{axis}") for axis in axes])
        for effect in ("rigid_motion", "fixture_motion")
        for part in ("rotation", "shift")
    )
    bar = 10.0 * true_load(drawn, recorded)[:, None]
    if (stiffer := drawn.get("fixture_motion.shape")) > 0.0:
        bar = (1.0 - np.exp(-stiffer * bar)) / stiffer
    rotation = Rotation.from_rotvec(turn + bar * turn_bar, degrees=True).as_matrix()
    moved = np.einsum("fij,fnj->fni", rotation, start + seen)
    return moved + (shift + bar * shift_bar)[:, None, :] - start


def _drift(drawn: Draw, time: Floats) -> Floats:
    """Shift (frames, 3) mm of a camera that drifts evenly in time."""
    whole = np.array([drawn.get(f"camera_drift.shift_{axis}") for axis in "xyz"])
    return ((time - time[0]) / (time[-1] - time[0]))[:, None] * whole


def _bent(drawn: Draw, frames: int, points: Floats, radius: float) -> Floats:
    """Displacement (frames, n, 2) mm that frames show which are bent in their plane, each anew.

    Along a direction they bend by the square of the distance across it: `bend` at the rim.
    """
    turn = np.deg2rad(drawn.get("frame_bend.direction"))
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    clock = 2 * np.pi * drawn.get("frame_bend.cycles") * np.linspace(0.0, 1.0, frames)
    swing = np.sin(clock + np.deg2rad(drawn.get("frame_bend.phase")))
    shape = drawn.get("frame_bend.bend") * (points @ across / radius) ** 2
    return swing[:, None, None] * shape[:, None] * along


def _distorted(drawn: Draw, points: Floats, radius: float) -> Floats:
    """Where a lens shows points (..., 2) mm."""
    square = (points**2).sum(axis=-1, keepdims=True) / radius**2
    return points * (1.0 + drawn.get("lens_distortion.k1") * square)


def _undistorted(drawn: Draw, seen: Floats, radius: float) -> Floats:
    """Where points (n, 2) mm lie that a lens shows at `seen`."""
    points = seen
    for _ in range(30):  # contracts by three times k1
        points = points + seen - _distorted(drawn, points, radius)
    return points


def _turned(drawn: Draw, seen: Floats) -> Floats:
    """A displacement (..., 3) mm reported along axes that are turned: R u."""
    rotation = [drawn.get(f"frame_misalignment.rotation_{axis}") for axis in "xyz"]
    return seen @ Rotation.from_rotvec(rotation, degrees=True).as_matrix().T
