"""What a camera gets wrong at random: noise, and points that are lost."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

__all__ = ["holes", "noise"]

Floats = NDArray[np.float64]

#: Share of the noise that differs from point to point; the rest is correlated.
_INDEPENDENT = 0.8


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
