"""The axes of the reported displacement are turned against the fixture's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.places import MOTION, Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_TURNS = ("rotation_x", "rotation_y", "rotation_z")


class FrameMisalignment(Effect):
    """u_seen = R u, with no rigid motion: displacement is reported in turned axes."""

    id = "frame_misalignment"
    place = "camera"
    meaning = "the axes of the reported displacement are turned"
    remedy = "align the frame to the rim's plane and the warp (bulgefit align)"
    parameters = several(
        _TURNS,
        "degree",
        5.0,
        prior=1.0,
        reason="axes laid through a few marks by hand are right within a degree",
        step=1e-4,
    )
    order = MOTION + 3

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """See the class."""
        turn = np.array([own[name] for name in _TURNS])
        if not turn.any():
            return moved
        return moved @ Rotation.from_rotvec(turn, degrees=True).as_matrix().T


EFFECT = FrameMisalignment()
