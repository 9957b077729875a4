"""Are the positions of a file those before inflation, or those at the frame? The numbers tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bulgefit.dic.formats.frames import Frame

__all__ = ["CURRENT", "POSITIONS", "REFERENCE", "Evidence", "evidence", "spacing"]

Floats = NDArray[np.floating]

REFERENCE, CURRENT = "reference", "current"
POSITIONS = (REFERENCE, CURRENT)
# Two positions are one point up to this part of the spacing between points. DIC scatters by 0.01
# to 0.05 pixels (Bornert et al. 2009, Exp. Mech. 49, 353) and its points stand 5 and more pixels
# apart: what is called one point by mistake is moved by less than the noise.
SAME = 1e-3


@dataclass(frozen=True)
class Evidence:
    """What two frames say of the positions.

    Attributes
    ----------
    says : str or None
        "reference" (x1 = x0), "current" (x1 = x0 + u), or None where the numbers cannot tell.
    reference, current : float
        What each reading leaves unexplained: the median distance in mm where points have ids,
        else the part of the points that it does not bring to the same place.
    """

    says: str | None
    reference: float
    current: float


def evidence(frames: list[Frame]) -> Evidence | None:
    """Compare the least with the most displaced frame; None where there are no two frames.

    With ids the pairs are known, and the reading is taken that leaves less than half of the
    movement where the other leaves more: that is, the nearer one. Without, one of the readings has
    to bring more than half of the points to where the other frame has points, and the other not.
    """
    moved = [frame for frame in frames if len(frame.position)]
    if len(moved) < 2:
        return None
    size = [float(np.nanmedian(np.abs(frame.displacement))) for frame in moved]
    least, most = moved[int(np.argmin(size))], moved[int(np.argmax(size))]
    if least is most:
        return Evidence(None, 0.0, 0.0)
    if least.ids is not None and most.ids is not None:
        return _of_pairs(least, most)
    return _of_places(least, most)


def _of_pairs(least: Frame, most: Frame) -> Evidence:
    assert least.ids is not None
    assert most.ids is not None
    where = {tuple(row): i for i, row in enumerate(least.ids.tolist())}
    keys = [tuple(row) for row in most.ids.tolist()]
    pairs = [(where[key], i) for i, key in enumerate(keys) if key in where]
    if not pairs:
        return Evidence(None, 0.0, 0.0)
    a, b = np.array(pairs).T
    change = most.position[b] - least.position[a]
    movement = most.displacement[b] - least.displacement[a]
    size = _median_length(movement)
    reference, current = _median_length(change), _median_length(change - movement)
    says = None
    if reference < size / 2 < current:
        says = REFERENCE
    elif current < size / 2 < reference:
        says = CURRENT
    return Evidence(says, reference, current)


def _of_places(least: Frame, most: Frame) -> Evidence:
    near = SAME * spacing(least.position)
    apart = [
        _part_apart(least.position, most.position, near),
        _part_apart(least.position - least.displacement, most.position - most.displacement, near),
    ]
    says = None
    if apart[0] < 0.5 < apart[1]:
        says = REFERENCE
    elif apart[1] < 0.5 < apart[0]:
        says = CURRENT
    return Evidence(says, *apart)


def spacing(points: Floats) -> float:
    """Median distance of points (n, 3) from their nearest neighbours; 0 for a single one."""
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < 2:
        return 0.0
    distance, _ = cKDTree(known).query(known, k=2)
    return float(np.median(distance[:, 1]))


def _part_apart(fixed: Floats, others: Floats, near: float) -> float:
    fixed = fixed[np.isfinite(fixed).all(axis=1)]
    others = others[np.isfinite(others).all(axis=1)]
    if not len(fixed) or not len(others):
        return 1.0
    distance, _ = cKDTree(fixed).query(others)
    return float((distance > near).mean())


def _median_length(vectors: Floats) -> float:
    known = vectors[np.isfinite(vectors).all(axis=1)]
    return float(np.median(np.linalg.norm(known, axis=1))) if len(known) else 0.0
