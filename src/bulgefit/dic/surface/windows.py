"""How is a field of points differentiated? By a quartic over the points of a window.

A quartic is fitted by least squares to the points within a radius of a centre (the local polynomial
regression of Cleveland and Devlin, JASA 83, 1988, with even weights); its value and derivatives
at the centre are weighted sums of what was measured. Over a window that is whole, slopes are off by
the field's fifth derivatives and second derivatives by its sixth, both by the fourth power of the
window's radius; a cubic would leave curvature off by its square, by 0.2 % for a fifth of the
clamp's radius. Noise falls with the window's radius and the root of its points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEGREE", "ORDERS", "Windows", "fewest_points", "windows"]

Floats = NDArray[np.float64]

#: Of the polynomial.
DEGREE = 4
#: Value, ∂x, ∂y, ∂xx, ∂xy, ∂yy.
ORDERS = 6
#: A window's points must spread in the plane: condition of the normal equations in its radius.
_WORST_CONDITION = 1e8
#: Weights held at once.
_AT_ONCE = 2_000_000


def fewest_points(degree: int = DEGREE) -> int:
    """Points of a window: with twice as many as the polynomial has numbers it still averages."""
    return (degree + 1) * (degree + 2)


@dataclass(frozen=True, eq=False)
class Windows:
    """Weighted sums that give value and derivatives at centres.

    Attributes
    ----------
    neighbours : (c, m) int array
        Points of each window; 0 where there are fewer.
    weights : (c, 6, m) array, 1, 1/mm, 1/mm²
        Of value, ∂x, ∂y, ∂xx, ∂xy, ∂yy; NaN where a window has too few points.
    """

    neighbours: NDArray[np.intp]
    weights: Floats

    def __call__(self, values: NDArray[np.floating]) -> Floats:
        """Value and derivatives (..., c, 6, k) of what was measured at the points (..., n, k)."""
        near = values[..., self.neighbours, :].astype(np.float64)
        return np.asarray(self.weights @ near)

    def covariance(self) -> Floats:
        """(c, 6, 6), of independent unit noise, of each window alone."""
        return np.asarray(self.weights @ self.weights.swapaxes(1, 2))

    def shared(self, some: slice) -> Floats:
        """(k, k) covariance of all six values of some windows, which share points."""
        from scipy import sparse

        weights = self.weights[some]
        weights = weights.reshape(len(weights) * ORDERS, weights.shape[2])
        columns = np.repeat(self.neighbours[some], ORDERS, axis=0)
        rows = np.broadcast_to(np.arange(len(weights))[:, None], columns.shape)
        count = int(self.neighbours.max(initial=0)) + 1
        matrix = sparse.csr_array(
            (weights.ravel(), (rows.ravel(), columns.ravel())), shape=(len(weights), count)
        )
        return np.asarray((matrix @ matrix.T).toarray())


def windows(points: Floats, centres: Floats, radius: float, degree: int = DEGREE) -> Windows:
    """Windows of a radius (mm) round centres (c, 2) among points (n, 2), mm."""
    from scipy.spatial import KDTree

    inside = KDTree(points).query_ball_point(centres, radius, return_sorted=True)
    widest = max((len(one) for one in inside), default=0)
    neighbours = np.zeros((len(centres), widest), dtype=np.intp)
    used = np.zeros((len(centres), widest), dtype=bool)
    for row, one in enumerate(inside):
        neighbours[row, : len(one)] = one
        used[row, : len(one)] = True
    weights = np.full((len(centres), ORDERS, widest), np.nan)
    terms = fewest_points(degree) // 2
    chunk = max(1, _AT_ONCE // max(1, widest * terms))
    enough = np.flatnonzero(used.sum(axis=1) >= fewest_points(degree))
    for start in range(0, len(enough), chunk):
        rows = enough[start : start + chunk]
        place = (points[neighbours[rows]] - centres[rows, None]) / radius
        weights[rows] = _weights(place, used[rows], degree) / _units(radius)[:, None]
    return Windows(neighbours, weights)


def _weights(place: Floats, used: NDArray[np.bool_], degree: int) -> Floats:
    """Of the polynomial's first six numbers, (c, 6, m), in the window's radius."""
    x, y = place[..., 0], place[..., 1]
    powers = [(total - j, j) for total in range(degree + 1) for j in range(total + 1)]
    basis = np.stack([x**i * y**j for i, j in powers], axis=-1) * used[..., None]
    transposed = basis.swapaxes(1, 2)
    normal = transposed @ basis
    found = np.full((len(place), ORDERS, place.shape[1]), np.nan)
    good = np.linalg.cond(normal) < _WORST_CONDITION
    found[good] = np.linalg.solve(normal[good], transposed[good])[:, :ORDERS]
    return found


def _units(radius: float) -> Floats:
    """From a polynomial's numbers in the window's radius to derivatives in mm, as divisors."""
    return np.array([1.0, radius, radius, radius**2 / 2, radius**2, radius**2 / 2])
