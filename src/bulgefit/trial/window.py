"""What a window of the correlation sees of a displacement: its average, inside the rim."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import Delaunay

from bulgefit.trial.fabric import Shapes

__all__ = ["NodalField", "averaged", "upright"]

Floats = NDArray[np.float64]

#: Radii and angles at which a correlation window is averaged, and beside the rim, where what is
#: seen has corners.
_RADII, _ANGLES = 3, 12
_RIM_RADII, _RIM_ANGLES = 4, 96
#: Half the step (mm) of differences of places, of third order in it.
_STEP = 0.02
#: Of a window of millimetres: to a nanometre.
_HALVINGS = 24


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


def upright(nodes: Floats, points: Floats) -> Floats:
    """Unit normals (n, 3) of the fabric at rest, nodes (m, 3) mm, at points (n, 2) mm."""
    (there,) = _normals([(nodes[:, :2], nodes[None])], points)
    return there


def averaged(
    shapes: Shapes, points: Floats, window: float, rim: Floats, above: float = 0.0
) -> Floats:
    """Displacement (frames, n, 3) mm of the fabric at points, averaged over a window (mm).

    `rim` (k, 2) mm goes once round the opening; beyond it nothing is seen, and what stands there
    is not seen (NaN). What is seen stands off the fabric by `above` (mm), along its normal.
    """
    edge = _Edge.of(rim)
    inwards = edge.inwards(points)
    inside = inwards > 0.0
    beside = inside & (inwards <= window + edge.unevenness)
    out = np.full((len(shapes.fine), len(points), 3), np.nan)
    for part, (offsets, weights) in (
        (inside & ~beside, _window(window)),
        (beside, _window_at_rim(points[beside], window, edge)),
    ):
        spread = points[part][:, None] + offsets
        flat = spread.reshape(-1, 2)
        total = NodalField(shapes.nodes[:, :2], flat)(shapes.fine)
        total += NodalField(shapes.coarse_nodes[:, :2], flat)(shapes.correction)
        if above != 0.0:
            moved = (shapes.nodes[:, :2], shapes.nodes + shapes.fine)
            corrected = (shapes.coarse_nodes[:, :2], shapes.correction)
            total += above * (_normals([moved, corrected], flat) - upright(shapes.nodes, flat))
        total = total.reshape(len(total), *spread.shape[:2], 3)
        # between the last nodes the rim's polygon cuts off a little more than the rim
        seen = np.isfinite(total[0, :, :, 0]) * weights
        total = np.where(seen[None, :, :, None] > 0.0, total, 0.0)
        share = seen / np.maximum(seen.sum(axis=1, keepdims=True), 1e-300)
        out[:, part] = np.einsum("nw,fnwc->fnc", share, total)
    return out


def _normals(fields: list[tuple[Floats, Floats]], points: Floats) -> Floats:
    """Unit normals (k, n, 3) at points (n, 2) mm of places that are the sum of nodal fields."""

    def at(step: Floats) -> Floats:
        parts = [NodalField(nodes, points + step)(values) for nodes, values in fields]
        return np.asarray(sum(parts))

    along_x, along_y = (at(step) - at(-step) for step in _STEP * np.eye(2))
    normal = np.cross(along_x, along_y)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


@dataclass(frozen=True)
class _Edge:
    """A closed curve round the origin: its distance (k,) mm over the angle (k,)."""

    angle: Floats
    distance: Floats

    @classmethod
    def of(cls, rim: Floats) -> _Edge:
        angle = np.arctan2(rim[:, 1], rim[:, 0])
        order = np.argsort(angle)
        return cls(angle[order], np.hypot(*rim.T)[order])

    @property
    def unevenness(self) -> float:
        return float(np.ptp(self.distance))

    def inwards(self, places: Floats) -> Floats:
        """By how much (...) mm places (..., 2) lie nearer to the origin than the curve."""
        angle = np.arctan2(places[..., 1], places[..., 0])
        out = np.interp(angle, self.angle, self.distance, period=2.0 * np.pi)
        return np.asarray(out - np.hypot(places[..., 0], places[..., 1]))

    def ahead(self, points: Floats, direction: Floats, most: float) -> Floats:
        """How far (n, k) mm the curve is from points (n, 2) inside it; `most` mm at most.

        By bisection along each of the directions (k, 2).
        """
        low = np.zeros((len(points), len(direction)))
        high = np.full_like(low, most)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            inside = self.inwards(points[:, None] + middle[..., None] * direction) > 0.0
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        return 0.5 * (low + high)


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


def _window_at_rim(points: Floats, window: float, edge: _Edge) -> tuple[Floats, Floats]:
    """Offsets (n, k, 2) mm and weights (n, k) over the rays of a disc, as far as the rim."""
    if window <= 0.0:
        return np.zeros((len(points), 1, 2)), np.ones((len(points), 1))
    angle = 2 * np.pi * (np.arange(_RIM_ANGLES) + 0.5) / _RIM_ANGLES
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = edge.ahead(points, direction, window)
    knots, shares = np.polynomial.legendre.leggauss(_RIM_RADII)
    distance = reach[..., None] * 0.5 * (1.0 + knots)
    weights = reach[..., None] * shares * distance
    offsets = distance[..., None] * direction[:, None]
    around = _RIM_ANGLES * _RIM_RADII
    return offsets.reshape(len(points), around, 2), weights.reshape(len(points), around)
