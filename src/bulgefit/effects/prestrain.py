"""The fabric was mounted slack or stretched."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]


class Prestrain(Effect):
    """Stress-free excess strain along warp and fill: the elastic strain is e - slack.

    By the law's own measure, logarithmic but for svk, whose is Green-Lagrange's.
    """

    id = "prestrain"
    place = "clamp"
    meaning = "the fabric was mounted slack (positive) or stretched (negative)"
    remedy = "mount the fabric on a frame of known tension"
    parameters = several(
        ("slack_x", "slack_y"),
        "1",
        0.02,
        prior=0.006,
        reason="fabric laid by hand is slack or taut by some tenths of a per cent",
        step=1e-5,
    )

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """Slack enters the law."""
        x, y = cloth.slack
        return replace(cloth, slack=(x + own["slack_x"], y + own["slack_y"]))


EFFECT = Prestrain()
