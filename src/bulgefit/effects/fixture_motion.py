"""The clamp tilts and shifts as pressure rises."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several, stiffening
from bulgefit.effects.places import Scene, concave

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: MPa.
_BAR = 0.1
_TURNS = ("rotation_x", "rotation_y", "rotation_z")
_SHIFTS = ("shift_x", "shift_y", "shift_z")


class FixtureMotion(Effect):
    """u_seen = R(X + u) + shift - X, turn and shift by (1 - exp(-shape p))/shape, p in bar.

    In proportion to the true pressure where screws give evenly (shape 0), else concave.
    """

    id = "fixture_motion"
    place = "camera"
    meaning = "the clamp tilts and shifts as the true pressure rises"
    remedy = "put marks on the clamp and have the DIC system take their motion off"
    parameters = (
        *several(
            _TURNS,
            "degree/bar",
            0.5,
            prior=0.2,
            reason="a fixture that carries 3 kN a bar tilts by tenths of a degree",
            step=1e-4,
        ),
        *several(
            _SHIFTS,
            "mm/bar",
            1.0,
            prior=0.2,
            reason="and shifts by tenths of a millimetre",
            step=1e-4,
        ),
        stiffening(),
    )
    forms = ((*_TURNS, *_SHIFTS), (*_TURNS, *_SHIFTS, "shape"))

    def motion(self, own: Own, scene: Scene) -> tuple[Floats, Floats]:
        """See the class."""
        far = concave(scene.pressure / _BAR, own["shape"])
        turn, shift = (np.array([own[n] for n in names]) for names in (_TURNS, _SHIFTS))
        return np.outer(far, turn), np.outer(far, shift)


EFFECT = FixtureMotion()
