"""The pressure gauge reads in proportion too high or too low."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Load

__all__ = ["EFFECT"]


class PressureGain(Effect):
    """Recorded pressure is true times (1 + gain)."""

    id = "pressure_gain"
    place = "load"
    meaning = "recorded pressure is true times 1 + gain"
    remedy = "calibrate the gauge; no test can tell its gain from stiffness"
    parameters = (
        Parameter(
            "gain",
            "1",
            -0.05,
            0.05,
            prior=0.01,
            reason="the accuracy class of workshop gauges",
            step=1e-5,
            above=-1.0,
        ),
    )
    never_separable = "a gain of pressure is a gain of every modulus"
    order = 2

    def load(self, own: Own, load: Load) -> Load:
        """See the class."""
        return replace(load, applied=load.applied / (1.0 + own["gain"]))


EFFECT = PressureGain()
