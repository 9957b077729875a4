"""An effect of one's own: the hose between the gauge and the chamber loses pressure."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Load

#: MPa.
BAR = 0.1


class HoseLag(Effect):
    """The chamber's pressure is the recorded one times (1 - loss p), p in bar.

    The faster air flows, at high pressure, the more is lost between gauge and chamber.
    """

    id = "hose_lag"
    place = "load"
    meaning = "the chamber's pressure lags behind the gauge's as it rises"
    remedy = "put the gauge on the chamber, or inflate in steps and wait"
    parameters = (
        Parameter(
            "loss",
            "1/bar",
            0.0,
            0.2,
            prior=0.02,
            reason="a narrow hose loses some per cent of the pressure at 1 bar",
            step=1e-5,
        ),
    )

    def load(self, own: Own, load: Load) -> Load:
        """Nothing is lost where the loss is 0, the null."""
        share = 1.0 - own["loss"] * load.applied / BAR
        return replace(load, applied=load.applied * share)
