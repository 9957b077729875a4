"""What looks wrong with a test that can be read all the same?"""

from __future__ import annotations

from collections.abc import Iterator

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import without_copies
from bulgefit.dic.suspicions.at_rest import about_images_at_rest, about_inflated_images
from bulgefit.dic.suspicions.axes import about_axes
from bulgefit.dic.suspicions.bins import about_bins
from bulgefit.dic.suspicions.copies import about_copies
from bulgefit.dic.suspicions.gauge import about_gauge
from bulgefit.dic.suspicions.mixtures import about_mixtures
from bulgefit.dic.suspicions.points import about_points
from bulgefit.dic.suspicions.sequence import about_sequence
from bulgefit.dic.suspicions.sizes import about_sizes
from bulgefit.dic.suspicions.surface import about_rough_frames, about_surface
from bulgefit.dic.suspicions.suspicion import Suspicion
from bulgefit.dic.suspicions.tilt import about_tilt
from bulgefit.dic.suspicions.zero import about_offsets, about_zero

__all__ = ["Suspicion", "alarms", "suspicions"]


def suspicions(test: BulgeTest) -> list[Suspicion]:
    """Everything that looks wrong with a test, what makes all results meaningless first."""
    return [*alarms(test), *_notes(test)]


def alarms(test: BulgeTest) -> list[Suspicion]:
    """What makes whatever is fitted to the test mean nothing: units, axes, zeros, pressures.

    It takes a fraction of a second, whatever the size of the test. Heights that lie on no surface
    tell nothing else.
    """
    return [*about_surface(test)] or [
        *about_sizes(test),
        *about_axes(test),
        *about_zero(test),
        *about_gauge(test),
        *about_inflated_images(test),
        *about_tilt(test),
    ]


def _notes(test: BulgeTest) -> Iterator[Suspicion]:
    yield from about_copies(test)
    yield from about_sequence(test)
    yield from about_mixtures(without_copies(test))
    yield from about_rough_frames(test)
    yield from about_points(test)
    yield from about_bins(test)
    yield from about_images_at_rest(test)
    yield from about_offsets(test)
