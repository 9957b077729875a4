"""Which measured points cannot be right? Those far off what their neighbours say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["stray_points"]

Floats = NDArray[np.floating]

# A point is stray where it departs from the median of its neighbours by this many robust
# standard deviations of the neighbours among themselves,
_LIMIT = 10.0
# to which this is added, mm: neighbours may agree by chance, or in made data without noise.
_FLOOR = 0.02
_NEIGHBOURS = 12
# Degree of the polynomial taken off before neighbours are compared. It removes most of the slope
# of the bulge, which near the rim would hide strays in the scatter of the neighbours.
_DEGREE = 6
_FEWEST_POINTS = 60


def stray_points(reference: Floats, displacement: Floats, radius: float) -> NDArray[np.bool_]:
    """Points of one frame that depart from the median of their neighbours.

    This is the normalised median test of particle image velocimetry (Westerweel and Scarano,
    Experiments in Fluids 39, 2005): the scatter of the neighbours sets the scale, so that folds
    and steep parts of the bulge are not taken for strays.

    Parameters
    ----------
    reference, displacement : (n, 3) arrays, mm
        NaN where a component was lost.
    radius : float, mm
        Clamp radius.

    Returns
    -------
    (n,) bool array
        All false where a component has fewer than 60 measured points.
    """
    stray = np.zeros(len(reference), dtype=bool)
    for component in displacement.T:
        known = np.flatnonzero(np.isfinite(component))
        if len(known) >= _FEWEST_POINTS:
            stray[known] |= _is_stray(reference[known, :2], component[known], radius)
    return stray


def _is_stray(position: Floats, values: Floats, radius: float) -> NDArray[np.bool_]:
    from scipy.spatial import KDTree
    from scipy.stats import median_abs_deviation

    basis = _polynomials(position / radius)
    rest = values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
    _, nearest = KDTree(position).query(position, k=_NEIGHBOURS + 1)
    neighbours = rest[nearest[:, 1:]]
    median = np.median(neighbours, axis=1)
    scatter = median_abs_deviation(neighbours, axis=1, scale="normal")
    return np.abs(rest - median) > _LIMIT * (scatter + _FLOOR)


def _polynomials(position: Floats) -> Floats:
    # Chebyshev products stay well conditioned at this degree, monomials do not
    x, y = (np.polynomial.chebyshev.chebvander(axis, _DEGREE) for axis in position.T)
    return np.column_stack(
        [x[:, i] * y[:, j] for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    )
