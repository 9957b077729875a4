"""How high did the cloth stand before inflation, by what the model says of shape and reference?

The reference image showed the stress-free shape and what the fabric was displaced by in it:
z0 + u_ref, with offsets c = -u_ref of the points where those are free. Heights are told over the
plane that fits the points best, since how the frame lay to the clamp is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data
from bulgefit.gap.keys import by_value, names_of
from bulgefit.gap.regress import Regression

__all__ = ["ImpliedReference", "implied_references"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ImpliedReference:
    """Heights that a model implies for the reference image of one test.

    Attributes
    ----------
    test : str
    apex_mm : float
        At the measured point nearest the centre, over the plane.
    stderr : float or None, mm
        None where the model has no height and no offset: it then says nothing of one.
    rms_mm : float
        Of all points over the plane.
    """

    test: str
    apex_mm: float
    stderr: float | None
    rms_mm: float

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return dict(vars(self))


def implied_references(data: Sequence[Data], final: Regression) -> list[ImpliedReference]:
    """One for each specimen of a fitted model."""
    return [_implied(d, final, index) for index, d in enumerate(data)]


def _implied(d: Data, final: Regression, index: int) -> ImpliedReference:
    names, places = names_of(final.keys, index)
    shapes = final.predictions[index].shapes
    height, slopes = d.specimen.heights(shapes.values, names)
    seen, variance = d.used[..., 2].any(axis=0), np.zeros(len(height))
    offset = final.offsets[index]
    if offset is not None:
        weight = d.share[:, None] ** 2 * d.used[..., 2]
        counted = np.where(seen, weight.sum(axis=0), 1.0)
        by_name = d.specimen.observe(shapes, names).derivative[..., 2]
        by_name = by_name * np.array([by_value(n, shapes.values) for n in names])[:, None, None]
        slopes += np.einsum("fn,kfn->kn", weight, by_name) / counted
        height = height - offset[:, 2]
        variance = d.sigma[2] ** 2 * d.of_frames_mean(counted)
    over, apex = _over_plane(d.specimen.reference[seen, :2])
    above = over @ height[seen]
    row = over[apex]
    by = slopes[:, seen] @ row
    covariance = final.covariance[np.ix_(places, places)]
    square = by @ covariance @ by + (row**2 * variance[seen]).sum()
    stderr = float(np.sqrt(square)) if slopes.any() else None
    return ImpliedReference(
        d.specimen.test.name,
        float(above[apex]),
        stderr,
        float(np.sqrt((above**2).mean())),
    )


def _over_plane(points: Floats) -> tuple[Floats, int]:
    """What takes heights (n,) to those over the plane that fits best, and the apex's place."""
    plane, _ = np.linalg.qr(np.column_stack([np.ones(len(points)), points]))
    return np.eye(len(points)) - plane @ plane.T, int(np.argmin(np.hypot(*points.T)))
