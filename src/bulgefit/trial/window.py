"""What a window of the correlation sees of a displacement: its average, inside the rim."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import Delaunay

from bulgefit.trial.fabric import Shapes

__all__ = ["NodalField", "averaged"]

Floats = NDArray[np.float64]

#: Radii and angles at which a correlation window is averaged, and beside the rim.
_RADII, _ANGLES = 3, 12
_RIM_RADII, _RIM_ANGLES = 6, 24


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


def averaged(shapes: Shapes, points: Floats, window: float, radius: float) -> Floats:
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
