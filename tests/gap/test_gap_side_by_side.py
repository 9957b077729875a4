"""Searches that do not wait for each other find the same, whoever does them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor

import numpy as np
import pytest

from bulgefit.effects.registry import catalogue
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.closely import closely
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.search import Search
from bulgefit.gap.evidence.ways import Ways
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.parallel.workers import open_executor

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0}
#: The first two of them stand for fields here.
EFFECTS = ("initial_shape", "prestrain", "clamp_slip", "fixture_motion", "registration")
CAUSES = {"prestrain.slack_x": 0.004, "clamp_slip.compliance": 0.02, "registration.x0": 0.8}


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> Data:
    return made_by_the_model({**TRUTH, **CAUSES}, 15.0, frames=7, seed=3)


@pytest.fixture(params=["threads", "processes"])
def workers(request: pytest.FixtureRequest) -> Iterator[Executor]:
    with open_executor(2, processes=request.param == "processes") as pool:
        yield pool


def searched(data: Data, executor: Executor | None) -> Search[Weighing]:
    """From everything at once by each field alone, and without each group."""
    coordinates = Coordinates.of([catalogue()[e] for e in EFFECTS], [data.specimen.nulls()])
    weighing, layout = Weighing([data.afresh()], coordinates), Layout.of(coordinates.groups)
    names = tuple(group.id for group in coordinates.groups if not group.always)
    search = Search(weighing, layout, names, executor=executor)
    start = np.array(layout.null)
    start[:3] = np.log(list(TRUTH.values()))
    assert search.fit(layout.whole(names), start, roughly=True) is not None
    Ways(search, start, fields=names[:2]).from_fields()
    closely(search)
    return search


@pytest.fixture(scope="module")
def here(data: Data) -> Search[Weighing]:
    return searched(data, None)


def test_to_the_last_bit_for_any_workers(
    data: Data, here: Search[Weighing], workers: Executor
) -> None:
    there = searched(data, workers)
    assert list(there.fits) == list(here.fits)
    for model, fit in here.fits.items():
        assert there.fits[model].score == fit.score
        np.testing.assert_array_equal(there.fits[model].x, fit.x)


def test_what_is_found_elsewhere_counts(here: Search[Weighing]) -> None:
    """The best model is that of the truth, and each model without a group of it was fitted."""
    best = here.best.model
    assert {name.effect for name, _ in best} == {cause.partition(".")[0] for cause in CAUSES}
    for part in best:
        assert best - {part} in here.fits
