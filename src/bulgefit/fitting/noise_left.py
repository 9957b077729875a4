"""How noisy is each test, by what a fit leaves of it?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bulgefit.dic.noise import Noise, among, noise_of
from bulgefit.errors import InputError
from bulgefit.fitting.objective import Objective
from bulgefit.model.inflation import Shapes
from bulgefit.model.virtual_test import VirtualTest

__all__ = ["noise_left"]

#: Points by which the noise is judged.
_MOST = 2000


def noise_left(objective: Objective, shapes: Sequence[Shapes]) -> list[Noise | None]:
    """Noise of every test at the shapes of a fit; None where a few values tell none.

    A displacement as it is shows its noise by what is rough in space alone, which is blind to
    noise that is correlated there. What a fit leaves shows it from frame to frame.
    """
    return [_of_test(v, s) for v, s in zip(objective.virtual, shapes, strict=True)]


def _of_test(virtual: VirtualTest, shapes: Shapes) -> Noise | None:
    test = virtual.test
    if len(test.blocks) > 1:
        return noise_of(test)
    (block,) = test.blocks
    kept = np.arange(len(block.reference))
    if len(kept) > _MOST:
        kept = np.sort(np.random.default_rng(0).permutation(len(kept))[:_MOST])
    mask = np.zeros(len(block.reference), dtype=bool)
    mask[kept] = True
    modelled = virtual.observe(shapes, points=kept).displacement
    try:
        some = test.select(points=mask)
    except InputError:  # nothing was measured at them
        return None
    noise = noise_of(some, block.displacement[:, kept] - modelled)
    return noise and among(noise, len(block.reference) / len(kept), len(block.displacement))
