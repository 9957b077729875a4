"""Do effects that act together do the same in a made test as in the model that diagnoses it?"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import bulgefit
from bulgefit.dic import BulgeTest
from bulgefit.trial.camera import Setting
from bulgefit.trial.draw import Draw
from bulgefit.trial.recording import Recipe
from bulgefit.trial.signature import noise_free


@pytest.fixture
def benchmark(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    return import_module("two_programs")


@pytest.mark.parametrize("number", [0, 1, 2, 3, 4])
def test_what_is_drawn_together_differs_by_less_than_a_tenth_of_the_noise(
    benchmark: ModuleType, number: int
) -> None:
    """Two to six effects: a difference would move the moduli, and no noise would tell."""
    found = benchmark.compared(1, number)
    assert found is not None
    assert len(found.drawn.effects) == number + 2
    assert (found.apart < benchmark.ALLOWED).all()


def test_what_goes_by_time_beside_a_clamp_that_slips(benchmark: ModuleType) -> None:
    """The cloth creeps, its clamp does not: taken for one that does it is off by 5 µm."""
    line = np.linspace(-88.0, 88.0, 15)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    points = points[np.hypot(*points.T) < 92.0]
    pressure, time = np.array([0.005, 0.05, 0.12, 0.2, 0.25]), np.array([0.0, 1.0, 2.0, 3.0, 5.0])
    values = {"creep.rate": 0.06, "clamp_slip.compliance": 0.015}
    moduli = {"E1": 330.0, "E2": 220.0, "G12": 16.0}
    drawn = Draw(("creep", "clamp_slip"), values, (), moduli)
    _, seen = noise_free(drawn, Setting(points, pressure, 50.0 * time), Recipe().fineness)
    reference = np.column_stack([points, np.zeros(len(points))])
    test = BulgeTest.from_arrays(reference, seen, pressure, time=50.0 * time)
    apart = bulgefit.predict(test, moduli, effects=values).displacement - seen
    assert (np.sqrt((apart**2).mean(axis=(0, 1))) < benchmark.ALLOWED).all()
