"""How keys are written, and read again."""

from __future__ import annotations

import pytest

from bulgefit.effects.parameter import Key, Owned, by_key, of_specimen
from bulgefit.errors import InputError

WRITTEN = {
    "E1": Key("", "E1"),
    "clamp_slip.compliance": Key("clamp_slip", "compliance"),
    "clamp_slip.compliance@0": Key("clamp_slip", "compliance", 0),
    "initial_shape.h0@12": Key("initial_shape", "h0", 12),
}


@pytest.mark.parametrize("text", WRITTEN)
def test_what_is_written_is_read(text: str) -> None:
    assert Key.read(text) == WRITTEN[text]
    assert str(WRITTEN[text]) == text


def test_owners_are_written_and_read() -> None:
    assert [str(Owned("clamp_slip")), str(Owned("clamp_slip", 1))] == ["clamp_slip", "clamp_slip@1"]
    assert Owned.read("clamp_slip@1") == Owned("clamp_slip", 1)
    assert Owned.read("moduli") == Owned("moduli")


@pytest.mark.parametrize("text", ["a.b@", "a.b@x", "a.b@-1", "a.b@1@2", "a.b@1.0", "a.b@²"])
def test_what_is_no_number_of_a_test_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="behind the @ stands the number of a test"):
        Key.read(text)


def test_of_a_specimen_is_what_is_its_own_or_shared() -> None:
    values = by_key({"E1": 300.0, "a.b@0": 1.0, "a.b@1": 2.0, "a.c@1": 3.0})
    assert of_specimen(values, 0) == {"E1": 300.0, "a.b": 1.0}
    assert of_specimen(values, 1) == {"E1": 300.0, "a.b": 2.0, "a.c": 3.0}
    assert of_specimen(values, None) == {"E1": 300.0}
