"""Does z stand on the clamp's plane? Seen by a reference whose heights were measured."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.at_rest import AT_REST
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_tilt"]

# Standard errors by which a slope tells itself from what a cloth that hangs leaves.
_SURE = 5.0
# Points that tell the plane: so few take no time, and more make it no surer than shapes are.
_FEWEST, _MOST = 30, 20_000


def about_tilt(test: BulgeTest) -> Iterator[Suspicion]:
    """A reference that leans, by which a rise along z moves points in the plane.

    A cloth before inflation has any shape that is 0 at the rim, (1 - r²/a²) times a quadratic; the
    clamp's plane is what is left of its heights.
    """
    points = np.concatenate([block.reference[block.measured.any(axis=0)] for block in test.blocks])
    points = points[:: -(-len(points) // _MOST)]
    x, y = (test.on_circle(points) / test.radius).T
    z = points[:, 2].astype(float)
    if len(z) < _FEWEST or not z.any():
        return
    hangs = 1.0 - x**2 - y**2
    plane = [np.ones_like(x), x, y]
    basis = np.stack([*plane, *(hangs * f for f in (*plane, x * x, x * y, y * y))], axis=1)
    found, left, rank, _ = np.linalg.lstsq(basis, z, rcond=None)
    if rank < basis.shape[1] or not len(left):
        return
    variance = float(left[0]) / (len(z) - rank) * np.linalg.inv(basis.T @ basis)
    slope = float(np.hypot(*found[1:3])) / test.radius
    error = float(np.sqrt(variance[1, 1] + variance[2, 2])) / test.radius
    rise = float(np.nanmax(np.abs(test.apex_displacement), initial=0.0))
    if slope > _SURE * error and slope * rise > AT_REST:
        yield Suspicion(
            "reference_tilted",
            f"the plane of the reference leans by {np.rad2deg(np.arctan(slope)):.2g} degrees, so "
            f"that a rise of {rise:.3g} mm moves points by {slope * rise:.2g} mm in it: z does "
            "not stand on the clamp's plane",
            "bulgefit convert IN OUT --level; if only the cloth leans in a clamp that does not, "
            "bulgefit diagnose frees initial_shape",
        )
