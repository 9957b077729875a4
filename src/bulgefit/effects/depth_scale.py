"""The DIC system sees heights alone too large or too small."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.places import MOTION, Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]


class DepthScale(Effect):
    """Heights are seen × (1 + scale_z), positions in the plane are right."""

    id = "depth_scale"
    place = "camera"
    meaning = "heights alone are seen too large or too small"
    remedy = "check the stereo angle: calibrate anew, and measure a step of known height"
    parameters = several(
        ("scale_z",),
        "1",
        0.03,
        prior=0.01,
        reason="a stereo angle that is off by a tenth of a degree",
        step=1e-5,
        above=-1.0,
    )
    of_rig = True
    order = MOTION + 2

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """See the class."""
        return moved if own["scale_z"] == 0.0 else moved * [1.0, 1.0, 1.0 + own["scale_z"]]

    def see_height(self, own: Own, height: Floats) -> Floats:
        """See the class."""
        return (1.0 + own["scale_z"]) * height


EFFECT = DepthScale()
