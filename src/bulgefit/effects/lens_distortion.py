"""The lens bends what lies off its axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.places import MOTION, Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Corrections that undo a distortion of 5 % to rounding: each leaves some 3 k1 of the last.
_CORRECTIONS = 40


class LensDistortion(Effect):
    """A position p (in the plane, from the axis) is seen at p (1 + k1 |p|²/a²), always."""

    id = "lens_distortion"
    place = "camera"
    meaning = "the lens bends what lies off its axis"
    remedy = "calibrate the lens with the target in all corners of the image"
    parameters = several(
        ("k1",),
        "1",
        0.03,
        prior=0.005,
        reason="what is left of the distortion of a good lens after calibration",
        step=1e-5,
    )
    of_rig = True
    order = MOTION + 1

    def locate(self, own: Own, seen: Floats, radius: float) -> Floats:
        """Undone by fixed-point corrections."""
        place = seen
        if own["k1"] != 0.0:
            for _ in range(_CORRECTIONS):
                place = seen / self._grown(own, place, radius)
        return place

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """Where a point is seen after inflation minus where it was seen before."""
        if own["k1"] == 0.0:
            return moved
        before = scene.position
        after = before + moved[..., :2]
        out = moved.copy()
        out[..., :2] = after * self._grown(own, after, scene.radius)
        out[..., :2] -= before * self._grown(own, before, scene.radius)
        return out

    @staticmethod
    def _grown(own: Own, place: Floats, radius: float) -> Floats:
        square = (place**2).sum(axis=-1, keepdims=True)
        return np.asarray(1.0 + own["k1"] * square / radius**2)


EFFECT = LensDistortion()
