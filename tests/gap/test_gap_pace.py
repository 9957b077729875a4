"""Is the time left told by the time so far?"""

from __future__ import annotations

import pytest

from bulgefit.gap import pace
from bulgefit.gap.pace import Pace, Stage


def test_what_is_left_goes_with_what_was_spent(monkeypatch: pytest.MonkeyPatch) -> None:
    """In proportion; of one time so far, the less is left the later the stage."""
    clock, told = [100.0], list[tuple[float, float]]()
    monkeypatch.setattr(pace.time, "monotonic", lambda: clock[0])
    found = Pace(lambda least, most: told.append((least, most)))
    for spent in (10.0, 20.0):
        clock[0] = 100.0 + spent
        for stage in Stage:
            found.begins(stage)
    first, second = told[: len(Stage)], told[len(Stage) :]
    assert [(2 * a, 2 * b) for a, b in first] == second
    assert all(0.0 <= least < most for least, most in told)
    assert [most for _, most in first] == sorted((most for _, most in first), reverse=True)
