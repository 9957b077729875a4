"""How many frames were recorded, of those that a file holds? The others are mixtures of them.

Fields that were interpolated to common pressures are linear mixtures of fewer recorded ones, to
the last digit: their rank is the number of those.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.reference_image import RESOLVED, shows_nothing

__all__ = ["independent_frames", "values_of"]

Floats = NDArray[np.float64]

#: Recorded frames have noise of their own, so that singular values (rms, mm) stay at it and then
#: fall to rounding. Those of computed fields fall on and on, by 10 to 50 from one to the next, as
#: the coefficients of a smooth path do.
_FALL = 100.0
#: Values of a frame that are looked at: many times the frames there are.
_MOST_VALUES = 6000


def independent_frames(test: BulgeTest) -> int:
    """Frames that are no mixtures of the others; all of them where that cannot be told.

    By the points that all frames have; an image at rest, where nothing has moved, counts.
    """
    if len(test.blocks) != 1:
        return test.n_frames
    (block,) = test.blocks
    moved = np.asarray(block.displacement, dtype=np.float64)
    still = np.array([shows_nothing(frame) for frame in moved], dtype=bool)
    moved = moved[~still]
    values = values_of(moved)
    if len(values) < 2 or values.shape[1] < 2 * len(values):
        return test.n_frames
    sizes = np.linalg.svd(values, compute_uv=False) / np.sqrt(values.shape[1])
    falls = (sizes[1:] < RESOLVED) & (sizes[:-1] > RESOLVED) & (sizes[1:] * _FALL < sizes[:-1])
    rank = int(np.argmax(falls)) + 1 if falls.any() else len(sizes)
    return rank + int(still.sum())


def values_of(moved: Floats) -> Floats:
    """Some values (frames, values) mm of displacement (frames, n, 3) that all frames have."""
    known = moved[:, np.isfinite(moved).all(axis=(0, 2))]
    values = known.reshape(len(known), known.shape[1] * 3)
    return values[:, :: max(1, values.shape[1] // _MOST_VALUES)]
