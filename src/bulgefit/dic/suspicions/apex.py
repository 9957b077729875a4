"""How high did the specimen rise, at which pressure?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest

__all__ = ["rise_at_centre"]

Floats = NDArray[np.floating]

# Within this part of the radius the height of any cap is near that of a paraboloid.
_NEAR_APEX = 0.5


def rise_at_centre(test: BulgeTest, within: float = _NEAR_APEX) -> tuple[Floats, Floats]:
    """Pressure (MPa) and rise at the centre (mm) of the frames that tell it, by pressure.

    The rise is read at the measured point nearest the centre, as that of a paraboloid through it
    and the clamp. Frames whose nearest point lies beyond this part of the radius tell nothing.
    """
    rise = np.full(test.n_frames, np.nan)
    for block in test.blocks:
        index = test.apex[block.frames]
        part = np.sum(test.on_circle(block.reference[index]) ** 2, axis=1) / test.radius**2
        near = (index >= 0) & (part < within**2)
        height = test.apex_displacement[block.frames] / np.where(near, 1 - part, 1.0)
        rise[block.frames] = np.where(near, height, np.nan)
    known = np.flatnonzero(np.isfinite(rise))
    order = known[np.argsort(test.pressure[known], kind="stable")]
    return test.pressure[order], rise[order]
