"""What do heights measured before inflation say? They are the shape itself, and data of their own.

They are z0 as the cameras report it, counted from a plane that is arbitrary (the axes of a report
are laid through the points), with the noise of heights in a frame, which the same cameras saw.
Beside the frames they stand as one frame more, of heights alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data

__all__ = ["height_rows", "off_planes", "plane_rows", "shown", "with_heights"]

Floats = NDArray[np.float64]


def with_heights(d: Data, rows: Floats, heights: Floats) -> Floats:
    """Rows (k, frames, points, 3) and (k, points) as rows of one frame more, where z was kept."""
    if d.heights is None:
        return rows
    more = np.zeros((len(rows), 1, *rows.shape[2:]))
    more[:, 0, :, 2] = heights
    return np.concatenate([rows, more], axis=1)


def height_rows(d: Data, values: Mapping[str, float], names: Sequence[str]) -> Floats:
    """Derivatives by names, and measured minus modelled last, in noise units: (names + 1, points).

    0 at points whose heights no frame has, and everywhere if they were not kept before inflation.
    """
    if d.heights is None:
        return np.zeros((len(names) + 1, d.used.shape[1]))
    modelled, derivative = d.specimen.heights(values, names)
    return np.asarray(np.vstack([derivative, d.heights - modelled]) * _weight(d))


def plane_rows(d: Data) -> Floats:
    """The same of planes that heights may be counted from, (3, points)."""
    x, y = d.specimen.reference[:, :2].T / d.specimen.test.radius
    return np.asarray(np.stack([np.ones(len(x)), x, y]) * _weight(d))


def shown(d: Data) -> Floats:
    """What an offset of a point adds to its rows (frames, points, 3), heights among them.

    A point that stands too high on the reference image rises by less in every frame.
    """
    frames = d.share[:, None, None] * d.used
    return with_heights(d, frames[None], -_seen(d).astype(np.float64)[None])[0]


def off_planes(rows: Floats, planes: Floats) -> Floats:
    """Rows (k, values), changed, without what planes (3, values) have of them.

    Any plane is as likely.
    """
    among = np.flatnonzero(planes.any(axis=0))
    along, _ = np.linalg.qr(planes[:, among].T)
    rows[:, among] -= (rows[:, among] @ along) @ along.T
    return rows


def _weight(d: Data) -> Floats:
    return np.asarray(_seen(d) / d.sigma[2])


def _seen(d: Data) -> NDArray[np.bool_]:
    """Points (n,) of which some frame has the height."""
    return np.asarray(d.used[..., 2].any(axis=0))
