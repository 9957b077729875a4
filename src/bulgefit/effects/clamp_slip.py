"""The fabric slips inwards at the clamp."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import LEAST_SLIP, Clamping

__all__ = ["EFFECT"]

#: Half of the step of a difference, over the compliance.
_STEP = 1e-3


class ClampSlip(Effect):
    """The rim moves radially inwards by compliance times the radial edge traction (N per mm)."""

    id = "clamp_slip"
    place = "clamp"
    meaning = "the fabric slips inwards at the clamp"
    remedy = "mark the fabric at the clamp's edge, tighten the clamp, or bond the fabric to it"
    parameters = (
        Parameter(
            "compliance",
            "mm per N/mm",
            0.0,
            0.1,
            prior=0.03,
            reason="a coated fabric in a serrated clamp gives by tenths of a millimetre at 10 N/mm",
            step=1e-6,
            start=1e-3,
        ),
    )

    def clamp(self, own: Own, clamping: Clamping) -> Clamping:
        """Springs at the rim, where there are none yet, in series with those there are."""
        if own["compliance"] == 0.0:
            return clamping
        return replace(clamping, compliance=(clamping.compliance or 0.0) + own["compliance"])

    def span(self, name: str, value: float) -> tuple[float, float]:
        """A relative step, since the springs' force goes with one over the compliance."""
        # springs are never stiffer than at the least slip: below it there is no difference
        value = max(value, LEAST_SLIP / (1.0 - _STEP))
        return value * (1.0 - _STEP), value * (1.0 + _STEP)


EFFECT = ClampSlip()
