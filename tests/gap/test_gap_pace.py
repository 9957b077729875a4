"""Is what is tried told in a line, and the time left by the time so far?"""

from __future__ import annotations

import pytest

from bulgefit.effects.parameter import Owned
from bulgefit.gap import pace
from bulgefit.gap.evidence import problem
from bulgefit.gap.evidence.problem import Model
from bulgefit.gap.evidence.told import told
from bulgefit.gap.pace import Pace, Stage


def freeze(forms: dict[str, int]) -> Model:
    return problem.freeze({Owned.read(name): form for name, form in forms.items()})


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


def test_a_model_of_many_parts_is_told_in_a_line() -> None:
    """By all of its parts where these fit, else by what came and went, else by their number."""
    few = freeze({"rim_lift@0": 0, "nonlinear_material": 0})
    assert told(few, freeze({})) == "nonlinear_material + rim_lift@0"
    assert told(freeze({}), few) == "the moduli alone"
    many = {f"clamp_slip@{i}": 0 for i in range(9)}
    more = freeze({**many, "rim_lift@0": 0, "prestrain@2": 0})
    assert told(more, freeze({**many, "lens_distortion@1": 0})) == (
        "11 parts: +prestrain@2 +rim_lift@0 -lens_distortion@1"
    )
    # another form of one of them, or another start
    assert told(freeze(many | {"clamp_slip@1": 1}), freeze(many)) == "9 parts: those of before"
    assert told(freeze(many), few) == "9 parts"
