"""What are strain and curvature of a surface whose derivatives are known?

A point X of the surface before inflation comes to x(X). With the tangents a_i = ∂x/∂X_i, those of
the reference A_i, C = a_i . a_j in an orthonormal frame of the reference surface and U² = C, the
Hencky strain is ln U, and the curvature is -U^-1 (n . ∂²x/∂X_i∂X_j) U^-1 with the normal n to +z:
in the frame that goes with the fabric, positive where it is domed (do Carmo, Differential Geometry
of Curves and Surfaces, 1976, ch. 3).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["flattening", "metric", "normal", "second_form", "slopes_of", "strain_and_curvature"]

Floats = NDArray[np.float64]

#: Share of the size of what is changed by which differences are taken.
_STEP = 1e-5


def metric(tangents: Floats) -> Floats:
    """a_i . a_j (..., 2, 2) of tangents (..., 2, 3)."""
    return np.asarray(tangents @ tangents.swapaxes(-1, -2))


def flattening(tangents: Floats) -> Floats:
    """A^(-1/2) (..., 2, 2): what makes the reference's tangents (..., 2, 3) orthonormal."""
    return _inverse(_root(metric(tangents)))


def normal(tangents: Floats) -> Floats:
    """Unit normal (..., 3), to +z where the surface does not overhang."""
    across = np.cross(tangents[..., 0, :], tangents[..., 1, :])
    return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))


def second_form(derivatives: Floats) -> Floats:
    """n . ∂²x/∂X_i∂X_j (..., 2, 2), 1/mm, of derivatives (..., 6, 3)."""
    bent = (derivatives[..., 3:, :] @ normal(derivatives[..., 1:3, :])[..., None])[..., 0]
    return np.stack([bent[..., [0, 1]], bent[..., [1, 2]]], axis=-2)


def strain_and_curvature(derivatives: Floats, flat: Floats) -> Floats:
    """Strain xx, yy, xy (1), curvature xx, yy, xy (1/mm) and the ratio of areas, (..., 7).

    Parameters
    ----------
    derivatives : (..., 6, 3) array
        x and its ∂x, ∂y, ∂xx, ∂xy, ∂yy by the reference position in the plane, mm.
    flat : (..., 2, 2) array
        `flattening` of the reference surface.
    """
    tangents = derivatives[..., 1:3, :]
    c = flat @ metric(tangents) @ flat
    back = _inverse(_root(c))
    curvature = -back @ (flat @ second_form(derivatives) @ flat) @ back
    strain = 0.5 * _logarithm(c)
    area = np.sqrt(_determinant(c))
    return np.stack([*_entries(strain), *_entries(curvature), area], axis=-1)


def slopes_of(
    function: Callable[[Floats], Floats], derivatives: Floats, reach: float
) -> tuple[Floats, Floats]:
    """A function (..., k) of each centre's own derivatives, and its slopes (..., k, 6, 3) by them.

    Parameters
    ----------
    function : callable
        From (..., 6, 3) to (..., k).
    derivatives : (..., 6, 3) array, mm
    reach : float, mm
        Length over which they change: it makes a step of each order.
    """
    first = function(derivatives)
    out = np.empty((*first.shape, *derivatives.shape[-2:]))
    orders = (0, 1, 1, 2, 2, 2)
    for row, column in np.ndindex(*derivatives.shape[-2:]):
        step = _STEP * reach ** (1 - orders[row])
        ends = []
        for sign in (1.0, -1.0):
            moved = derivatives.copy()
            moved[..., row, column] += sign * step
            ends.append(function(moved))
        out[..., row, column] = (ends[0] - ends[1]) / (2.0 * step)
    return first, out


def _entries(tensor: Floats) -> tuple[Floats, Floats, Floats]:
    return tensor[..., 0, 0], tensor[..., 1, 1], tensor[..., 0, 1]


def _determinant(tensor: Floats) -> Floats:
    return np.asarray(tensor[..., 0, 0] * tensor[..., 1, 1] - tensor[..., 0, 1] * tensor[..., 1, 0])


def _inverse(tensor: Floats) -> Floats:
    a, b, c, d = (tensor[..., i, j] for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)))
    adjoint = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return np.asarray(adjoint / _determinant(tensor)[..., None, None])


def _root(tensor: Floats) -> Floats:
    """Square root of a positive (..., 2, 2): (C + s I)/sqrt(tr C + 2 s), s² = det C."""
    s = np.sqrt(_determinant(tensor))[..., None, None]
    trace = (tensor[..., 0, 0] + tensor[..., 1, 1])[..., None, None]
    return np.asarray((tensor + s * np.eye(2)) / np.sqrt(trace + 2.0 * s))


def _logarithm(tensor: Floats) -> Floats:
    """ln C of a positive (..., 2, 2): ln(det C)/2 I + atanh(q)/(q m) (C - m I), m = tr C/2."""
    m = 0.5 * (tensor[..., 0, 0] + tensor[..., 1, 1])
    determinant = _determinant(tensor)
    square = np.maximum(1.0 - determinant / m**2, 0.0)
    q = np.sqrt(np.maximum(square, 1e-8))
    # a series where both stretches are nearly equal
    ratio = np.where(square > 1e-6, np.arctanh(q) / q, 1.0 + square / 3.0 + square**2 / 5.0)
    even = (0.5 * np.log(determinant))[..., None, None] * np.eye(2)
    apart = tensor - m[..., None, None] * np.eye(2)
    return np.asarray(even + (ratio / m)[..., None, None] * apart)
