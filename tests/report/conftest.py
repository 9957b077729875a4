"""Diagnoses and fits that several modules of this folder draw."""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic import BulgeTest
from bulgefit.fitting.fit import fit
from bulgefit.gap.diagnose import diagnose
from bulgefit.gap.specimen import Specimen
from bulgefit.model.setup import Setup
from bulgefit.trial.answer import TrialAnswer
from bulgefit.trial.score import judge, score

TRUTH = {
    "E1": 330.0,
    "E2": 230.0,
    "G12": 40.0,
    "rigid_motion.rotation_x": 0.2,
    "rigid_motion.shift_x": 0.15,
}
NOISE = (0.006, 0.006, 0.013)
EFFECTS = ["rigid_motion", "stiffness_gradient"]


def made(name, seed, truth=TRUTH):
    """A test of some 340 points and six frames, with two effects or none."""
    axis = np.arange(-90, 91, 9.0)
    x, y = (grid.ravel() for grid in np.meshgrid(axis, axis))
    inside = np.hypot(x, y) < 95
    points = np.column_stack([x[inside], y[inside], np.zeros(inside.sum())])
    pressure = np.array([0.01, 0.05, 0.1, 0.15, 0.2, 0.25])
    blank = BulgeTest.from_arrays(
        points, np.zeros((6, len(points), 3)), pressure, radius=100.0, name=name
    )
    rng = np.random.default_rng(seed)
    seen = Specimen(blank, refine=6).predict(truth).displacement
    seen = seen + rng.normal(0.0, NOISE, seen.shape)
    seen[2:, 10:13] = np.nan
    return BulgeTest.from_arrays(points, seen, pressure, radius=100.0, name=name)


@pytest.fixture(scope="session")
def plate():
    return made("plate 1/a", 1)


@pytest.fixture(scope="session")
def found(plate):
    """The diagnosis of a test with a moved camera."""
    return diagnose(plate, effects=EFFECTS)


@pytest.fixture(scope="session")
def plain():
    """A test that has nothing but its moduli."""
    return made("plain", 4, {name: TRUTH[name] for name in ("E1", "E2", "G12")})


@pytest.fixture(scope="session")
def fit_found(plain):
    """A fit."""
    return fit(plain, setup=Setup(refine=2), starts=2, bounds={"G12": (10.0, 100.0)})


@pytest.fixture(scope="session")
def fitted(fit_found):
    """A fit's JSON."""
    return fit_found.to_dict()


@pytest.fixture(scope="session")
def pair():
    """Two tests of one name, one slack as well."""
    shifted = {**TRUTH, "prestrain.slack_x": 0.002}
    tests = [made("same", 2), made("same", 3, shifted)]
    return diagnose(tests, effects=["rigid_motion", "prestrain"])


@pytest.fixture(scope="session")
def trial_answer():
    """What a trial of two tests with the same cause found, which was named in one of them."""
    records = [
        {
            "file": f"test_{i}.npz", "struck": [],
            "truth": {"kind": "one", "effects": ["clamp_slip"], "signature_mm": 0.1,
                      "signature_left_mm": 0.05},
            "answer": {
                "verdict": verdict, "seconds": 1.0,
                "causes": [{"effect": "clamp_slip", "alternatives": [], "probability": 0.999,
                            "parameters": {}}] if verdict == "named" else [],
            },
        }
        for i, verdict in enumerate(("named", "unknown"))
    ]  # fmt: skip
    for one in records:
        one["truth"] |= {
            "parameters": {"clamp_slip": {}},
            "signatures": {"clamp_slip": {"signature_left_mm": 0.05}},
            "moduli": {"E1": 300.0},
            "noise_mm": [0.006, 0.013],
        }
    return TrialAnswer(
        scores=score(records),
        tests=[judge(one) for one in records],
        meta={"seed": 3, "seals": {"test_0": "ab12"}, "versions": {"bulgefit": "1"}},
    )
