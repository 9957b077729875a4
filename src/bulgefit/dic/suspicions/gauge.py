"""Does the gauge follow the specimen?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.surface import bulge_of
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_gauge"]

# A bulge has grown where it did by this many standard errors.
_SURE = 5.0


def about_gauge(test: BulgeTest) -> Iterator[Suspicion]:
    """Frames in a row with one and the same pressure, while the specimen rises."""
    found = [(risen, run) for run in _runs(test) if (risen := _risen(test, *run)) is not None]
    if found:
        risen, (first, last) = max(found)
        yield Suspicion(
            "pressure_stuck",
            f"the pressure stays at {test.pressure[first] * 10:.4g} bar from frame {first} to "
            f"{last} while the centre rises by {risen:.2g} mm: the gauge kept its last value, or "
            "the pressure was held and the cloth crept",
            "give these frames the pressures of another gauge, or leave them out; if the pressure "
            "was held, give their times, and bulgefit diagnose frees creep",
        )


def _runs(test: BulgeTest) -> Iterator[tuple[int, int]]:
    """First and last frames of pressures that are equal to the last digit."""
    changes = np.flatnonzero(np.diff(test.pressure) != 0) + 1
    for frames in np.split(np.arange(test.n_frames), changes):
        if len(frames) > 1:
            yield int(frames[0]), int(frames[-1])


def _risen(test: BulgeTest, first: int, last: int) -> float | None:
    """How far the centre rose in between, mm; None where it did not for certain."""
    before, after = bulge_of(test, first), bulge_of(test, last)
    if before is None or after is None:
        return None
    risen = after.rise - before.rise
    return risen if risen > _SURE * float(np.hypot(before.error, after.error)) else None
