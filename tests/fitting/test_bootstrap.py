"""Refits to drawn frames: as wide as the noise makes them, and the same for any workers."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting import objective as module
from bulgefit.fitting.bootstrap import Bootstrap, _drawn, bootstrap
from bulgefit.fitting.fit import fit
from bulgefit.fitting.objective import Objective
from bulgefit.model.parameters import material
from bulgefit.model.setup import Setup
from bulgefit.parallel.workers import open_executor

Maker = Callable[..., BulgeTest]

BOUNDS = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
ONE = material("isotropic", E=250, nu=0.24)


def test_intervals_are_as_wide_as_the_noise_makes_them(make: Maker, setup: Setup) -> None:
    options: dict[str, Any] = {"material": "isotropic", "starts": 1, "setup": setup}
    tests = [make(ONE, noise=0.2, frames=20, points=20, seed=i) for i in range(12)]
    fits = [fit(test, "e", **options) for test in tests]
    scatter = np.std([f.material.values["E"] for f in fits], ddof=1)
    spreads = [
        bootstrap(found, test, replicates=25).to_dict()["parameters"]["E"]["standard_deviation"]
        for found, test in zip(fits[:2], tests[:2], strict=True)
    ]
    # twelve fits tell their scatter to a fifth
    assert 0.5 * scatter < np.mean(spreads) < 2.0 * scatter


def test_workers_do_not_change_a_bit(make: Maker, setup: Setup) -> None:
    tests = [make(noise=0.05, name="a"), make(noise=0.05, seed=1, name="b", frames=6)]
    found = fit(tests, bounds=BOUNDS, starts=1, setup=setup)
    one = bootstrap(found, tests, replicates=6, seed=3)
    assert one.block == 2
    assert one.failures == 0
    assert len(np.unique(one.values, axis=0)) == 6
    assert bootstrap(found, tests, replicates=6, seed=3, workers=2).to_dict() == one.to_dict()
    with open_executor(2, processes=True) as pool:
        away = bootstrap(found, tests, replicates=6, seed=3, executor=pool)
    assert away.to_dict() == one.to_dict()
    assert bootstrap(found, tests, replicates=6, seed=4).to_dict() != one.to_dict()
    assert bootstrap(found, tests, replicates=3, seed=3).values.tolist() == one.values[:3].tolist()


def test_refits_are_to_all_data(make: Maker, setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample that descents look at changes neither their middle nor their width."""
    test = make(noise=0.05, points=1_000, frames=10)
    found = fit(test, bounds=BOUNDS, starts=1, setup=setup)
    whole = bootstrap(found, test, replicates=5).values
    monkeypatch.setattr(module, "SAMPLE", 3_000)
    sampled = bootstrap(found, test, replicates=5).values
    for j, error in enumerate(found.uncertainty.noise_stderr.values()):
        assert error is not None
        np.testing.assert_allclose(sampled[:, j], whole[:, j], atol=0.5 * error)


@pytest.mark.parametrize("average", ["points", "frames"])
@pytest.mark.parametrize("name", ["e_w", "e_z"])
def test_a_frame_drawn_twice_counts_twice(
    name: str, average: str, make: Maker, setup: Setup
) -> None:
    test = make(noise=0.05)
    lost = np.array(test.blocks[0].displacement)
    lost[1, 5:40] = np.nan  # frames of different weight
    sources = test.blocks[0].reference, test.pressure

    def objective(frames: list[int]) -> Objective:
        drawn = BulgeTest.from_arrays(sources[0], lost[frames], sources[1][frames])
        return Objective([drawn], name, setup, weight=0.1, average=average)

    whole, drawn = objective([0, 1, 2, 3, 4]), objective([0, 1, 1, 4, 4])
    repeated = whole.repeated([np.array([1.0, 2.0, 0.0, 0.0, 2.0])])
    assert repeated is not None
    values = {"E1": 300.0, "E2": 250.0, "G12": 20.0, "nu12": 0.24}

    def told(one: Objective) -> tuple[float, np.ndarray]:
        names = [tuple(values)]
        return one.slope(one.shapes([values], names), names, [np.eye(4)])

    assert told(repeated)[0] == pytest.approx(told(drawn)[0], rel=1e-9)
    np.testing.assert_allclose(told(repeated)[1], told(drawn)[1], rtol=1e-6)
    once = whole.repeated([np.ones(5)])
    assert once is not None
    assert told(once)[0] == told(whole)[0]
    assert whole.repeated([np.zeros(5)]) is None


def test_frames_are_drawn_in_runs() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        times = _drawn(np.arange(7.0), 3, rng)
        assert times.sum() == 7
        assert len(times) == 7
    many = sum(_drawn(np.arange(7.0), 3, rng) for _ in range(4000)) / 4000
    np.testing.assert_allclose(many, 1.0, atol=0.05)


def test_numbers_out_of_range(make: Maker, setup: Setup) -> None:
    test = make(ONE)
    found = fit(test, material="isotropic", starts=1, setup=setup)
    for options, said in (
        ({"replicates": 0}, "1 or more replicates, got 0"),
        ({"level": 1.0}, "between 0 and 1, got 1"),
        ({"block": 5}, "runs of 5 frames"),
        ({"block": 0}, "runs of 0 frames"),
    ):
        with pytest.raises(InputError, match=said):
            bootstrap(found, test, **options)
    with pytest.raises(InputError, match="two frames or more"):
        bootstrap(found, test.select(frames=[2]))


def test_report_and_json(make: Maker, setup: Setup) -> None:
    test = make(ONE, noise=0.05)
    found = fit(test, material="isotropic", free=["nu"], starts=1, setup=setup)
    sure = bootstrap(found, test, replicates=5)
    told = json.loads(json.dumps(sure.to_dict(), allow_nan=False))
    assert told["replicates"] == 5
    low, high = told["parameters"]["E"]["interval"]
    assert min(told["parameters"]["E"]["values"]) <= low < high
    lines = (
        Bootstrap(found.free, np.array([[250.0, 0.24], [252.0, 0.25]]), 1, 0.9, 2, 0)
        .report()
        .splitlines()
    )
    assert lines == [
        "90 % intervals of 2 refits to frames drawn in runs of 2; 1 failed",
        "  E           250.1 to 251.9 MPa",
        "  nu         0.2405 to 0.2495",
    ]
