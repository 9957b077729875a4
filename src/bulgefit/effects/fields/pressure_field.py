"""The load's place: a gauge that errs through the test, however it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import legval
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.places import Load

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_BAR = 0.1
#: Degrees: what is constant is an offset, which has an effect of its own, and what is in proportion
#: to pressure a gain, which no displacement tells from stiffness.
_DEGREES = (2, 3, 4, 5)
_NAMES = tuple(f"c{k}" for k in _DEGREES)


class PressureField(Field):
    """Recorded minus true pressure: Σ c_k P_k(2p/p_max - 1), p recorded, P_k Legendre's.

    Polynomials follow a bow that ends where pressure does; cosines, level at both ends, would not.
    """

    id = "pressure_field"
    place = "load"
    meaning = "the gauge errs by other amounts as pressure rises"
    remedy = "calibrate the gauge over its range, rising and falling"
    quantity = "recorded minus true pressure"
    unit = "bar"
    parameters = several(
        _NAMES,
        "bar",
        0.3,
        prior=0.01,
        reason="gauges of 4 bar are linear to a quarter of a per cent of their range",
        step=1e-5,
    )
    order = 9

    def load(self, own: Own, load: Load) -> Load:
        """See the class."""
        if not any(own.values()):
            return load
        return replace(load, applied=load.applied - _BAR * _error(own, load.recorded))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """At the recorded pressures."""
        return Sampled(_error(own, pressure), {"pressure_bar": pressure / _BAR})


def _error(own: Own, recorded: Floats) -> Floats:
    """Recorded minus true pressure (frames,), bar."""
    series = np.zeros(_DEGREES[-1] + 1)
    series[list(_DEGREES)] = [own[name] for name in _NAMES]
    return legval(2.0 * recorded / recorded.max() - 1.0, series)


EFFECT = PressureField()
