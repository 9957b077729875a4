"""Does docs/json.md name every key of a result's JSON?"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bulgefit.effects.registry import acting, fields
from bulgefit.fitting.batch import batch_of
from bulgefit.fitting.crossval import crossval
from bulgefit.model.setup import Setup
from bulgefit.report.record import record_of

PAGE = (Path(__file__).parents[2] / "docs" / "json.md").read_text(encoding="utf-8")
TOLD = {word for code in re.findall(r"`([^`]+)`", PAGE) for word in code.split(".")}
#: Keys that are somebody's name.
MODULI = {"E1", "E2", "G12", "nu12"}


def keys(value: Any) -> Iterator[str]:
    """All keys of a result, at whatever depth."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield key
            yield from keys(item)
    elif isinstance(value, list):
        for item in value:
            yield from keys(item)


def untold(result: Mapping[str, Any], *names: str) -> set[str]:
    """Keys that the page does not name, and that are no names themselves."""
    parameters = {p.name for effect in acting().values() for p in effect.parameters}
    known = TOLD | MODULI | {*names} | {*acting()} | parameters
    return {key for key in keys(result) if key not in known and not re.search("[.@]", key)}


def test_keys_of_a_fit(fitted):
    assert len(set(keys(fitted))) > 60
    assert not untold(fitted)


def test_keys_of_a_batch(fit_found):
    assert not untold(batch_of([fit_found, fit_found]).to_dict())


def test_keys_of_a_cross_validation(plain, plate):
    assert not untold(crossval([plain, plate], setup=Setup(refine=1), starts=1).to_dict())


@pytest.mark.parametrize("which", ["found", "pair"])
def test_keys_of_a_diagnosis(which, request):
    diagnosis = request.getfixturevalue(which)
    record = record_of(diagnosis)
    assert len(set(keys(record))) > 100
    assert not untold(record, *(test.name for test in diagnosis.tests))


@pytest.mark.parametrize("name", [name for name, field in fields().items() if field.parameters])
def test_places_of_fields(name):
    field = fields()[name]
    nulls = {p.name: 0.0 for p in field.parameters}
    assert {*field.sampled(nulls, 100.0, np.array([0.1, 0.2])).where} <= TOLD
