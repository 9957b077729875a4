"""Maps of what has no name: values, and standard errors at each of their places."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.effects.fields.base import Sampled
from bulgefit.effects.parameter import Owned
from bulgefit.effects.registry import catalogue, fields
from bulgefit.gap.as_json import _map_of
from bulgefit.gap.data import Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.explanation import FoundField
from bulgefit.gap.found_fields import creases_found, field_found
from bulgefit.gap.keys import by_value
from bulgefit.gap.regress import Regression

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0, "stiffness_field.b60": -0.4}
FIELD = fields()["stiffness_field"]
GROUP = Owned("stiffness_field")


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> Data:
    return made_by_the_model(TRUTH, 12.0, frames=6, seed=5)


def fitted(data: Data, effect: str, creases: list[Creases] | None = None) -> Regression:
    one = {**catalogue(), **fields()}[effect]
    coordinates = Coordinates.of([one], [data.specimen.nulls()])
    weighing = Weighing([data], coordinates, creases)
    layout = Layout.of(coordinates.groups)
    start = np.array(layout.null)
    start[:3] = np.log([TRUTH[m.name] for m in MODULI])
    found = descend(weighing, layout, freeze({Owned(effect): 0}), start)
    assert found.converged
    return regression_of(weighing, found)


@pytest.fixture(scope="module")
def fit(data: Data) -> Regression:
    return fitted(data, "stiffness_field")


@pytest.fixture(scope="module")
def spot(data: Data, fit: Regression) -> FoundField:
    return field_found(GROUP, {k: v for k, v in fit.values.items() if k.effect}, [data], fit)


def test_a_fields_errors_are_those_of_draws_from_the_posterior(
    data: Data, fit: Regression, spot: FoundField
) -> None:
    keys, rng = [k for k in fit.columns if k.effect], np.random.default_rng(8)
    columns = [fit.columns.index(k) for k in keys]
    values = np.array([fit.values[k] for k in keys])
    covariance = fit.covariance[np.ix_(columns, columns)]
    drawn = [
        FIELD.sampled(
            dict(zip((k.parameter for k in keys), row, strict=True)), 100.0, np.array([0.3])
        ).values
        for row in rng.multivariate_normal(values, covariance, 2000)
    ]
    places = slice(None, None, 97)
    np.testing.assert_allclose(spot.stderr[places], np.std(drawn, axis=0)[places], rtol=0.1)


def test_the_true_field_lies_within_its_errors(spot: FoundField) -> None:
    own = {p.name: 0.0 for p in FIELD.parameters} | {"b60": TRUTH["stiffness_field.b60"]}
    true = FIELD.sampled(own, 100.0, np.array([0.3]))
    away = (spot.sampled.values - true.values) / spot.stderr
    assert np.abs(away).max() < 4.0
    assert 0.5 < np.sqrt((away**2).mean()) < 1.5
    assert abs(spot.sampled.largest[0]) > 10.0 * spot.stderr[spot.sampled.at_largest]


def test_offsets_of_points_are_as_sure_as_beside_a_column_for_each(data: Data) -> None:
    """Standard errors by the inverse of the whole normal matrix, offsets among its columns."""
    creases = [Creases.of(data, np.array([0.004, 0.004, 0.008]), 20.0)]
    fit = fitted(data, "rigid_motion", creases)
    specimen, names = data.specimen, [k.name for k in fit.columns]
    prediction = specimen.predict({k.name: v for k, v in fit.values.items()}, names)
    scale = np.array([by_value(n, prediction.shapes.values) for n in names])
    jacobian = prediction.derivative * scale[:, None, None, None] * data.weight
    frames, points = jacobian.shape[1:3]
    # each component by itself: rows of frames and points, by parameters and by offsets
    size, offsets = len(names), 3 * points
    whole = np.zeros((size + offsets, size + offsets))
    for c in range(3):
        columns = np.zeros((frames, points, points))
        columns[:, np.arange(points), np.arange(points)] = data.weight[..., c]
        rows = np.concatenate([jacobian[..., c].reshape(size, -1), columns.reshape(-1, points).T])
        at = [*range(size), *range(size + c * points, size + (c + 1) * points)]
        whole[np.ix_(at, at)] += rows @ rows.T / data.inflation
    across = whole[:size, size:]
    projected = whole[:size, :size] - across / np.diag(whole)[size:] @ across.T
    whole[:size, :size] += np.linalg.inv(fit.covariance) - projected  # priors, and offsets' own
    exact = np.sqrt(np.diag(np.linalg.inv(whole))[size:].reshape(3, points).T)
    (error,), (offset,) = fit.offset_errors, fit.offsets
    assert error is not None
    assert offset is not None
    assert data.persistent == 0.0
    np.testing.assert_allclose(error, exact, rtol=1e-6)
    found = creases_found(Owned("reference_field"), data, offset, error)
    towards = offset / np.linalg.norm(offset, axis=1)[:, None]
    np.testing.assert_allclose(found.stderr, np.sqrt(((towards * exact) ** 2).sum(axis=1)))


@pytest.mark.parametrize("scattered", [False, True])
def test_a_map_keeps_some_of_many_places(scattered: bool, spot: FoundField) -> None:
    found, rng = spot, np.random.default_rng(2)
    if scattered:
        where = {k: v + rng.uniform(-1.0, 1.0, len(v)) for k, v in spot.sampled.where.items()}
        found = FoundField(GROUP, Sampled(spot.sampled.values, where), spot.stderr)
    told = _map_of(found)
    count = len(told["value"])
    assert {len(v) for v in told.values()} == {count}
    assert 500 < count <= 1000
    assert np.hypot(told["x_mm"], told["y_mm"]).max() > 90.0
    if not scattered:  # every k-th line either way
        assert len({*np.diff(np.unique(told["x_mm"])).round(1)}) == 1
    for x, y, value, error in zip(*told.values(), strict=True):
        at = np.hypot(found.sampled.where["x_mm"] - x, found.sampled.where["y_mm"] - y).argmin()
        assert value == pytest.approx(found.sampled.values[at], rel=1e-3, abs=1e-12)
        assert error == pytest.approx(found.stderr[at], rel=1e-3)
