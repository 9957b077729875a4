"""Does one process fit again and again in the memory that the first fits took?"""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fitting.fit import fit


def test_fits_leave_nothing_behind(make: Callable[..., BulgeTest], setup: Any) -> None:
    """Less than the displacements of one level of one path for each fit, in some run of three.

    What is made once stays (a code path that is first taken); what leaks grows in every run.
    """
    test = make(noise=0.05)
    bounds = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
    level = 3 * 57 * setup.refine**2 * 8  # bytes; a mesh has about as many nodes as cells

    def held(seeds: range) -> int:
        for seed in seeds:
            fit(test, bounds=bounds, starts=2, seed=seed, setup=setup, workers=2)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before, grown = held(range(3)), []
        # runs are few as a rule; Python 3.13 goes on specialising code for some of them
        while len(grown) < 8 and min(grown, default=np.inf) >= 3 * level:
            first = 3 * len(grown) + 3
            after = held(range(first, first + 3))
            grown.append(after - before)
            before = after
        assert min(grown) < 3 * level, grown
    finally:
        tracemalloc.stop()
