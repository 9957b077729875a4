"""Was a frame written twice?"""

from __future__ import annotations

from collections.abc import Iterator

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import copied_frames
from bulgefit.dic.suspicions.suspicion import Suspicion
from bulgefit.shown import some_of

__all__ = ["about_copies"]


def about_copies(test: BulgeTest) -> Iterator[Suspicion]:
    """Frames that hold the same data as another one at the same pressure."""
    copies = copied_frames(test)
    if copies:
        named = [f"{copy} of {first}" for copy, first in copies.items()]
        yield Suspicion(
            "frames_copied",
            f"frames hold the same data as others at the same pressure: {some_of(named)}; they are "
            "counted once",
            "export each frame once",
        )
