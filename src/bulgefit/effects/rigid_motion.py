"""The cameras' frame moved after the reference image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.further import Further, Told
from bulgefit.effects.places import Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_TURNS = ("rotation_x", "rotation_y", "rotation_z")
_SHIFTS = ("shift_x", "shift_y", "shift_z")


class RigidMotion(Effect):
    """u_seen = R(X + u) + shift - X, with X where a point stands before inflation."""

    id = "rigid_motion"
    place = "camera"
    meaning = "the camera's frame moved after the reference image"
    remedy = "take the reference image again before inflation, with cameras and clamp on one frame"
    parameters = (
        *several(
            _TURNS,
            "degree",
            5.0,
            prior=1.0,
            reason="a tripod that is touched turns by tenths of a degree, one set up anew by more",
            step=1e-4,
        ),
        *several(
            _SHIFTS,
            "mm",
            5.0,
            prior=0.5,
            reason="and shifts what it sees by tenths of a millimetre",
            step=1e-4,
        ),
    )
    forms = (_TURNS, (*_TURNS, *_SHIFTS))
    # images at rest show a moved frame directly: 0.005 degree, 0.005 mm
    told = (Told(Further.AT_REST, (*_TURNS, *_SHIFTS), 0.005),)

    def motion(self, own: Own, scene: Scene) -> tuple[Floats, Floats]:
        """The same in every frame."""
        turn, shift = (np.array([own[n] for n in names]) for names in (_TURNS, _SHIFTS))
        frames = len(scene.pressure)
        return np.tile(turn, (frames, 1)), np.tile(shift, (frames, 1))


EFFECT = RigidMotion()
