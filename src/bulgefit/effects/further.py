"""Which further measurements may tell an effect's parameters directly?"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

__all__ = ["Further", "Told"]


class Further(StrEnum):
    """A measurement beside the test's own frames, in words."""

    AT_REST = "static images (four times the frames' precision at rest)"
    SHAPE = "shape at zero pressure"
    HOLD = "hold at the highest pressure"
    UNLOADING = "unloading branch"


class Told(NamedTuple):
    """Parameters that a further measurement tells directly, with this standard error each."""

    by: Further
    names: tuple[str, ...]
    error: float
