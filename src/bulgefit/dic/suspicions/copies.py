"""Was a frame written twice?"""

from __future__ import annotations

from collections.abc import Iterator

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.copies import copied_frames
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_copies"]

#: Copies that are named one by one.
_NAMED = 5


def about_copies(test: BulgeTest) -> Iterator[Suspicion]:
    """Frames that hold the same data as another one at the same pressure."""
    copies = copied_frames(test)
    if copies:
        named = [f"{copy} of {first}" for copy, first in copies.items()]
        more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
        yield Suspicion(
            "frames_copied",
            f"frames hold the same data as others at the same pressure: {', '.join(named[:_NAMED])}"
            f"{more}; they are counted once",
            "export each frame once",
        )
