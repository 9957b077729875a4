"""What do nodes on three meshes say of the mesh's error, and of what is left once it is off?

The error of balanced nodes falls with the square of the cell size h (Richardson, 1911), so the
difference between two meshes tells that of either. Extrapolation from cells of sizes h and k leaves
an error in h²k²: that of a rougher pair over that of the finer one is (h_rough/h_fine)².
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["agrees", "coarser", "finer", "left_over", "taken_off", "told_by_coarser"]

Floats = NDArray[np.float64]


def finer(refine: int) -> int:
    """The mesh that tells the error of one."""
    return refine + max(1, refine // 2)


def coarser(refine: int) -> int:
    """The mesh that judges what is left."""
    return max(1, refine - max(1, refine // 4))


def taken_off(refine: int, here: Floats, there: Floats) -> Floats:
    """What takes the error off nodes (..., n, 3) mm, by those of the finer mesh."""
    ratio = (finer(refine) / refine) ** 2
    return np.asarray((there - here) * ratio / (ratio - 1.0))


def told_by_coarser(refine: int, here: Floats, coarse: Floats) -> Floats | None:
    """What takes the error off nodes (..., n, 3) mm, by those of the coarser mesh, if there is one.

    It is off by more than what the finer mesh tells.
    """
    low = coarser(refine)
    if low == refine:
        return None
    return np.asarray((here - coarse) / ((refine / low) ** 2 - 1.0))


def agrees(correction: Floats, other: Floats | None) -> NDArray[np.bool_]:
    """Whether corrections (frames, n, 3) mm leave less of what the coarser mesh tells than none do.

    Where the error falls as it should they leave a small part of that, whatever it is; where shapes
    are each mesh's own, two differences between meshes have nothing to do with each other.
    """
    if other is None:
        return np.zeros(len(correction), dtype=bool)
    left, whole = (np.linalg.norm(x, axis=(1, 2)) for x in (other - correction, other))
    return np.asarray(left < whole)


def left_over(refine: int, here: Floats, correction: Floats, coarse: Floats) -> Floats | None:
    """What the correction leaves (..., n, 3) mm, by the coarser mesh; None where there is none."""
    other = told_by_coarser(refine, here, coarse)
    if other is None:
        return None
    low, high = coarser(refine), finer(refine)
    return np.asarray((other - correction) / ((high / low) ** 2 - 1.0))
