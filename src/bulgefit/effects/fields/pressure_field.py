"""The load's place: a gauge that errs through the test, however it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.places import Load

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_BAR = 0.1
#: cos(kπ p/p_max) from k = 1: what is constant is an offset, which has an effect of its own.
_WAYS = (1, 2, 3, 4)
_NAMES = tuple(f"c{k}" for k in _WAYS)


class PressureField(Field):
    """Recorded minus true pressure: Σ c_k cos(kπ p/p_max), p recorded."""

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
    way = np.pi * recorded / recorded.max()
    return np.asarray(sum(own[f"c{k}"] * np.cos(k * way) for k in _WAYS))


EFFECT = PressureField()
