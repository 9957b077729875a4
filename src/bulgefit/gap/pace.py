"""How long will a diagnosis still take? By how long it has taken so far, stage by stage.

What is to come depends on what is found: where all that has names leaves nothing but noise, no
fields are freed, and the fewer causes there are, the fewer models are tried. So the time left is
told as a range, which narrows from stage to stage.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum

__all__ = ["Pace", "Stage"]


class Stage(Enum):
    """What begins."""

    SEARCH = "models of what has a name"
    FIELDS = "beside fields, since that leaves more than noise"
    UNNAMED = "units anew, beside what has no name"
    UNITS = "units anew, beside nothing else"
    POINTS = "by all points"
    PARTS = "without each part"
    REST = "what follows from it"


#: Least and most of the time so far that is left when a stage begins: those of five made tests (two
#: with causes without a name, one with known ones, one clean, a family), which
#: benchmarks/diagnosis.py, `--pace`, finds, and of measured ones, one alone, two and three together
#: (docs/gap.md), some more either way. What a measured test has without a name is in several
#: places, each of which is tried alone. On another machine, and of more points, all is as much
#: slower or faster. Before the first fit of everything, which takes a clean test half of its time
#: and the measured ones a hundredth, nothing can be told.
_AHEAD = {
    Stage.SEARCH: (0.8, 300.0),
    Stage.FIELDS: (0.7, 40.0),
    Stage.UNNAMED: (0.2, 15.0),
    Stage.UNITS: (0.4, 2.0),
    Stage.POINTS: (0.01, 1.0),
    Stage.PARTS: (0.0, 0.9),
    Stage.REST: (0.0, 0.1),
}


class Pace:
    """Tells the time left.

    Parameters
    ----------
    left : callable
        Told the least and the most seconds that are left, whenever a stage begins.
    """

    def __init__(self, left: Callable[[float, float], None] = lambda least, most: None) -> None:
        self._left, self._began = left, time.monotonic()

    def begins(self, stage: Stage) -> None:
        """Tell what is left from here on."""
        least, most = _AHEAD[stage]
        spent = time.monotonic() - self._began
        self._left(least * spent, most * spent)
