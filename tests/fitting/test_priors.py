"""What is believed before a fit: is its own doubt in the errors, and does it speak against data?"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fitting.beliefs import Belief
from bulgefit.fitting.fit import fit, weighed
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.problem import Prior, Problem
from bulgefit.fitting.result import FitResult
from bulgefit.model.parameters import material
from bulgefit.model.setup import Setup

Maker = Callable[..., BulgeTest]

ONE = material("isotropic", E=250, nu=0.24)

#: Means of the absolute, squares of a likelihood.
BOTH = pytest.mark.parametrize("name", ["e_w", "likelihood"])


def fitted(test: BulgeTest, setup: Setup, name: str, **options: object) -> FitResult:
    return fit(
        test, name, material="isotropic", starts=1, setup=setup, bounds={"E": (100, 500)}, **options
    )


@BOTH
def test_an_error_tends_to_the_priors_where_that_is_all_that_is_known(
    name: str, make: Maker, setup: Setup
) -> None:
    test = make(ONE, noise=0.3, frames=8, points=100)
    free = fitted(test, setup, name)
    best, error = free.material.values["E"], free.uncertainty.stderr["E"]
    assert error is not None
    tight = fitted(test, setup, name, priors={"E": Prior(best, 1e-3 * error)}).uncertainty
    assert tight.stderr["E"] == pytest.approx(1e-3 * error, rel=1e-3)
    assert tight.parts["E"]["prior"] == pytest.approx(1e-3 * error, rel=1e-3)
    assert tight.parts["E"]["data"] < 1e-2 * tight.parts["E"]["prior"]
    assert tight.noise_stderr["E"] == pytest.approx(tight.block_stderr["E"], rel=1e-3)
    # what is known without a doubt has the quantile of a normal distribution
    low, high = tight.interval95["E"] or (0.0, 0.0)
    assert high - low == pytest.approx(2 * 1.95996 * 1e-3 * error, rel=0.01)
    weak = fitted(test, setup, name, priors={"E": Prior(best, 1e3 * error)}).uncertainty
    assert weak.stderr["E"] == pytest.approx(error, rel=1e-2)
    assert weak.interval95["E"] == pytest.approx(free.uncertainty.interval95["E"], rel=1e-3)


@BOTH
def test_data_and_a_prior_of_like_weight(name: str, make: Maker, setup: Setup) -> None:
    """An estimate that goes by a share k of the prior's mean has the variance (1-k)² e² + k² s².

    The share is that by which fits follow the mean. Of a likelihood it is that of two normal
    estimates, e²/(s² + e²), by hand.
    """
    test = make(ONE, noise=0.3, frames=8, points=100)
    free = fitted(test, setup, name)
    best, error = free.material.values["E"], free.uncertainty.stderr["E"]
    assert error is not None
    means = best - error, best + error
    pulled = [fitted(test, setup, name, priors={"E": Prior(m, error)}) for m in means]
    share = np.diff([p.material.values["E"] for p in pulled])[0] / np.diff(means)[0]
    if name == "likelihood":
        problem = Problem(Objective([test], name, setup), "isotropic", bounds={"E": (100.0, 500.0)})
        z = problem.coordinates({"E": best})
        weighed(problem, z)
        rows = problem.evaluate(z, derivatives=True).rows
        assert rows is not None
        curvature = rows.normal(np.zeros(1), 0.0)[0][0, 0] / problem.value_slope(0, z) ** 2
        assert share == pytest.approx(1 / (1 + error**2 * curvature), rel=0.02)
    expected = np.hypot((1 - share) * error, share * error)
    found = np.mean([p.uncertainty.stderr["E"] for p in pulled])
    # absolute deviations are no parabola: their medians move by steps from value to value
    assert found == pytest.approx(expected, rel=0.02 if name == "likelihood" else 0.1)


def test_the_slope_of_a_prior_of_a_square_is_that_of_differences(make: Maker, setup: Setup) -> None:
    name = "dic_smoothing.window"
    problem = Problem(
        Objective([make(ONE, noise=0.05)], "likelihood", setup),
        "isotropic",
        effects=["dic_smoothing"],
        priors={name: Prior(3.0, 2.0)},
    )
    z = problem.coordinates({"E": 250.0, name: 6.0})
    ends = []
    for sign in (-1, 1):
        other = z.copy()
        other[1] += sign * 1e-5
        ends.append(problem._believed(0.0, other))
    assert problem.pull(0.0, z)[1][1] == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-4)


@BOTH
def test_a_prior_that_the_data_speak_against_is_said(name: str, make: Maker, setup: Setup) -> None:
    test = make(ONE, noise=0.05, frames=8)
    believed = Prior(280.0, 1e-3)
    found = fitted(test, setup, name, priors={"E": believed})
    alone = fitted(test, setup, name)
    (belief,) = found.beliefs
    error = alone.uncertainty.stderr["E"]
    assert belief.prior == believed
    assert belief.alone == pytest.approx(alone.material.values["E"], abs=0.1 * (error or 0.0))
    assert belief.stderr == pytest.approx(error, rel=0.05)
    (said,) = [w.text for w in found.quality.warnings if w.code == "prior_conflict"]
    assert said.startswith("E: the prior, 280 ± 0.001, and what is found without it, 2")
    assert "prior E = 280 ± 0.001 MPa; without it, 2" in found.report()
    assert found.to_dict()["priors"][0]["apart"] == pytest.approx(belief.apart)
    agreeing = fitted(test, setup, name, priors={"E": Prior(belief.alone or 0.0, 1.0)})
    assert "prior_conflict" not in {w.code for w in agreeing.quality.warnings}


def test_a_conflict_begins_at_three_combined_standard_errors() -> None:
    for apart, conflicts in ((2.99, False), (3.01, True)):
        belief = Belief("E", Prior(100.0, 3.0), 100.0 - 5.0 * apart, 4.0)
        assert belief.apart == pytest.approx(apart)
        assert belief.conflicts is conflicts
    assert not Belief("E", Prior(100.0, 3.0), None, None).conflicts
