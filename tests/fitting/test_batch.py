"""Is the spread of specimens told as statistics have it?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.errors import InputError
from bulgefit.fitting.batch import SCATTERED, batch_of, spread_of


def test_by_hand() -> None:
    """Values 1, 2, 6 with errors 1, 1, 2: weights 1, 1, 1/4, weighted mean 2."""
    found = spread_of([1.0, 2.0, 6.0], [1.0, 1.0, 2.0], "MPa")
    assert found.count == 3
    assert found.mean == 3.0
    assert found.standard_deviation == pytest.approx(np.sqrt(7.0))
    assert found.error_of_mean == pytest.approx(np.sqrt(7.0 / 3.0))
    assert found.scatter == pytest.approx(np.sqrt(7.0 - 2.0))
    assert found.chi_square == pytest.approx(1.0 + 0.0 + 4.0)
    # two degrees of freedom: exp(-x/2)
    assert found.probability == pytest.approx(np.exp(-2.5))


def test_few_specimens() -> None:
    assert spread_of([], [], "MPa").mean is None
    alone = spread_of([5.0], [1.0], "MPa")
    assert (alone.mean, alone.standard_deviation, alone.scatter) == (5.0, None, None)
    same = spread_of([5.0, 5.0], [1.0, 1.0], "MPa")
    assert (same.standard_deviation, same.scatter, same.chi_square) == (0.0, 0.0, 0.0)
    assert same.probability == 1.0
    with pytest.raises(InputError, match="needs a fit"):
        batch_of([])


def test_specimens_that_do_not_differ_are_seldom_said_to() -> None:
    """By chance alone in SCATTERED of 2000 batches, within four binomial deviations."""
    rng = np.random.default_rng(3)
    errors = np.array([0.5, 1.0, 2.0, 1.0, 0.7])
    said = [
        spread_of(300.0 + errors * rng.standard_normal(5), errors, "MPa").probability < SCATTERED
        for _ in range(2000)
    ]
    assert np.mean(said) == pytest.approx(
        SCATTERED, abs=4 * np.sqrt(SCATTERED * (1 - SCATTERED) / 2000)
    )


def test_scatter_is_that_of_the_specimens() -> None:
    """Squared, it has their variance as its mean, whatever the errors: 5000 batches of 6."""
    rng = np.random.default_rng(4)
    errors = np.array([2.0, 4.0, 6.0, 2.0, 4.0, 6.0])
    values = 300.0 + rng.normal(0, 12.0, (5000, 6)) + errors * rng.standard_normal((5000, 6))
    square = np.array([spread_of(v, errors, "MPa").scatter for v in values]) ** 2
    assert square.mean() == pytest.approx(144.0, abs=4 * square.std() / np.sqrt(5000))
