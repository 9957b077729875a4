"""What a bulge test is: points, displacements and pressures of one specimen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.errors import InputError

__all__ = ["Block", "BulgeTest"]

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Block:
    """Frames that were measured at the same points.

    Attributes
    ----------
    reference : (n, 3) array, mm
        Positions of the points before inflation.
    frames : (k,) int array
        Indices of the frames of the test, ascending.
    displacement : (k, n, 3) array, mm
        NaN where a point (or one of its components) was lost.
    """

    reference: Floats
    frames: NDArray[np.intp]
    displacement: Floats


@dataclass(frozen=True, eq=False)
class BulgeTest:
    """One measured (or made) bulge inflation test.

    A test whose frames share their points is one block; where every frame has points of its own
    it is a block a frame. Code above this floor loops over `blocks` and never asks which.

    Attributes
    ----------
    name : str
    blocks : tuple of Block
    pressure : (frames,) array, MPa
    radius, thickness : float, mm
        Clamp radius and nominal thickness.
    poisson_ratio : float
        nu12 that a fit holds fixed unless it is freed.
    static_displacement : (m, n, 3) array, mm, or None
        Repeated images at rest, at the points of the only block: the noise alone.
    time : (frames,) array, s, or None
    source, checksum : str
        Where the test was read from, and the SHA-256 of what was read ("" if made in memory).
    """

    name: str
    blocks: tuple[Block, ...]
    pressure: Floats
    radius: float = 100.0
    thickness: float = 0.81
    poisson_ratio: float = 0.24
    static_displacement: Floats | None = None
    time: Floats | None = None
    source: str = ""
    checksum: str = ""
    metadata: dict[str, str] = field(default_factory=dict)
