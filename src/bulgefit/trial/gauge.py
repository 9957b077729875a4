"""What a pressure gauge reads: recorded pressures against true ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.trial.draw import Draw
from bulgefit.trial.foreign import GAUGE_RANGE

__all__ = ["recorded_load", "true_load"]

Floats = NDArray[np.float64]

_BAR = 0.1  # MPa


def recorded_load(drawn: Draw, true: Floats) -> Floats:
    """What is recorded (MPa) of a true pressure (MPa) that rises.

    The gauge shows true - 4 bow s (1 - s) with s = true / range: a spring gauge lags, most in the
    middle of its range. What it shows is recorded × (1 + gain) + offset, the offset in bar.
    """
    share = true / (_BAR * GAUGE_RANGE)
    shown = true - 4.0 * _BAR * drawn.get("gauge_hysteresis.bow") * share * (1.0 - share)
    gain = 1.0 + drawn.get("pressure_gain.gain")
    return shown * gain + _BAR * drawn.get("pressure_offset.offset")


def true_load(drawn: Draw, recorded: Floats) -> Floats:
    """True pressure (MPa) of a recorded one: the inverse of `recorded_load`."""
    offset = _BAR * drawn.get("pressure_offset.offset")
    shown = (recorded - offset) / (1.0 + drawn.get("pressure_gain.gain"))
    bent = 4.0 * drawn.get("gauge_hysteresis.bow") / GAUGE_RANGE
    # with s = true / range: (1 - bent) s + bent s² = shown / range, solved without cancellation
    slope = 1.0 - bent
    share = shown / (_BAR * GAUGE_RANGE)
    return 2.0 * shown / (slope + np.sqrt(slope**2 + 4.0 * bent * share))
