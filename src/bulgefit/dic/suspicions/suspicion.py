"""What is said of one thing that looks wrong?"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Suspicion"]


@dataclass(frozen=True)
class Suspicion:
    """One thing that looks wrong with a test.

    Attributes
    ----------
    code : str
        A name that scripts may ask for; it stays the same from version to version.
    text : str
        What looks wrong, with its numbers, on one line.
    remedy : str
        What to do, with the command where there is one.
    """

    code: str
    text: str
    remedy: str
