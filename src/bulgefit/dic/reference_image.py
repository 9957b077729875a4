"""Which frames are the reference image itself? It was compared with itself, and tells nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest

__all__ = ["RESOLVED", "shows_nothing", "without_reference"]

#: mm. No camera resolves 10 nm, a ten thousandth of a pixel of 0.1 mm: what lies below is rounding.
RESOLVED = 1e-5


def shows_nothing(displacement: NDArray[np.floating]) -> bool:
    """Whether nothing at all has moved in a frame, noise included; NaN where nothing was seen."""
    return bool((np.abs(np.nan_to_num(displacement)) <= RESOLVED).all())


def without_reference(test: BulgeTest) -> BulgeTest:
    """The test without frames in which nothing has moved; itself where it has none, or no others.

    Exports hold the reference image as a frame of its own. It has no noise: beside others it would
    make theirs look smaller, and moduli surer than they are.
    """
    still = {
        int(frame)
        for block in test.blocks
        for frame, moved in zip(block.frames, block.displacement, strict=True)
        if shows_nothing(moved)
    }
    if not still or len(still) == test.n_frames:
        return test
    return test.select(frames=[k for k in range(test.n_frames) if k not in still])
