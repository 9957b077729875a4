"""The law that is told, and the heights that are implied: against truth and closed errors."""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import catalogue
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.implied_reference import implied_references
from bulgefit.gap.law_table import SECANTS, LawTable, law_table
from bulgefit.gap.level import Level
from bulgefit.gap.regress import Regression, regress

TRUTH = {
    "E1": 340.0,
    "E2": 210.0,
    "G12": 20.0,
    "nonlinear_material.k_x": 3.0,
    "nonlinear_material.k_y": -1.0,
    "prestrain.slack_x": 0.004,
    "initial_shape.h0": 2.0,
    "reference_state.z30": 0.3,
}
KEYS = tuple(Key.of(name) for name in TRUTH)
VALUES = {Key.of(name): value for name, value in TRUTH.items()}


@pytest.fixture(scope="module")
def seen(made_by_the_model) -> Data:
    return made_by_the_model(TRUTH, 15.0, 6, 4)


@pytest.fixture(scope="module")
def fit(seen) -> Regression:
    return regress([seen], KEYS, VALUES)


@pytest.fixture(scope="module")
def table(seen, fit) -> LawTable:
    return law_table([seen], fit, Level())


def test_the_law_is_told_and_so_are_its_errors(table: LawTable, fit: Regression) -> None:
    """N = t E (e + k e²), whose derivatives by E and k are closed."""
    strain, covariance = table.strain, fit.covariance
    assert set(SECANTS) <= {*strain.tolist()}
    assert table.bent
    for axis, (modulus, gain) in enumerate((("E1", "k_x"), ("E2", "k_y"))):
        keys = Key.of(modulus), Key("nonlinear_material", gain)
        e, k = (fit.values[key] for key in keys)
        np.testing.assert_allclose(table.resultant[axis], 0.81 * e * (strain + k * strain**2))
        rows = 0.81 * np.array([strain + k * strain**2, e * strain**2])
        place = [fit.columns.index(key) for key in keys]
        variance = np.einsum("ik,ij,jk->k", rows, covariance[np.ix_(place, place)], rows)
        np.testing.assert_allclose(table.stderr[axis], np.sqrt(variance), rtol=1e-5)
        true = 0.81 * TRUTH[modulus] * (strain + VALUES[keys[1]] * strain**2)
        assert (np.abs(table.resultant[axis] - true) < 4.0 * table.stderr[axis]).all()


def test_secants_are_the_laws(table: LawTable) -> None:
    told = table.secants()
    at = SECANTS.index(0.03)
    resultant = np.interp(0.03, table.strain, table.resultant[0])
    assert told["E1"]["value"][at] == pytest.approx(resultant / (0.81 * 0.03), rel=1e-12)


def test_the_strain_that_is_reached_is_the_membranes(
    table: LawTable, seen: Data, fit: Regression
) -> None:
    """At the apex the fabric is stretched as its meridian is, by the angle that the points make."""
    (prediction,) = fit.predictions
    nodes, moved = seen.specimen.mesh.nodes, prediction.shapes.displacement[-1]
    line = np.flatnonzero((np.abs(nodes[:, 1]) < 1e-6) & (np.abs(nodes[:, 0]) <= 100.0))
    line = line[np.argsort(nodes[line, 0])]
    rest = np.column_stack([nodes[line, 0], 2.0 * (1.0 - (nodes[line, 0] / 100.0) ** 2)])
    there = rest + moved[line][:, [0, 2]]
    lengths = [np.linalg.norm(np.diff(curve, axis=0), axis=1) for curve in (rest, there)]
    along = np.log(lengths[1] / lengths[0]) - TRUTH["prestrain.slack_x"]
    assert table.reached[0] >= along.max() - 1e-3
    assert table.reached[0] == pytest.approx(along.max(), rel=0.15)


def test_the_height_is_what_was_put_in(seen: Data, fit: Regression) -> None:
    """z0 and what the reference shows, over the plane through the points."""
    (implied,) = implied_references([seen], fit)
    points = seen.specimen.reference
    x, y = points[:, :2].T / 100.0
    height = 2.0 * (1.0 - x**2 - y**2) + 0.3 * (2.5 * x**3 - 1.5 * x)
    plane = np.column_stack([np.ones(len(x)), x, y])
    above = height - plane @ np.linalg.lstsq(plane, height, rcond=None)[0]
    assert implied.stderr is not None
    assert 0.0 < implied.stderr < 0.05
    apex = above[np.argmin(np.hypot(x, y))]
    assert abs(implied.apex_mm - apex) < 4.0 * implied.stderr
    assert implied.rms_mm == pytest.approx(np.sqrt((above**2).mean()), rel=0.02)


def test_offsets_of_the_points_are_heights_turned_round(seen: Data, fit: Regression) -> None:
    """What all frames are short of was there before: beside offsets the same height is implied."""
    names = ("initial_shape", "nonlinear_material", "prestrain")
    coordinates = Coordinates.of([catalogue()[n] for n in names], [seen.specimen.nulls()])
    layout = Layout.of(coordinates.groups)
    start = np.array(
        [
            c.parameter.to_coordinate(VALUES[c.key]) if c.key in VALUES else c.null
            for c in coordinates.every
        ]
    )
    weighing = Weighing([seen], coordinates, [Creases.of(seen, np.full(3, 0.5), 0.0)])
    beside = regression_of(weighing, descend(weighing, layout, layout.whole(), start))
    (implied,), (other,) = (implied_references([seen], f) for f in (beside, fit))
    assert implied.stderr is not None
    assert other.stderr is not None
    assert abs(implied.apex_mm - other.apex_mm) < 4.0 * np.hypot(implied.stderr, other.stderr)
    # six frames of noise in one point, at the least
    assert implied.stderr > 0.9 * seen.sigma[2] / np.sqrt(6.0)


def test_a_model_without_height_says_nothing_of_one(seen: Data, fit: Regression) -> None:
    alone = regress([seen], KEYS[:3], {k: VALUES[k] for k in KEYS[:3]})
    (implied,) = implied_references([seen], alone)
    assert (implied.apex_mm, implied.stderr, implied.rms_mm) == (0.0, None, 0.0)
