"""The reference image shows the fabric already displaced."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.further import Further, Told
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: MPa.
_BAR = 0.1
#: Size (mm) of the widest crease, a wave of second degree, and of what tilts and shifts.
_WIDEST = 0.5
#: Degrees (i, j) of the modes P_i(x/a) P_j(y/a), Legendre's polynomials, up to the fifth in all.
_HIGHEST = 5
MODES = tuple((n - j, j) for n in range(_HIGHEST + 1) for j in range(n + 1))
_AXIS_MAJOR = tuple(f"{axis}{i}{j}" for axis in "xyz" for i, j in MODES)


def _names(axes: str, *degrees: int) -> tuple[str, ...]:
    """Of the modes of these degrees in some components."""
    return tuple(f"{axis}{i}{j}" for n in degrees for axis in axes for i, j in MODES if i + j == n)


def _modes(degree: int) -> tuple[Parameter, ...]:
    """Parameters of one degree."""
    return several(
        _names("xyz", degree),
        "mm",
        10.0,
        prior=_WIDEST * (2.0 / max(degree, 2)) ** 2,
        reason="creases and sagging of a fabric at rest, and less by the square of the degree: a "
        "sheet's waves of equal bending energy do so",
        step=1e-3,
    )


class ReferenceState(Effect):
    """u_seen = u - h(p) u_ref(x, y): hanging, creased, or under residual pressure.

    h = p/(p + flattening) is the share that pressure has flattened; without a flattening pressure
    a fabric is smooth at once.
    """

    id = "reference_state"
    place = "camera"
    meaning = "the reference image shows the fabric already displaced"
    remedy = "take the reference image under a light pressure that makes the fabric smooth"
    parameters = (
        *(p for degree in range(_HIGHEST + 1) for p in _modes(degree)),
        Parameter(
            "flattening",
            "bar",
            0.0,
            1.0,
            prior=0.05,
            reason="creases of coated fabric are gone at some hundredths of a bar",
            step=1e-5,
            start=0.02,
        ),
    )
    # up to a degree out of the plane, and to no higher one in it, where a sheet that hangs moves by
    # half the square of its slope alone: waves that are not there would cost more than what takes
    # the place of those that are
    forms = tuple(
        _names("z", *range(out + 1)) + _names("xy", *range(within + 1))
        for out in range(1, _HIGHEST + 1)
        for within in range(1, out + 1)
    )
    # a shape measured without pressure shows what the reference image already did, in mm
    told = (Told(Further.SHAPE, tuple(n for n in _AXIS_MAJOR if n.startswith("z")), 0.05),)
    order = 4

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """See the class."""
        if not any(own[name] for name in _AXIS_MAJOR):
            return moved
        state = self.at_rest(own, scene.reference, scene.radius)
        return moved - flattened(scene.pressure, own["flattening"])[:, None, None] * state

    def at_rest(self, own: Own, reference: Floats, radius: float) -> Floats:
        """u_ref (n, 3) mm at points (n, 3) mm."""
        coefficients = np.array([own[name] for name in _AXIS_MAJOR]).reshape(3, -1)
        return np.asarray((coefficients @ reference_modes(reference, radius)).T)


def reference_modes(reference: Floats, radius: float) -> Floats:
    """Modes (modes, n) at points (n, 3) mm."""
    highest = max(sum(mode) for mode in MODES)
    along_x, along_y = (legvander(reference[:, k] / radius, highest) for k in (0, 1))
    return np.stack([along_x[:, i] * along_y[:, j] for i, j in MODES])


def flattened(pressure: Floats, flattening: float) -> Floats:
    """Share (frames,) of the reference state that pressure (frames,) MPa has flattened."""
    bar = np.maximum(pressure, 1e-6) / _BAR
    return np.asarray(bar / (bar + flattening))


EFFECT = ReferenceState()
