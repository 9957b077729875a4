"""Normal equations with an offset of every point, against a column for each of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import Key
from bulgefit.gap.data import FOLDS, Data
from bulgefit.gap.effects import OFFSETS
from bulgefit.gap.normal import normal_equations
from bulgefit.gap.specimen import Specimen
from bulgefit.model.sight import Prediction

KEYS = tuple(Key.of(name) for name in ("E1", "E2", "rigid_motion.rotation_x"))
SIGMA = np.array([0.01, 0.02, 0.05])


@pytest.fixture(scope="module")
def scene() -> tuple[Data, Prediction]:
    """Points with values missing here and there, one in all but doubted frames."""
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-60, 60, (25, 2)), np.zeros(25)])
    measured = rng.normal(size=(12, 25, 3))
    measured[rng.random(measured.shape) < 0.1] = np.nan
    measured[3:, 7] = np.nan
    test = BulgeTest.from_arrays(points, measured, np.linspace(0.01, 0.25, 12))
    trust = np.where(np.arange(12) < 3, 0.4, 1.0)
    data = Data(Specimen(test, refine=1), SIGMA, np.isfinite(measured), trust=trust)
    derivative = rng.normal(size=(len(KEYS), 12, 25, 3))
    displacement = rng.normal(size=(12, 25, 3))
    return data, Prediction(displacement, derivative, SimpleNamespace(values={}))


def with_columns(data: Data, prediction: Prediction) -> tuple[np.ndarray, np.ndarray]:
    """Rows of all values by the parameters and one column for each point's component."""
    columns = [d * data.weight for d in prediction.derivative]
    for point in range(25):
        for axis in range(3):
            one = np.zeros(prediction.displacement.shape)
            one[:, point, axis] = data.share
            columns.append(one)
    return np.stack(columns, axis=-1), data.residual(prediction)


def test_the_step_is_that_with_a_column_for_each_offset(scene: tuple[Data, Prediction]) -> None:
    data, prediction = scene
    found = normal_equations([data], [prediction], (*KEYS, OFFSETS)).whole
    rows, residual = with_columns(data, prediction)
    best, *_ = np.linalg.lstsq(rows[data.used], residual[data.used], rcond=None)
    np.testing.assert_allclose(found.step(), best[: len(KEYS)], rtol=1e-9)
    left = residual[data.used] - rows[data.used] @ best
    assert found.at(found.step()) == pytest.approx(left @ left, rel=1e-9)


def test_held_out_values_take_the_offset_of_their_points_other_frames(
    scene: tuple[Data, Prediction],
) -> None:
    data, prediction = scene
    rows, residual = with_columns(data, prediction)
    expected = 0.0
    for fold in range(FOLDS):
        held = data.used & data.blocks.held(fold)[..., None]
        kept = data.used & ~held
        # a point that was not seen in the kept frames has no offset: least norm
        best, *_ = np.linalg.lstsq(rows[kept], residual[kept], rcond=None)
        expected += float(((residual[held] - rows[held] @ best) ** 2).sum())
    found = normal_equations([data], [prediction], (*KEYS, OFFSETS))
    left = sum(h.at(k.step()) for h, k in zip(found.held, found.kept, strict=True))
    assert left == pytest.approx(expected, rel=1e-9)
    # a fit that stands elsewhere moves by what leaving the fold out changes alone
    steps = [k.step() - found.whole.step() for k in found.kept]
    stays = sum(h.at(s) for h, s in zip(found.held, steps, strict=True))
    assert found.held_out() == pytest.approx(stays, rel=1e-9)


def test_without_offsets_folds_add_up(scene: tuple[Data, Prediction]) -> None:
    data, prediction = scene
    found = normal_equations([data], [prediction], KEYS)
    whole = sum(q.matrix for q in found.held)
    np.testing.assert_allclose(found.whole.matrix, whole, rtol=1e-12)
    for kept, held in zip(found.kept, found.held, strict=True):
        np.testing.assert_allclose(kept.matrix + held.matrix, whole, rtol=1e-12)
    assert found.noise == data.used.sum()
