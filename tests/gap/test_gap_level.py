"""Moduli in most places of a cloth whose stiffness varies, and how sure they are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.effects.parameter import Key, Owned
from bulgefit.effects.registry import fields
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.law_table import law_table
from bulgefit.gap.level import Level
from bulgefit.gap.regress import Regression

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0, "stiffness_field.b60": -0.4}
FIELD = fields()["stiffness_field"]


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> Data:
    return made_by_the_model(TRUTH, 12.0, frames=6, seed=5)


@pytest.fixture(scope="module")
def fit(data: Data) -> Regression:
    coordinates = Coordinates.of([FIELD], [data.specimen.nulls()])
    weighing, layout = Weighing([data], coordinates), Layout.of(coordinates.groups)
    start = np.array(layout.null)
    start[:3] = np.log([TRUTH[m.name] for m in MODULI])
    found = descend(weighing, layout, freeze({Owned("stiffness_field"): 0}), start)
    return regression_of(weighing, found)


def level_of(fit: Regression) -> Level:
    return Level.of(FIELD, {k: v for k, v in fit.values.items() if k.effect})


def test_its_errors_are_those_of_draws_from_the_posterior(fit: Regression) -> None:
    """Of moduli times the field where it is the median, which moves as much as either."""
    level, rng = level_of(fit), np.random.default_rng(3)
    away = rng.multivariate_normal(np.zeros(len(fit.columns)), fit.covariance, 20000)
    row = np.array([level.slopes.get(key, 0.0) for key in fit.columns])
    along = np.exp(away @ row + level.error * rng.normal(size=len(away)))
    own = {p.name: 0.0 for p in FIELD.parameters} | {"b60": TRUTH["stiffness_field.b60"]}
    true = FIELD.typical(own).value
    for m, error in level.errors(fit).items():
        drawn = level.value * along * (fit.values[m] + away[:, fit.columns.index(m)])
        assert error == pytest.approx(drawn.std(), rel=0.03)
        assert error > level.value * fit.standard_errors()[m]
        assert abs(level.value * fit.values[m] - true * TRUTH[m.name]) < 4 * error


def test_a_straight_law_is_as_sure_as_its_moduli(data: Data, fit: Regression) -> None:
    """Uniaxial force goes as E1 along warp and as E2 along fill, whatever the other moduli are."""
    level = level_of(fit)
    law, errors = law_table([data], fit, level), level.errors(fit)
    for axis, m in enumerate(MODULI[:2]):
        force = level.value * fit.values[m] * data.specimen.test.thickness * law.strain
        np.testing.assert_allclose(law.resultant[axis], force, rtol=1e-6)
        relative = law.stderr[axis] / law.resultant[axis]
        np.testing.assert_allclose(relative, errors[m] / (level.value * fit.values[m]), rtol=1e-4)


def test_without_a_field_it_is_one(fit: Regression) -> None:
    level, errors = Level.of_all([]), fit.standard_errors()
    assert (level.value, level.error, dict(level.slopes)) == (1.0, 0.0, {})
    assert level.errors(fit) == pytest.approx({m: errors[m] for m in MODULI})
    two = Level.of_all([Level(1.1, {Key("a", "b"): 2.0}, 0.03), Level(2.0, {}, 0.04)])
    assert (two.value, two.error) == (pytest.approx(2.2), pytest.approx(0.05))
    assert two.slopes == {Key("a", "b"): 2.0}
