"""The cameras' place: a frame that moves on while time passes, also while pressure is held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.places import Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Powers of x/a and y/a of each component's terms: a frame that moves and stretches.
_POWERS = ((0, 0), (1, 0), (0, 1))
#: Powers of the share of the test's time: at an even pace, and a drift that dies down or sets in.
_PACES = (1, 2)
_SHARES = tuple((axis, i, j, k) for axis in "xyz" for i, j in _POWERS for k in _PACES)
_NAMES = tuple(f"{axis}{i}{j}_{k}" for axis, i, j, k in _SHARES)
#: Points at which the field is looked at, along either axis, and shares of the time.
_LOOK, _TIMES = 21, 101


class DriftField(Field):
    """u_seen = u + Σ c x^i y^j τ^k for each component, τ the share of the test's time.

    What goes smoothly with time makes steps in pressure, wherever that was held.
    """

    id = "drift_field"
    place = "camera"
    meaning = "the cameras move or warm up while time passes"
    remedy = "let cameras and lamps warm up; film a fixed mark beside the clamp"
    quantity = "displacement that is none of the fabric's"
    unit = "mm"
    parameters = several(
        _NAMES,
        "mm",
        5.0,
        prior=0.15,
        reason="cameras drift and warm up by some tenths of a millimetre at the specimen",
        step=1e-3,
    )
    needs = ("time",)
    order = 9

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """See the class."""
        if scene.elapsed is None or not any(own[name] for name in _NAMES):
            return moved
        return moved + _seen(own, scene.reference[:, :2] / scene.radius, scene.elapsed)

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Root mean square over the disc, at shares of the test's time."""
        line = np.linspace(-1.0, 1.0, _LOOK)
        grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        share = np.linspace(0.0, 1.0, _TIMES)
        seen = _seen(own, grid[np.hypot(*grid.T) <= 1.0], share)
        return Sampled(np.sqrt((seen**2).sum(axis=2).mean(axis=1)), {"time_share": share})


def _seen(own: Own, unit: Floats, share: Floats) -> Floats:
    """The field (frames, n, 3) mm at points (n, 2) of the unit disc and shares of the time."""
    x, y = unit.T
    along = np.stack([share**k for k in _PACES], axis=1)
    over = np.stack([x**i * y**j for i, j in _POWERS], axis=1)
    size = np.array([own[name] for name in _NAMES]).reshape(3, len(_POWERS), len(_PACES))
    return np.asarray(over @ np.tensordot(along, size, (1, 2)).swapaxes(1, 2))


EFFECT = DriftField()
