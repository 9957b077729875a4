"""The load's place: a gauge that errs through the test, however it does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Load

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_BAR = 0.1
#: Standard deviation (bar) of the error in the middle of the range.
_MIDDLE = 0.01
#: k of sin(kπ p/p_max). What the error is at no pressure (`start`) is an offset, which has an
#: effect of its own where it is alone; at the highest (`end`) a gain, which nothing shows, so that
#: it only widens the errors of the moduli. Between the two an error that walks, smoothly or in
#: steps, is a Brownian bridge: terms of standard deviations √2 σ/kπ, with σ/2 in the middle
#: (Karhunen and Loève).
_WAYS = (1, 2, 3, 4, 5, 6)


def _part(name: str, prior: float) -> Parameter:
    return Parameter(
        name,
        "bar",
        -0.3,
        0.3,
        prior=prior,
        reason="gauges of 4 bar are linear to a quarter of a per cent of their range",
        step=1e-5,
    )


class PressureField(Field):
    """Recorded minus true pressure, start (1 - τ) + end τ + Σ s_k sin kπτ, τ = p/p_max recorded."""

    id = "pressure_field"
    place = "load"
    meaning = "the gauge errs by other amounts as pressure rises"
    remedy = "calibrate the gauge over its range, rising and falling"
    quantity = "recorded minus true pressure"
    unit = "bar"
    parameters = (
        _part("start", _MIDDLE),
        _part("end", _MIDDLE),
        *(_part(f"s{k}", 2.0 * _MIDDLE * math.sqrt(2.0) / (k * math.pi)) for k in _WAYS),
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
    share = recorded / recorded.max()
    between = sum(own[f"s{k}"] * np.sin(k * np.pi * share) for k in _WAYS)
    return np.asarray(own["start"] * (1.0 - share) + own["end"] * share + between)


EFFECT = PressureField()
