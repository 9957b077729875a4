"""The pressure gauge does not read zero at rest."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Load

__all__ = ["EFFECT"]

#: MPa.
_BAR = 0.1


class PressureOffset(Effect):
    """Recorded minus true pressure, bar."""

    id = "pressure_offset"
    place = "load"
    meaning = "recorded minus true pressure"
    remedy = "record the gauge open to the air before and after the test"
    parameters = (
        Parameter(
            "offset",
            "bar",
            -0.06,
            0.06,
            prior=0.03,
            reason="one per cent of the range of a 3 bar gauge",
            step=1e-5,
        ),
    )
    order = 1  # recorded = true × (1 + gain) + offset: undone first

    def load(self, own: Own, load: Load) -> Load:
        """See the class."""
        return replace(load, applied=load.applied - _BAR * own["offset"])


EFFECT = PressureOffset()
