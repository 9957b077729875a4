"""Stiffness, or thickness, varies across the specimen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]


class StiffnessGradient(Effect):
    """Stiffness (thickness) times (1 + g_x x/a + g_y y/a)."""

    id = "stiffness_gradient"
    place = "material"
    meaning = "stiffness (thickness) varies across the specimen"
    remedy = "weigh or gauge patches of the specimen; cut specimens from the middle of the roll"
    parameters = several(
        ("g_x", "g_y"),
        "1",
        0.5,
        prior=0.15,
        reason="coating weight varies by some per cent over a roll's width, more at its edge",
        step=1e-5,
    )

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        if own["g_x"] == own["g_y"] == 0.0:
            return cloth
        slope = np.array([own["g_x"], own["g_y"]])
        return replace(cloth, thickness=cloth.thickened(1.0 + cloth.points @ slope))


EFFECT = StiffnessGradient()
