"""The DIC system averages displacements over a window."""

from __future__ import annotations

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter

__all__ = ["EFFECT"]


class DicSmoothing(Effect):
    """Displacement is a moving average over a window of this radius, less what the rim cuts off."""

    id = "dic_smoothing"
    place = "camera"
    meaning = "displacement is averaged over a window"
    remedy = "use smaller subsets and filters, and state the window"
    parameters = (
        Parameter(
            "window",
            "mm",
            0.0,
            15.0,
            prior=8.0,
            reason="subsets and filters of DIC span some millimetres",
            step=1e-3,
            start=8.0,
            coordinate="square",
        ),
    )

    def window(self, own: Own) -> float:
        """Its square: to first order, averaging acts in proportion to that."""
        return own["window"] ** 2


EFFECT = DicSmoothing()
