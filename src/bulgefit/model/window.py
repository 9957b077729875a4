"""The mean over the correlation window of DIC, as an operator on nodal fields.

A subset of radius w reports about the mean of the displacement over its disc, less what lies
beyond the rim. Away from the rim that is a weighted mean over two rings, beside it over strips of
what the rim leaves of the disc. The smooth field is laid once
on a square grid that is finer than the mesh, and cubic interpolation on the grid takes it to the
points of any window: moving the points or the window costs a hundredth of new splines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from bulgefit.model.smooth import SmoothField, smooth_field

__all__ = ["Window"]

Floats = NDArray[np.float64]

#: Weights (places, 4) of values on the grid, and of slopes times its spacing.
_Weights = tuple[Floats, Floats]

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


#: Newton steps to the nearest point of an ellipse: errors fall from 1 to 1e-12 within these.
_NEWTON_STEPS = 8

#: Strips on either side of where rim and window cross, and points along each strip.
_STRIPS, _ALONG = 5, 4


@dataclass(eq=False)
class Window:
    """Window means of fields on one mesh.

    Parameters
    ----------
    nodes : (n, 2) array, mm
        Where the rim is a circle.
    radius : float, mm
        Of the mesh; what lies beyond is not seen.
    ellipticity : float
        The rim's semi-axes in truth are radius (1 ± ellipticity), + along x.
    """

    nodes: Floats
    radius: float
    ellipticity: float = 0.0
    _grid: sparse.csr_array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._spacing = _SPACING * self.radius
        self._half = int(np.ceil(_REACH * (1.0 + abs(self.ellipticity)) / _SPACING))
        ticks = self._spacing * np.arange(-self._half, self._half + 1)
        points = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        self._stretch = np.array([1.0 + self.ellipticity, 1.0 - self.ellipticity])
        self._grid = smooth_field(self.nodes, points / self._stretch).value

    def mean(self, points: Floats, window: float) -> SmoothField:
        """Operators of the mean over discs of radius `window` (mm) round points (m, 2) mm.

        Points are given, and derivatives taken, where the rim is a circle.
        """
        sums, (x, by_x), (y, by_y) = self._sums(points * self._stretch, window)
        step_x, step_y = self._spacing / self._stretch
        return SmoothField(sums(x, y), sums(by_x / step_x, y), sums(x, by_y / step_y))

    def value(self, points: Floats, window: float) -> sparse.csr_array:
        """The operator of the mean's value alone."""
        sums, (x, _), (y, _) = self._sums(points * self._stretch, window)
        return sums(x, y)

    def _rim_circles(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """The rim beside each point as a circle: distance of its centre, radius, way out.

        Beside an ellipse it is the circle that osculates it at the nearest point of the rim.
        """
        if not self.ellipticity:
            distance = np.hypot(*points.T)
            out = points / np.maximum(distance, 1e-9)[:, None]
            return distance, np.full(len(points), self.radius), out
        a, b = semi_axes = self.radius * self._stretch
        angle = _nearest(points, semi_axes)
        c, s = np.cos(angle), np.sin(angle)
        rim = np.stack([a * c, b * s], axis=1)
        normal = np.stack([b * c, a * s], axis=1)
        size = np.hypot(*normal.T)
        out = normal / size[:, None]
        radius = size**3 / (a * b)
        return radius - np.einsum("mi,mi->m", rim - points, out), radius, out

    def _sums(
        self, points: Floats, window: float
    ) -> tuple[Callable[[Floats, Floats], sparse.csr_array], _Weights, _Weights]:
        """What makes an operator of weights along x and y at the windows' places; such weights."""
        distance, radius, out = self._rim_circles(points)
        beside = distance + window > radius
        places, shares, owners = [], [], []
        for which, (offsets, share) in (
            (np.flatnonzero(~beside), _whole(points[~beside], window)),
            (np.flatnonzero(beside), _cut(distance[beside], radius[beside], out[beside], window)),
        ):
            places.append((points[which][:, None] + offsets).reshape(-1, 2))
            shares.append(share.ravel())
            owners.append(np.repeat(which, offsets.shape[1]))
        share, owner = np.concatenate(shares), np.concatenate(owners)
        size = 2 * self._half + 1
        place = np.concatenate(places) / self._spacing + self._half
        base = np.clip(np.floor(place).astype(np.intp) - 1, 0, size - 4)
        steps = np.arange(4)
        columns = (base[:, 0, None, None] + steps[:, None]) * size + base[:, 1, None, None] + steps
        rows = np.broadcast_to(owner[:, None, None], columns.shape)

        def sums(along_x: Floats, along_y: Floats) -> sparse.csr_array:
            values = share[:, None, None] * along_x[:, :, None] * along_y[:, None, :]
            on_grid = sparse.csr_array(
                (values.ravel(), (rows.ravel(), columns.ravel())), shape=(len(points), size**2)
            )
            return (on_grid @ self._grid).tocsr()

        return sums, _lagrange(place[:, 0] - base[:, 0]), _lagrange(place[:, 1] - base[:, 1])


def _nearest(points: Floats, semi_axes: Floats) -> Floats:
    """Angles (m,) of the ellipse's points nearest to points (m, 2) within it.

    The distance is stationary there: Newton's steps on its derivative, from the angle of the
    point's image on the circle, which settle beside the rim.
    """
    a, b = semi_axes
    x, y = points.T
    angle = np.arctan2(y / b, x / a)
    for _ in range(_NEWTON_STEPS):
        c, s = np.cos(angle), np.sin(angle)
        slope = (b * b - a * a) * s * c + a * x * s - b * y * c
        bend = (b * b - a * a) * (c * c - s * s) + a * x * c + b * y * s
        angle = angle - slope / np.where(np.abs(bend) > 1e-9 * a * b, bend, np.inf)
    return angle


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


def _lagrange(t: Floats) -> _Weights:
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
