"""The reference surface at the Gauss points: shape gradients in material axes, and areas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["GAUSS", "SHAPE", "SHAPE_ETA", "SHAPE_XI", "ReferenceSurface", "shape_functions"]

_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)

#: 2x2 Gauss points (xi, eta); each weighs 1.
GAUSS = _CORNERS / np.sqrt(3.0)


def shape_functions(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Bilinear shape functions and their xi, eta derivatives at `points` (g, 2): three (g, 4)."""
    along = 1.0 + points[:, None, :] * _CORNERS
    values = 0.25 * along[..., 0] * along[..., 1]
    by_xi = 0.25 * _CORNERS[:, 0] * along[..., 1]
    by_eta = 0.25 * _CORNERS[:, 1] * along[..., 0]
    return values, by_xi, by_eta


SHAPE, SHAPE_XI, SHAPE_ETA = shape_functions(GAUSS)


@dataclass(frozen=True, eq=False)
class ReferenceSurface:
    """The stress-free surface as the kernels need it.

    Attributes
    ----------
    gradient : (cells, 4 points, 4 nodes, 2) array, 1/mm
        Derivatives of the shape functions along the material axes in the tangent plane.
    area : (cells, 4 points) array, mm²
        Reference area that each Gauss point stands for.
    """

    gradient: NDArray[np.float64]
    area: NDArray[np.float64]

    @classmethod
    def of(
        cls, positions: NDArray[np.float64], cells: NDArray[np.int64], angle: float = 0.0
    ) -> ReferenceSurface:
        """Surface through `positions` (n, 3) mm, warp axis turned by `angle` (rad) from x.

        On a curved surface the warp axis is the projection of the turned x axis on the tangent
        plane; the fill axis is normal to it in that plane.
        """
        corners = positions[cells]
        by_xi = np.einsum("ga,max->mgx", SHAPE_XI, corners)
        by_eta = np.einsum("ga,max->mgx", SHAPE_ETA, corners)
        normal = np.cross(by_xi, by_eta)
        area = np.linalg.norm(normal, axis=-1)
        normal /= area[..., None]
        warp = np.array([np.cos(angle), np.sin(angle), 0.0])
        first = warp - normal * (normal @ warp)[..., None]
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        second = np.cross(normal, first)
        # J[i, j] = ∂(position along axis j)/∂(xi_i); gradients solve J G = ∂N/∂xi
        (a, b), (c, d) = (
            [np.einsum("mgx,mgx->mg", v, axis)[..., None] for axis in (first, second)]
            for v in (by_xi, by_eta)
        )
        along = np.stack([d * SHAPE_XI - b * SHAPE_ETA, a * SHAPE_ETA - c * SHAPE_XI], axis=-1)
        gradient = along / (a * d - b * c)[..., None]
        return cls(gradient, area)
