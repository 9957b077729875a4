"""Stiffness falls with the logarithm of the time under load."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.further import Further, Told
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Load

__all__ = ["EFFECT"]


class Creep(Effect):
    """Stiffness falls by `rate` per decade of time since the first frame (`Clock.decades`)."""

    id = "creep"
    place = "material"
    meaning = "stiffness falls with the logarithm of time under load"
    remedy = "inflate at another rate, or hold a pressure and watch the apex"
    parameters = (
        Parameter(
            "rate",
            "1 per decade",
            0.0,
            0.2,
            prior=0.03,
            reason="polyester yarns lose some per cent of stiffness a decade",
            step=1e-5,
        ),
    )
    shared = True
    needs = ("time",)
    # a decade of rest at one pressure tells a per cent of stiffness, the way back three
    told = (
        Told(Further.HOLD, ("rate",), 0.01),
        Told(Further.UNLOADING, ("rate",), 0.0316),
    )

    def load(self, own: Own, load: Load) -> Load:
        """A fabric whose stiffness fell to a share c balances p as the fresh one balances p/c."""
        if own["rate"] == 0.0 or load.clock is None:
            return load
        return replace(load, softening=load.softening * (1.0 - own["rate"] * load.clock.decades))


EFFECT = Creep()
