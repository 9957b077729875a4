"""A test that is mirrored or turned round has the same diagnosis, mirrored or turned round."""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.gap.diagnose import diagnose
from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.specimen import Specimen

SIGMA = np.array([0.006, 0.006, 0.012])
TRUTH = {"axis_misalignment.angle": 3.0, "registration.x0": 1.0, "registration.y0": -0.5}
CANDIDATES = ("axis_misalignment", "registration", "frame_misalignment", "pressure_offset")
#: What else changes its sign, for an image with these signs of x and y.
IMAGES = {
    "mirrored at x = 0": (-1.0, 1.0),
    "turned by half a turn": (-1.0, -1.0),
}


@pytest.fixture(scope="module")
def arrays() -> dict[str, np.ndarray]:
    """Two causes, by a mesh that is finer than the diagnosis'; noise."""
    side = np.arange(-88.0, 89.0, 11.0)
    x, y = (g.ravel() for g in np.meshgrid(side, side))
    inside = np.hypot(x, y) < 94.0
    points = np.column_stack([x[inside], y[inside], np.zeros(inside.sum())])
    pressure = np.linspace(0.02, 0.25, 5)
    blank = BulgeTest.from_arrays(points, np.zeros((5, len(points), 3)), pressure)
    moduli = {"E1": 340.0, "E2": 210.0, "G12": 20.0}
    truth = Specimen(blank, refine=8).predict({**moduli, **TRUTH}).displacement
    rng = np.random.default_rng(3)
    noise, rest = (rng.normal(size=(n, len(points), 3)) * SIGMA for n in (5, 4))
    return {"points": points, "seen": truth + noise, "rest": rest, "pressure": pressure}


def diagnosed(arrays: dict[str, np.ndarray], x: float, y: float) -> Diagnosis:
    """Of the image with these signs of x and y."""
    signs = np.array([x, y, 1.0])
    test = BulgeTest.from_arrays(
        arrays["points"] * signs, arrays["seen"] * signs, arrays["pressure"], name="made",
        static_displacement=arrays["rest"] * signs,
    )  # fmt: skip
    return diagnose(test, effects=CANDIDATES)


@pytest.fixture(scope="module")
def given(arrays: dict[str, np.ndarray]) -> Diagnosis:
    return diagnosed(arrays, 1.0, 1.0)


@pytest.mark.parametrize("image", IMAGES)
def test_the_image_has_the_same_diagnosis(
    arrays: dict[str, np.ndarray], given: Diagnosis, image: str
) -> None:
    x, y = IMAGES[image]
    found = diagnosed(arrays, x, y)
    signs = {"angle": x * y, "x0": x, "y0": y}
    assert found.verdict == given.verdict == "named"
    assert {cause.effect for cause in found.causes} == {"axis_misalignment", "registration"}
    before = {cause.effect: cause for cause in given.causes}
    for cause in found.causes:
        # descents end where a step would change -2 ln Z by 0.05; of odds that is half as much
        share = before[cause.effect].probability
        moved = 0.5 * 0.05 * share * (1.0 - share)
        assert cause.probability == pytest.approx(share, abs=moved + 1e-6)
        for name, value in cause.parameters.items():
            own = before[cause.effect].parameters[name]
            # a hundredth of a standard error: where a search stops is a matter of rounding
            same = pytest.approx(signs[name] * own["value"], abs=0.01 * own["stderr"])
            assert value["value"] == same
    one, other = (each.to_dict()["parameters"]["corrected"] for each in (found, given))
    for name in ("E1", "E2", "G12"):
        same = pytest.approx(other[name]["value"], abs=0.01 * other[name]["stderr"])
        assert one[name]["value"] == same
