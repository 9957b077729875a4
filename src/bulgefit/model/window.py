"""The mean over the correlation window of DIC, as an operator on nodal fields.

A subset of radius w reports about the mean of the displacement over its disc. Here that is a
weighted mean over two rings; what lies beyond the rim drops out. The smooth field is laid once
on a square grid that is finer than the mesh, and cubic interpolation on the grid takes it to the
points of any window: moving the points or the window costs a hundredth of new splines.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.model.smooth import SmoothField, smooth_field

__all__ = ["Window"]

Floats = NDArray[np.float64]

#: Spacing of the grid over the mesh's radius, and how far the grid reaches beyond it.
_SPACING, _REACH = 0.025, 1.08

#: Gauss's two points in the squared radius, in which a disc's area is even, as rings of 6 and 12.
_RINGS = ((np.sqrt(0.5 - np.sqrt(1.0 / 12.0)), 6), (np.sqrt(0.5 + np.sqrt(1.0 / 12.0)), 12))
#: Points of the window, in its radius, and their shares: exact for polynomials of degree 5.
_POINTS = np.concatenate(
    [
        r * np.stack([np.cos(a), np.sin(a)], axis=1)
        for r, n in _RINGS
        for a in [2 * np.pi * (np.arange(n) + 0.25 * n / 6) / n]
    ]
)
_SHARES = np.concatenate([np.full(n, 0.5 / n) for _, n in _RINGS])


@dataclass(eq=False)
class Window:
    """Window means of fields on one mesh.

    Parameters
    ----------
    nodes : (n, 2) array, mm
    radius : float, mm
        Of the mesh; what lies beyond is not seen.
    """

    nodes: Floats
    radius: float
    _grid: sparse.csr_array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._spacing = _SPACING * self.radius
        self._half = int(np.ceil(_REACH / _SPACING))
        ticks = self._spacing * np.arange(-self._half, self._half + 1)
        points = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        self._grid = smooth_field(self.nodes, points).value

    def mean(self, points: Floats, window: float) -> SmoothField:
        """Operators of the mean over discs of radius `window` (mm) round points (m, 2) mm."""
        spread = points[:, None] + window * _POINTS
        inside = (spread**2).sum(axis=-1) <= self.radius**2
        inside |= ~inside.any(axis=1, keepdims=True)  # registered wholly beyond: nothing drops out
        share = inside * _SHARES
        share = share / share.sum(axis=1, keepdims=True)

        size = 2 * self._half + 1
        place = spread / self._spacing + self._half
        base = np.clip(np.floor(place).astype(np.intp) - 1, 0, size - 4)
        (x, by_x), (y, by_y) = (_lagrange(place[..., k] - base[..., k]) for k in (0, 1))
        steps = np.arange(4)
        columns = (base[..., 0, None, None] + steps[:, None]) * size
        columns = columns + base[..., 1, None, None] + steps
        rows = np.broadcast_to(np.arange(len(points))[:, None, None, None], columns.shape)

        def operator(along_x: Floats, along_y: Floats) -> sparse.csr_array:
            values = share[..., None, None] * along_x[..., :, None] * along_y[..., None, :]
            on_grid = sparse.csr_array(
                (values.ravel(), (rows.ravel(), columns.ravel())), shape=(len(points), size**2)
            )
            return (on_grid @ self._grid).tocsr()

        return SmoothField(
            operator(x, y),
            operator(by_x / self._spacing, y),
            operator(x, by_y / self._spacing),
        )


def _lagrange(t: Floats) -> tuple[Floats, Floats]:
    """Weights (..., 4) of values at 0, 1, 2, 3 for the place t, and their derivatives."""
    a, b, c, d = t, t - 1.0, t - 2.0, t - 3.0
    weights = [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0]
    slopes = [
        -(b * c + b * d + c * d) / 6.0,
        (a * c + a * d + c * d) / 2.0,
        -(a * b + a * d + b * d) / 2.0,
        (a * b + a * c + b * c) / 6.0,
    ]
    return np.stack(weights, axis=-1), np.stack(slopes, axis=-1)
