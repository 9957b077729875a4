"""The DIC system sees all lengths too long or too short."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.places import Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]


class DicScale(Effect):
    """Positions and displacements are seen × (1 + scale)."""

    id = "dic_scale"
    place = "camera"
    meaning = "lengths are seen too long or too short"
    remedy = "check the calibration with a scale bar of known length"
    parameters = several(
        ("scale",),
        "1",
        0.03,
        prior=0.01,
        reason="a calibration target whose spacing is known within 1 %",
        step=1e-5,
        above=-1.0,
    )
    of_rig = True
    order = 1

    def locate(self, own: Own, seen: Floats, radius: float) -> Floats:
        """See the class."""
        return seen / (1.0 + own["scale"])

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """See the class."""
        return moved if own["scale"] == 0.0 else (1.0 + own["scale"]) * moved

    def see_height(self, own: Own, height: Floats) -> Floats:
        """See the class."""
        return (1.0 + own["scale"]) * height


EFFECT = DicScale()
