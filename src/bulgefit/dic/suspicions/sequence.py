"""Do the frames follow one another as loading asks for?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import copied_frames
from bulgefit.dic.suspicions.gauge import about_gauge
from bulgefit.dic.suspicions.suspicion import Suspicion
from bulgefit.shown import number_of

__all__ = ["about_sequence"]

_FEW_FRAMES = 5
# An apex may fall by this, mm, between frames of rising pressure: noise.
_APEX_FALL = 0.05


def about_sequence(test: BulgeTest) -> Iterator[Suspicion]:
    """Order and number of frames, and the growth of the apex."""
    falls, stays = np.diff(test.pressure) < 0, np.diff(test.pressure) == 0
    stays[[copy - 1 for copy in copied_frames(test)]] = False
    if falls.any() or (stays.any() and not any(about_gauge(test))):
        frame = int(np.flatnonzero(falls if falls.any() else stays)[0]) + 1
        yield Suspicion(
            "pressure_not_increasing",
            f"pressure does not increase at frame {frame}: unloading, or frames out of order",
            "keep the loading branch, in the order of its pressures",
        )
    if test.n_frames < _FEW_FRAMES:
        yield Suspicion(
            "few_frames",
            f"only {number_of(test.n_frames, 'frame')}: little to tell "
            "stiffness from other effects",
            "export more frames of the loading branch if there are any",
        )
    if test.time is not None and (np.diff(test.time) <= 0).any():
        frame = int(np.flatnonzero(np.diff(test.time) <= 0)[0]) + 1
        yield Suspicion(
            "time_not_increasing",
            f"time does not increase at frame {frame}: frames out of order",
            "order frames, pressures and times alike",
        )
    yield from _about_apex(test)


def _about_apex(test: BulgeTest) -> Iterator[Suspicion]:
    known = np.flatnonzero(np.isfinite(test.apex_displacement))
    if not len(known):
        yield Suspicion(
            "apex_missing",
            "dz was never measured at the apex",
            "export dz of the points near the centre",
        )
        return
    order = known[np.argsort(test.pressure[known], kind="stable")]
    rise, part = test.apex_displacement[order], _places(test)[order]
    # where points near the centre were lost, a paraboloid is lower at the next one
    farther = np.diff(part).clip(min=0) * np.abs(rise[:-1]) / (1 - part[:-1]).clip(min=1e-9)
    falls = np.flatnonzero(np.diff(rise) < -_APEX_FALL - farther)
    if len(falls) and rise[-1] >= 0:
        before, after = order[falls[0]], order[falls[0] + 1]
        yield Suspicion(
            "apex_falls",
            f"the apex does not grow with pressure at {len(falls)} of {len(order) - 1} steps, "
            f"first from frame {before} to {after}: creep, unloading or mixed frames",
            "check which pressure belongs to which frame, and keep the loading branch",
        )


def _places(test: BulgeTest) -> NDArray[np.floating]:
    """(frames,) array: (r/a)^2 of the point at which each frame's apex is read."""
    part = np.ones(test.n_frames)
    for block in test.blocks:
        points = test.on_circle(block.reference[test.apex[block.frames]])
        part[block.frames] = (points**2).sum(axis=1) / test.radius**2
    return part
