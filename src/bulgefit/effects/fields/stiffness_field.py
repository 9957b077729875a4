"""The material's place: stiffness that varies over the cloth, however it does."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own, several
from bulgefit.effects.fields.base import Field, Sampled, Typical
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

#: Spacing s and width w (standard deviation) of the bumps over the clamp's radius. Equal bumps sum
#: to a level field with ripples of 2 exp(-2π²w²/s²), 1e-5 here. Of a spot of width W the grid
#: misses what is finer than two spacings, exp(-π²W²/2s²) in its spectrum: 3 % at W = 0.12. What it
#: misses of a spot, other effects are called in for; so bumps stand beyond the rim as far as they
#: reach in: a seam or a sector ends at the clamp, and without them the field would fall off there.
_SPACING, _WIDTH = 0.14, 0.11
_OUTERMOST = 1.0 + _WIDTH
_REACH = int(_OUTERMOST / _SPACING)
CENTRES = np.array(
    [
        (_SPACING * i, _SPACING * j)
        for i in range(-_REACH, _REACH + 1)
        for j in range(-_REACH, _REACH + 1)
        if np.hypot(_SPACING * i, _SPACING * j) <= _OUTERMOST
    ]
)
_NAMES = tuple(f"b{k}" for k in range(len(CENTRES)))
#: Points at which the field is looked at, along either axis; ranks about the median, either way.
_LOOK, _ABOUT = 96, 0.05


class StiffnessField(Field):
    """Stiffness (thickness) times exp(Σ b_k (exp(-|p - p_k|²/2w²) - m_k)), bumps on a square grid.

    m_k are the bumps' means over the specimen: the moduli alone say how stiff it is as a whole.
    """

    id = "stiffness_field"
    place = "material"
    meaning = "the cloth's stiffness varies from place to place"
    remedy = "look at the cloth there: coating, seams, repairs; cut another specimen"
    quantity = "relative change of stiffness"
    parameters = several(
        _NAMES,
        "1",
        2.0,
        prior=0.15,
        reason="coating, weave and seams change stiffness by tenths within some centimetres",
        step=1e-3,
    )
    shared = False

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        heights = np.array([own[name] for name in _NAMES])
        if not heights.any():
            return cloth
        return replace(cloth, thickness=cloth.thickened(np.exp(_bumps(cloth.points) @ heights)))

    def thickening(self, own: Own, points: Floats) -> dict[str, Floats]:
        """Its bumps: see the class."""
        return dict(zip(_NAMES, np.moveaxis(_bumps(points), -1, 0), strict=True))

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """Over the disc, against its level."""
        x, y = radius * _grid().T
        found = _logarithm(own)
        return Sampled(np.expm1(found - np.median(found)), {"x_mm": x, "y_mm": y})

    def typical(self, own: Own) -> Typical:
        """Its median: a spot is told against the cloth about it, whose moduli are the cloth's.

        The median moves as the field does where it is the median: in the tenth of the places that
        are nearest to it in rank. Of n places in which a cloth differs by chance it is known to
        1/(2 f √n), f being the density there (Cramér, 1946, "Mathematical methods of statistics",
        section 28.5); a specimen has as many as cells of the grid. What stands out on one side
        moves the median, but not the mean of the half that is most alike: by their distance it is
        open what most places are.
        """
        found = _logarithm(own)
        low, middle, high = np.quantile(found, (0.5 - _ABOUT, 0.5, 0.5 + _ABOUT))
        slopes = _bumps(_grid())[(found >= low) & (found <= high)].mean(axis=0)
        number = np.pi / _SPACING**2
        error = (high - low) / (2.0 * _ABOUT) / (2.0 * np.sqrt(number))
        error = np.hypot(error, _of_most_alike(found) - middle)
        named = dict(zip(_NAMES, slopes.tolist(), strict=True))
        return Typical(float(np.exp(middle)), named, float(error))


@lru_cache(maxsize=1)
def _grid() -> Floats:
    """Points (n, 2) of the unit disc at which the field is looked at."""
    line = np.linspace(-1.0, 1.0, _LOOK)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return np.asarray(grid[np.hypot(*grid.T) <= 1.0])


def _of_most_alike(values: Floats) -> float:
    """Mean of the half of values that has the least range.

    The shorth of Andrews et al. (1972, "Robust estimates of location").
    """
    ordered, half = np.sort(values), len(values) // 2
    first = int(np.argmin(ordered[half:] - ordered[: len(values) - half]))
    return float(ordered[first : first + half + 1].mean())


def _logarithm(own: Own) -> Floats:
    return np.asarray(_bumps(_grid()) @ np.array([own[name] for name in _NAMES]))


def _bumps(points: Floats) -> Floats:
    """Bumps (..., k) at points (..., 2) of the unit disc."""
    return _bumps_of(np.ascontiguousarray(points).tobytes()).reshape(*points.shape[:-1], -1)


@lru_cache(maxsize=4)
def _bumps_of(points_bytes: bytes) -> Floats:
    """Bumps (n, k) at points (n, 2), given as bytes: a mesh is looked at thousands of times."""
    return _bells(np.frombuffer(points_bytes).reshape(-1, 2)) - _means()


@lru_cache(maxsize=1)
def _means() -> Floats:
    """Means (k,) of the bumps over the disc."""
    return np.asarray(_bells(_grid()).mean(axis=0))


def _bells(points: Floats) -> Floats:
    """exp(-|p - p_k|²/2w²), (n, k), at points (n, 2)."""
    square = ((points[:, None] - CENTRES) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * square / _WIDTH**2))


EFFECT = StiffnessField()
