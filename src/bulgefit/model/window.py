"""The mean over the correlation window of DIC, as an operator on nodal fields.

A subset of radius w reports about the mean of the displacement over its disc on the fabric, less
what lies beyond the rim. Away from the rim that is a weighted mean over two rings, beside it over
strips of what the rim leaves of the disc. The smooth field is laid once on a square grid over the
mesh's disc that is finer than the mesh, and cubic interpolation on the grid takes it to the points
of any window: moving the points, the window or the rim costs a hundredth of new splines.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.model.observation import applied
from bulgefit.model.opening import Opening
from bulgefit.model.smooth import smooth_value

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


#: Strips on either side of where rim and window cross, and points along each strip. Eight give the
#: squared radius of a window that just touches the rim to 4e-6, five to 1 %: there its mean would
#: leap, by more than it changes over the span of a difference.
_STRIPS, _ALONG = 8, 4


@dataclass(eq=False)
class Window:
    """Window means of fields on one mesh.

    Parameters
    ----------
    nodes : (n, 2) array, mm
        Of a disc.
    radius : float, mm
        Of that; what lies beyond is not seen.
    """

    nodes: Floats
    radius: float
    _grid: sparse.csr_array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._spacing = _SPACING * self.radius
        self._half = int(np.ceil(_REACH / _SPACING))
        ticks = self._spacing * np.arange(-self._half, self._half + 1)
        points = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        self._grid = smooth_value(self.nodes, points)

    def value(self, unit: Floats, window: float, opening: Opening) -> sparse.csr_array:
        """The operator (m, n) of the mean over discs of radius `window` (mm) on the fabric.

        Round the places of points (m, 2) of the unit disc.
        """
        return (self.on_grid(unit, window, opening) @ self._grid).tocsr()

    def laid(self, field: Floats) -> Floats:
        """A field (frames, n, 3) of the nodes on the grid, (frames, grid, 3)."""
        return applied(self._grid, field)

    def on_grid(self, unit: Floats, window: float, opening: Opening) -> sparse.csr_array:
        """The same of a field that is `laid` on the grid, (m, grid): for one field alone sooner."""
        points = opening.fabric(unit)
        distance, radius, out = opening.rim_circles(points)
        beside = distance + window > radius
        places, shares, owners = [], [], []
        for which, (offsets, share) in (
            (np.flatnonzero(~beside), _whole(points[~beside], window)),
            (np.flatnonzero(beside), _cut(distance[beside], radius[beside], out[beside], window)),
        ):
            places.append((points[which][:, None] + offsets).reshape(-1, 2))
            shares.append(share.ravel())
            owners.append(np.repeat(which, offsets.shape[1]))
        owner = np.concatenate(owners)
        # point by point, as the rows of the operator are
        order = np.argsort(owner, kind="stable")
        share = np.concatenate(shares)[order]
        size = 2 * self._half + 1
        on_disc = self.radius * opening.unit(np.concatenate(places)[order])
        place = on_disc / self._spacing + self._half
        base = np.clip(np.floor(place).astype(np.intp) - 1, 0, size - 4)
        steps = np.arange(4)
        columns = (base[:, 0, None, None] + steps[:, None]) * size + base[:, 1, None, None] + steps
        ends = len(steps) ** 2 * np.cumsum(np.bincount(owner, minlength=len(points)))
        x, y = _lagrange(place[:, 0] - base[:, 0]), _lagrange(place[:, 1] - base[:, 1])
        values = share[:, None, None] * x[:, :, None] * y[:, None, :]
        return sparse.csr_array(
            (values.ravel(), columns.ravel(), np.append(0, ends)), shape=(len(points), size**2)
        )


def _whole(points: Floats, window: float) -> tuple[Floats, Floats]:
    """Offsets (m, k, 2) mm and shares (m, k) of the whole disc."""
    count = len(points)
    return (
        np.broadcast_to(window * _POINTS, (count, *_POINTS.shape)),
        np.broadcast_to(_SHARES, (count, len(_SHARES))),
    )


def _cut(distance: Floats, radius: Floats, out: Floats, window: float) -> tuple[Floats, Floats]:
    """Offsets and shares of the part of the disc inside the rim, in strips along the rim.

    The rim is a circle of `radius` (m,) about a centre at `distance` (m,), against `out` (m, 2).

    With u outwards from the point, a strip ends at the window up to u*, where both circles cross,
    and at the rim beyond. Angles of the two circles as variables make the integrands smooth.
    """
    distance = np.minimum(distance, radius)  # registered beyond the rim: on it
    distance = np.maximum(distance, 1e-9)
    crossing = (radius**2 - distance**2 - window**2) / (2.0 * distance)
    knots, weights = np.polynomial.legendre.leggauss(_STRIPS)
    knots, weights = 0.5 * (knots + 1.0), 0.5 * weights

    end = np.arcsin(np.clip(crossing / window, -1.0, 1.0))
    span = end + 0.5 * np.pi
    angle = span[:, None] * knots - 0.5 * np.pi
    outwards = window * np.sin(angle)
    half = window * np.cos(angle)
    share = span[:, None] * weights * half * half

    start = np.arccos(np.clip((distance + crossing) / radius, -1.0, 1.0))
    angle = start[:, None] * knots
    outwards = np.hstack([outwards, radius[:, None] * np.cos(angle) - distance[:, None]])
    rim_half = radius[:, None] * np.sin(angle)
    half = np.hstack([half, rim_half])
    share = np.hstack([share, start[:, None] * weights * rim_half * rim_half])

    along, along_weights = np.polynomial.legendre.leggauss(_ALONG)
    u = np.repeat(outwards, _ALONG, axis=1)
    v = (half[..., None] * along).reshape(u.shape)
    share = (share[..., None] * along_weights).reshape(u.shape)
    aside = np.stack([-out[:, 1], out[:, 0]], axis=1)
    offsets = u[..., None] * out[:, None] + v[..., None] * aside[:, None]
    return offsets, share / share.sum(axis=1, keepdims=True)


def _lagrange(t: Floats) -> Floats:
    """Weights (..., 4) of values at 0, 1, 2, 3 for the place t."""
    a, b, c, d = t, t - 1.0, t - 2.0, t - 3.0
    weights = [-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0]
    return np.stack(weights, axis=-1)
