"""The clamp's opening has three lobes, as a ring held by three screws has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]


class ClampLobes(Effect):
    """Rim radius a(1 + c3 cos 3φ + s3 sin 3φ); inside, p (1 + Re((c3 - i s3) z³))."""

    id = "clamp_lobes"
    place = "shape"
    meaning = "the clamp's opening has three lobes"
    remedy = "measure the opening in several directions; tighten the ring evenly"
    parameters = several(
        ("c3", "s3"),
        "1",
        0.03,
        prior=0.006,
        reason="screws that are tightened unevenly bend a ring by some tenths of a millimetre",
        step=1e-5,
    )
    of_rig = True

    def outline(self, own: Own, unit: Floats) -> Floats:
        """See the class."""
        cube = (unit[:, 0] + 1j * unit[:, 1]) ** 3
        return unit * (1.0 + own["c3"] * cube.real + own["s3"] * cube.imag)[:, None]


EFFECT = ClampLobes()
