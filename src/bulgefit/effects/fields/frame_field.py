"""The cameras' place: frames that move or bend against each other, however they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.places import Scene

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_BAR = 0.1
#: Powers of x/a and y/a of each component's terms: to first order those of a frame that moves and
#: stretches, and of the second, by which perspective changes as a camera turns.
_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
#: Functions cos(kπ p/p_max), k from 0: what goes through the test as fast as smooth modes of a
#: residual are looked at (polynomials of fifth degree).
_WAYS = 6
_SHARES = tuple((axis, i, j, k) for axis in "xyz" for i, j in _POWERS for k in range(_WAYS))
_NAMES = tuple(f"{axis}{i}{j}_{k}" for axis, i, j, k in _SHARES)


class FrameField(Field):
    """u_seen = u + Σ c x^i y^j cos(kπ p/p_max), for each component."""

    id = "frame_field"
    place = "camera"
    meaning = "the frames move or bend against each other"
    remedy = "hold cameras and clamp on one frame; film a fixed mark beside the clamp"
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
    order = 9

    def see(self, own: Own, scene: Scene, moved: Floats) -> Floats:
        """See the class."""
        if not any(own[name] for name in _NAMES):
            return moved
        share = scene.pressure / scene.highest
        return moved + _seen(own, scene.reference[:, :2] / scene.radius, share)

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Root mean square over the disc, at each pressure."""
        line = np.linspace(-1.0, 1.0, 21)
        grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        seen = _seen(own, grid[np.hypot(*grid.T) <= 1.0], pressure / pressure.max())
        size = np.sqrt((seen**2).sum(axis=2).mean(axis=1))
        return Sampled(size, {"pressure_bar": pressure / _BAR})


def _seen(own: Own, unit: Floats, share: Floats) -> Floats:
    """The field (frames, n, 3) mm at points (n, 2) of the unit disc, by p/p_max (frames,)."""
    x, y = unit.T
    along = np.cos(np.outer(np.pi * share, range(_WAYS)))
    over = np.stack([x**i * y**j for i, j in _POWERS], axis=1)
    size = np.array([own[name] for name in _NAMES]).reshape(3, len(_POWERS), _WAYS)
    return np.asarray(over @ np.tensordot(along, size, (1, 2)).swapaxes(1, 2))


EFFECT = FrameField()
