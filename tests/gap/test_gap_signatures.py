"""Signatures of effects after the moduli are projected out, against known values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.gap.explanation import Known
from bulgefit.gap.follow_up.separate import cosine_matrix
from bulgefit.gap.normal import normal_equations
from bulgefit.gap.specimen import Specimen

VALUES = {"E1": 330.0, "E2": 200.0, "G12": 12.0}
EFFECTS = [e for e in CATALOGUE.values() if e.id not in ("creep", "reference_state")]


@pytest.fixture(scope="module")
def known(grid: Callable[..., np.ndarray]) -> Known:
    points = grid(6.0, 95.0)
    pressure = np.concatenate([[0.003], np.linspace(0.015, 0.27, 13)])
    test = BulgeTest.from_arrays(points, np.zeros((14, len(points), 3)), pressure)
    specimen = Specimen(test)
    data = Data(specimen, np.array([0.006, 0.006, 0.013]), np.ones((14, len(points), 3), bool))
    names = [n for e in EFFECTS for n in e.groups()[0]]
    keys = (*MODULI, *(Key.of(name) for name in names))
    prediction = specimen.predict(VALUES, [key.name for key in keys])
    return Known(keys, normal_equations([data], [prediction], keys).whole.hessian)


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("poisson_ratio.nu12", 0.015),
        ("pressure_gain.gain", 0.000),
        ("initial_shape.h0", 0.38),
        ("clamp_slip.compliance", 0.52),
        ("clamp_shape.radius_error", 0.56),
        ("pressure_offset.offset", 0.93),
        ("axis_misalignment.angle", 1.00),
    ],
)
def test_norm_left_after_the_moduli(known: Known, key: str, expected: float) -> None:
    assert _norm_of_sum(known, (key,)) == pytest.approx(expected, abs=0.03)


def test_equal_slack_leaves_a_known_norm(known: Known) -> None:
    both = _norm_of_sum(known, ("prestrain.slack_x", "prestrain.slack_y"))
    assert both == pytest.approx(0.68, abs=0.03)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("clamp_shape", "dic_scale", 1.000),
        ("prestrain", "pressure_offset", 0.96),
        ("prestrain", "initial_shape", 0.90),
        ("nonlinear_material", "initial_shape", 0.79),
    ],
)
def test_largest_cosine(known: Known, first: str, second: str, expected: float) -> None:
    names, cosine = cosine_matrix(known)
    found = cosine[names.index(first), names.index(second)]
    assert found == pytest.approx(expected, abs=0.03)


def test_stiffness_gradient_looks_like_a_rotation(known: Known) -> None:
    """Gradient along x against rotation about y, each taken alone."""
    pair = [
        _cosine(known, f"stiffness_gradient.{g}", f"rigid_motion.rotation_{a}")
        for g in ("g_x", "g_y")
        for a in "xyz"
    ]
    assert max(pair) == pytest.approx(0.80, abs=0.03)


def _left(known: Known, keys: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    h = known.hessian
    base = [known.keys.index(m) for m in MODULI]
    index = [known.keys.index(Key.of(k)) for k in keys]
    whole = h[np.ix_(index, index)]
    across = h[np.ix_(base, index)]
    return whole - across.T @ np.linalg.solve(h[np.ix_(base, base)], across), whole


def _norm_of_sum(known: Known, keys: tuple[str, ...]) -> float:
    left, whole = _left(known, keys)
    return float(np.sqrt(left.sum() / whole.sum()))


def _cosine(known: Known, first: str, second: str) -> float:
    left, _ = _left(known, (first, second))
    return float(abs(left[0, 1]) / np.sqrt(left[0, 0] * left[1, 1]))
