"""Does benchmarks/robustness.py tell losses of ellipticity from snaps and from none?"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from bulgefit.errors import Cause, SolveError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import solve
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.trace import trace


@pytest.fixture
def benchmark(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    return import_module("robustness")


@pytest.mark.parametrize(("seed", "number"), [(64, 987), (68, 30)])
def test_a_path_that_leads_over_a_snap_is_no_path_beyond_a_loss(
    benchmark: ModuleType, seed: int, number: int
) -> None:
    """Shapes on both sides are stable, and volume turns back there as pressure does.

    They are 0.27 mm apart; of the other set, by a hundredth, steps of 0.2 % led over that and back.
    """
    case = benchmark.draw(seed, number)
    membrane, stiffness = case.membrane(), orthotropic_stiffness(*case.moduli, case.nu12)
    with pytest.raises(SolveError) as caught:
        trace(membrane, stiffness)
    loss = caught.value
    assert loss.cause is Cause.LOSS_OF_ELLIPTICITY
    below = trace(membrane, stiffness, (1e-4, 0.99 * loss.reached))
    assert not benchmark._goes_on(membrane, stiffness, below, loss)


def test_a_path_without_a_snap_comes_down_as_it_went_up(benchmark: ModuleType) -> None:
    membrane = Membrane(disc(100.0, 2), 0.81, fabric=Fabric(slack=(-0.003, -0.002)))
    stiffness = orthotropic_stiffness(330.0, 240.0, 30.0, 0.24)
    path = trace(membrane, stiffness)
    low, high = (
        solve(membrane, path(p)[0], p, stiffness, follow=True).displacement for p in (0.1, 0.1002)
    )
    assert not benchmark._comes_down_apart(membrane, stiffness, low, high, 0.1)
    aside = low + 2.0 * benchmark.TOLERANCE * np.eye(3)[2]
    assert benchmark._comes_down_apart(membrane, stiffness, aside, high, 0.1)
