"""Were the frames recorded, or interpolated from fewer?"""

from __future__ import annotations

from collections.abc import Iterator

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import repeated_frames
from bulgefit.dic.mixtures import independent_frames
from bulgefit.dic.suspicions.suspicion import Suspicion
from bulgefit.dic.unmix import recorded_frames
from bulgefit.shown import some_of

__all__ = ["about_mixtures"]


def about_mixtures(test: BulgeTest) -> Iterator[Suspicion]:
    """Frames that are linear mixtures of others, or one of them at another pressure."""
    recorded, repeated = independent_frames(test), repeated_frames(test)
    if repeated:
        bar = {k: f"{10.0 * test.pressure[k]:.4g} bar" for k in {*repeated, *repeated.values()}}
        named = [
            f"{k} (from 0, {bar[k]}) is {first} ({bar[first]})" for k, first in repeated.items()
        ]
        yield Suspicion(
            "frames_repeated",
            f"frames hold the same data as others at another pressure: frame {some_of(named)}",
            "export the frame that belongs to each pressure, or leave it out",
        )
    if recorded < test.n_frames - len(repeated):
        found = recorded_frames(test)
        yield Suspicion(
            "frames_interpolated",
            f"the {test.n_frames} frames are linear mixtures of {recorded}: displacement was "
            "interpolated, between frames that are far apart by tenths of a millimetre wrongly",
            "give the frames as they were recorded, with their own pressures; "
            + _done(recorded, found),
        )


def _done(recorded: int, found: BulgeTest | None) -> str:
    if found is None:
        return f"bulgefit diagnose counts these as {recorded}"
    at = ", ".join(f"{10.0 * one:.4g}" for one in found.pressure)
    return (
        f"of the {recorded}, these tell those at {at} bar, which bulgefit diagnose goes by and "
        "bulgefit convert --recorded writes"
    )
