"""The clamp's centre is not the origin of the DIC frame."""

from __future__ import annotations

from bulgefit.effects.base import Effect, Own, several

__all__ = ["EFFECT"]


class Registration(Effect):
    """The clamp's centre lies at (x0, y0) of the DIC frame."""

    id = "registration"
    place = "camera"
    meaning = "the clamp's centre is not the origin of the DIC frame"
    remedy = "find the centre from the rim (bulgefit align)"
    parameters = several(
        ("x0", "y0"),
        "mm",
        5.0,
        prior=2.0,
        reason="a centre that is found by eye",
        step=1e-4,
    )

    def centre(self, own: Own) -> tuple[float, float]:
        """See the class."""
        return own["x0"], own["y0"]


EFFECT = Registration()
