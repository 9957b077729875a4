"""The cameras see a face of the cloth, not the middle that bears the load."""

from __future__ import annotations

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter

__all__ = ["EFFECT"]


class SurfaceOffset(Effect):
    """What is seen lies above what bears, by a share of the thickness, along the normal.

    So it moves by u + s t (n - N), with the normal n after and N before inflation: where a cloth
    bulges towards the cameras, its face is stretched by s t times the curvature beyond its middle.
    """

    id = "surface_offset"
    place = "camera"
    meaning = "the face that is seen lies off the middle of the cloth, and moves with its normal"
    remedy = "hold it at where a section of the cloth shows its yarns: 0.5 if they lie half way"
    parameters = (
        Parameter(
            "share",
            "1",
            -1.0,
            1.0,
            prior=0.5,
            reason="the face of a sheet lies half its thickness off its middle",
            step=1e-3,
        ),
    )
    shared = True

    def face(self, own: Own) -> float:
        """See the class."""
        return own["share"]


EFFECT = SurfaceOffset()
