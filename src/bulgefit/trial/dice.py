"""How are sizes and directions drawn?"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

__all__ = ["Sizes", "either", "motion", "plane", "size", "vector"]

#: Draws the parameters of one effect.
Sizes = Callable[[Generator], dict[str, float]]


def either(rng: Generator, low: float, high: float) -> float:
    """A size, evenly in its logarithm, of either sign."""
    return size(rng, low, high) * float(rng.choice([-1.0, 1.0]))


def size(rng: Generator, low: float, high: float) -> float:
    """A size, evenly in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def plane(rng: Generator, names: tuple[str, str], low: float, high: float) -> dict[str, float]:
    """Components of a vector in the plane, of drawn length and direction."""
    length, turn = size(rng, low, high), rng.uniform(0, 2 * np.pi)
    return {names[0]: float(length * np.cos(turn)), names[1]: float(length * np.sin(turn))}


def vector(rng: Generator, name: str, low: float, high: float) -> dict[str, float]:
    """Components name_x, name_y, name_z of a vector of drawn length and direction."""
    direction = rng.normal(size=3)
    drawn = size(rng, low, high) * direction / np.linalg.norm(direction)
    return {f"{name}_{axis}": float(v) for axis, v in zip("xyz", drawn, strict=True)}


def motion(rng: Generator, degree: float, mm: float, span: float) -> dict[str, float]:
    """A rotation up to `degree` and a shift up to `mm`, down to those over `span`."""
    return {
        **vector(rng, "rotation", degree / span, degree),
        **vector(rng, "shift", mm / span, mm),
    }
