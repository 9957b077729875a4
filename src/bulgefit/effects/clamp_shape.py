"""The clamp's opening is oval, or of another radius than stated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]


class ClampShape(Effect):
    """Rim semi-axes a(1 + radius_error)(1 ± ellipticity), + along x."""

    id = "clamp_shape"
    place = "shape"
    meaning = "the clamp's opening is oval or of another radius"
    remedy = "measure the clamp's opening along x and y and state its radius"
    parameters = several(
        ("ellipticity", "radius_error"),
        "1",
        0.03,
        prior=0.01,
        reason="an opening turned on a lathe and measured with a rule is right within 1 %",
        step=1e-5,
        above=-1.0,
    )
    of_rig = True

    def outline(self, own: Own, unit: Floats) -> Floats:
        """See the class."""
        grown, oval = 1.0 + own["radius_error"], own["ellipticity"]
        return unit * np.array([grown * (1.0 + oval), grown * (1.0 - oval)])


EFFECT = ClampShape()
