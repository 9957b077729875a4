"""What a camera reports of a made test: points, frames that move, noise, and holes that wander."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import Delaunay
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from bulgefit.trial.draw import Draw
from bulgefit.trial.fabric import Shapes, true_load

__all__ = ["NodalField", "Setting", "holes", "material_points", "noise", "observe"]

Floats = NDArray[np.float64]

#: Share of the noise that differs from point to point; the rest is correlated.
_INDEPENDENT = 0.8
#: Radii and angles at which a correlation window is averaged, and beside the rim.
_RADII, _ANGLES = 3, 12
_RIM_RADII, _RIM_ANGLES = 6, 24


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
    """

    reference: Floats
    pressure: Floats
    time: Floats
    radius: float = 100.0
    thickness: float = 0.81


class NodalField:
    """Piecewise cubic interpolation (Clough and Tocher) of nodal values.

    Parameters
    ----------
    nodes : (n, 2) array, mm
    points : (m, 2) array, mm
        NaN is given outside the nodes' hull.
    """

    def __init__(self, nodes: Floats, points: Floats) -> None:
        self._triangles = Delaunay(nodes)
        self._points = points

    def __call__(self, nodal: Floats) -> Floats:
        """Values (..., m, 3) of a nodal (..., n, 3) field."""
        values = np.moveaxis(nodal, -2, 0)
        found = CloughTocher2DInterpolator(self._triangles, values, tol=1e-8)(self._points)
        return np.moveaxis(found, 0, -2)


def material_points(drawn: Draw, setting: Setting) -> Floats:
    """Points (n, 2) mm of the fabric, from the clamp's centre, that are seen at `reference`.

    Lengths are seen × (1 + scale), and the clamp's centre lies at (x0, y0).
    """
    centre = [drawn.get("registration.x0"), drawn.get("registration.y0")]
    straight = _unbent(drawn, setting.reference, setting.radius)
    return straight / (1.0 + drawn.get("dic_scale.scale")) - centre


def observe(drawn: Draw, setting: Setting, shapes: Shapes) -> tuple[Floats, Floats]:
    """Reference heights (n,) mm and displacements (frames, n, 3) mm as seen, without noise."""
    points = material_points(drawn, setting)
    height = NodalField(shapes.nodes[:, :2], points)(shapes.nodes)[:, 2]
    moved = _displacement(shapes, points, drawn.get("dic_smoothing.window"), setting.radius)
    straight = _unbent(drawn, setting.reference, setting.radius)
    scale = 1.0 + drawn.get("dic_scale.scale")
    shown = _reference_state(drawn, setting.reference)
    start = np.column_stack([straight, scale * height]) + shown * [0.0, 0.0, 1.0]
    bar = 10.0 * true_load(drawn, setting.pressure)
    flat = bar / (bar + drawn.get("reference_state.flattening"))
    seen = scale * moved - flat[:, None, None] * shown
    seen = _framed(drawn, setting.pressure, start, seen)
    seen = seen + _drift(drawn, setting.time)[:, None, :]
    bent = _bent(drawn, (start + seen)[..., :2], setting.radius)
    seen[..., :2] = bent - setting.reference
    return start[:, 2], seen


def _displacement(shapes: Shapes, points: Floats, window: float, radius: float) -> Floats:
    """Displacement (frames, n, 3) mm of the fabric at points, averaged over a window (mm)."""
    beside = np.hypot(*points.T) + window > radius
    out = np.empty((len(shapes.fine), len(points), 3))
    for part, (offsets, weights) in (
        (~beside, _window(window)),
        (beside, _window_at_rim(points[beside], window, radius)),
    ):
        spread = points[part][:, None] + offsets
        flat = spread.reshape(-1, 2)
        total = NodalField(shapes.nodes[:, :2], flat)(shapes.fine)
        total += NodalField(shapes.coarse_nodes[:, :2], flat)(shapes.correction)
        total = total.reshape(len(total), *spread.shape[:2], 3)
        # between the last nodes the rim's polygon cuts off a little more than the rim
        seen = np.isfinite(total[0, :, :, 0]) * weights
        total = np.where(seen[None, :, :, None] > 0.0, total, 0.0)
        out[:, part] = np.einsum("nw,fnwc->fnc", seen / seen.sum(axis=1, keepdims=True), total)
    return out


def _window(radius: float) -> tuple[Floats, Floats]:
    """Offsets (k, 2) mm and weights (k,) that average over a disc."""
    if radius <= 0.0:
        return np.zeros((1, 2)), np.ones(1)
    # Gauss-Legendre in the squared radius, even in the angle
    knots, shares = np.polynomial.legendre.leggauss(_RADII)
    distance = radius * np.sqrt(0.5 * (1.0 + knots))
    angle = 2 * np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets = (distance[:, None, None] * direction).reshape(-1, 2)
    return offsets, np.repeat(0.5 * shares / _ANGLES, _ANGLES)


def _window_at_rim(points: Floats, window: float, radius: float) -> tuple[Floats, Floats]:
    """Offsets (n, k, 2) mm and weights (n, k) over the arcs of a disc that lie inside the rim."""
    if window <= 0.0:
        return np.zeros((len(points), 1, 2)), np.ones((len(points), 1))
    away = np.hypot(*points.T)
    outwards = np.arctan2(points[:, 1], points[:, 0])
    knots, shares = np.polynomial.legendre.leggauss(_RIM_RADII)
    free = np.clip(radius - away, 0.0, window)  # rings up to here are whole
    offsets, weights = [], []
    for low, high in ((np.zeros_like(free), free), (free, np.full_like(free, window))):
        ring = low[:, None] + 0.5 * (high - low)[:, None] * (1.0 + knots)
        bound = (radius**2 - away[:, None] ** 2 - ring**2) / np.maximum(
            2 * away[:, None] * ring, 1e-9
        )
        cut = np.arccos(np.clip(bound, -1.0, 1.0))  # directions closer to outwards lie beyond
        share = (high - low)[:, None] * shares * ring * (np.pi - cut)
        steps = (np.arange(_RIM_ANGLES) + 0.5) / _RIM_ANGLES
        angle = outwards[:, None, None] + cut[..., None] + 2 * (np.pi - cut)[..., None] * steps
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        around = _RIM_RADII * _RIM_ANGLES
        offsets.append((ring[..., None, None] * direction).reshape(len(points), around, 2))
        weights.append(np.repeat(share / _RIM_ANGLES, _RIM_ANGLES, axis=1))
    return np.concatenate(offsets, axis=1), np.concatenate(weights, axis=1)


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
    rotation = Rotation.from_rotvec(turn + bar * turn_bar, degrees=True).as_matrix()
    moved = np.einsum("fij,fnj->fni", rotation, start + seen)
    return moved + (shift + bar * shift_bar)[:, None, :] - start


def _drift(drawn: Draw, time: Floats) -> Floats:
    """Shift (frames, 3) mm of a camera that drifts evenly in time."""
    whole = np.array([drawn.get(f"camera_drift.shift_{axis}") for axis in "xyz"])
    return ((time - time[0]) / (time[-1] - time[0]))[:, None] * whole


def _bent(drawn: Draw, points: Floats, radius: float) -> Floats:
    """Where a bent camera sees points (..., 2) mm."""
    square = (points**2).sum(axis=-1, keepdims=True) / radius**2
    return points * (1.0 + drawn.get("camera_bend.bend") * square)


def _unbent(drawn: Draw, seen: Floats, radius: float) -> Floats:
    """Where points (n, 2) mm lie that a bent camera sees at `seen`."""
    points = seen
    for _ in range(30):  # contracts by three times the bend
        points = points + seen - _bent(drawn, points, radius)
    return points


def noise(
    rng: Generator, points: Floats, frames: int, size: tuple[float, float], length: float
) -> Floats:
    """Noise (frames, n, 3) mm: four fifths independent, the rest correlated in space.

    The correlation of the rest falls as exp(-(d/length)²) with the distance d.

    Parameters
    ----------
    points : (n, 2) array, mm
    size : (in plane, out of plane), mm
        Standard deviations of the whole.
    length : float, mm
    """
    covariance = np.exp(-((cdist(points, points) / length) ** 2))
    smooth = np.linalg.cholesky(covariance + 1e-6 * np.eye(len(points)))
    own, common = rng.standard_normal((2, frames, len(points), 3))
    correlated = np.einsum("nm,fmc->fnc", smooth, common, optimize=True)
    mixed = _INDEPENDENT * own + np.sqrt(1.0 - _INDEPENDENT**2) * correlated
    return mixed * [size[0], size[0], size[1]]


def holes(rng: Generator, points: Floats, frames: int) -> NDArray[np.bool_]:
    """Points that are lost, (frames, n): holes that open, grow and wander, and stray points."""
    lost = rng.random((frames, len(points))) < 0.002
    lost[0] = False
    for _ in range(int(rng.integers(1, 4))):
        opens, final = int(rng.integers(1, 12)), rng.uniform(4.0, 10.0)
        centre = rng.uniform(-65.0, 65.0, size=2)
        for frame in range(opens, frames):
            centre = centre + rng.normal(0.0, 2.0, size=2)
            size = final * np.sqrt((frame - opens + 1) / (frames - opens))
            lost[frame] |= np.hypot(*(points - centre).T) < size
    return lost
