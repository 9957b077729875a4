"""What must hold of every objective and fit: order, loss, repetition, units, the truth."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.mend import in_unit
from bulgefit.dic.units import LENGTH, PRESSURE
from bulgefit.errors import InputError
from bulgefit.fitting.evaluate import evaluate, evaluate_resting
from bulgefit.fitting.fit import fit
from bulgefit.fitting.objective import Objective
from bulgefit.fitting.problem import Problem
from bulgefit.model.parameters import material
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup

Floats = NDArray[np.float64]

SETUP = Setup(refine=1, tolerance=1e-8, correct_mesh=False)
NAMES = ("e", "e_w", "e_z")
FRAMES, POINTS = 6, 40

some = settings(max_examples=20, derandomize=True, deadline=None, phases=[Phase.generate])
few = settings(max_examples=5, derandomize=True, deadline=None, phases=[Phase.generate])

seeds = st.integers(0, 2**32 - 1)
truths = st.builds(
    lambda e1, ratio, shear: {"E1": e1, "E2": e1 * ratio, "G12": e1 * shear, "nu12": 0.24},
    st.floats(150.0, 800.0),
    st.floats(0.5, 2.0),
    st.floats(0.1, 0.3),
)


def places() -> Floats:
    r, phi = 92 * np.sqrt((np.arange(POINTS) + 0.5) / POINTS), 2.4 * np.arange(POINTS)
    return np.column_stack([r * np.cos(phi), r * np.sin(phi), np.zeros(POINTS)])


def drawn(seed: int) -> BulgeTest:
    """Displacements of no membrane, a tenth of them lost."""
    rng = np.random.default_rng(seed)
    seen = rng.normal(0, 2, (FRAMES, POINTS, 3))
    seen[rng.random(seen.shape) < 0.1] = np.nan
    return BulgeTest.from_arrays(places(), seen, np.linspace(0.02, 0.2, FRAMES), name="drawn")


def changed(test: BulgeTest, points: object = None, frames: object = None) -> BulgeTest:
    """The test with its points and frames in another order, left out or repeated."""
    at = np.arange(test.n_points) if points is None else np.asarray(points)
    when = np.arange(test.n_frames) if frames is None else np.asarray(frames)
    block = test.blocks[0]
    return BulgeTest.from_arrays(
        block.reference[at], block.displacement[when][:, at], test.pressure[when], name="changed"
    )


@some
@given(seed=seeds)
def test_order_does_not_matter(seed: int) -> None:
    test, rng = drawn(seed), np.random.default_rng(seed)
    other = changed(test, rng.permutation(POINTS), rng.permutation(FRAMES))
    for average in ("points", "frames"):
        one, two = (
            evaluate_resting(t, weight=0.1, average=average, setup=SETUP) for t in (test, other)
        )
        assert [two[name] for name in NAMES] == pytest.approx([one[name] for name in NAMES], 1e-13)


@few
@given(seed=seeds, truth=truths)
def test_order_does_not_matter_beside_a_model(seed: int, truth: dict[str, float]) -> None:
    test, rng = drawn(seed), np.random.default_rng(seed)
    other = changed(test, rng.permutation(POINTS), rng.permutation(FRAMES))
    at = material("orthotropic", **truth)
    one, two = (evaluate(t, at, weight=0.1, setup=SETUP) for t in (test, other))
    assert [two[name] for name in NAMES] == pytest.approx([one[name] for name in NAMES], 1e-9)


@some
@given(seed=seeds)
def test_what_was_lost_counts_nothing(seed: int) -> None:
    """Each component is the mean of what was measured of it, wherever that was."""
    test = drawn(seed)
    found = evaluate_resting(test, weight=0.1, setup=SETUP)
    mean = np.nanmean(np.abs(test.blocks[0].displacement), axis=(0, 1))
    assert found["e"] == pytest.approx(mean.sum(), 1e-13)
    assert found["e_w"] == pytest.approx(mean @ [1.0, 1.0, 0.1], 1e-13)
    nothing = np.full((FRAMES, 5, 3), np.nan)
    block = test.blocks[0]
    more = BulgeTest.from_arrays(
        np.concatenate([block.reference, 0.5 * places()[:5]]),
        np.concatenate([block.displacement, nothing], axis=1),
        test.pressure,
    )
    again = evaluate_resting(more, weight=0.1, setup=SETUP)
    assert [again[name] for name in NAMES] == [found[name] for name in NAMES]


@some
@given(seed=seeds)
def test_repetition_counts_nothing(seed: int) -> None:
    """Every point twice: means stay. One test given twice is refused."""
    test = drawn(seed)
    found = evaluate_resting(test, weight=0.1, setup=SETUP)
    twice = changed(test, np.tile(np.arange(POINTS), 2))
    again = evaluate_resting(twice, weight=0.1, setup=SETUP)
    values = [again[name] for name in NAMES]
    assert values == pytest.approx([found[name] for name in NAMES], 1e-13)
    with pytest.raises(InputError, match="hold the same data"):
        evaluate_resting([test, test], weight=0.1, setup=SETUP)


@some
@given(seed=seeds, by=st.floats(0.01, 10.0), sign=st.sampled_from([-1.0, 1.0]))
def test_objectives_are_norms(seed: int, by: float, sign: float) -> None:
    """They grow with what is missed, whatever its sign, and obey the triangle inequality."""
    test, other = drawn(seed), drawn(seed + 1)
    block = test.blocks[0]
    filled = [np.nan_to_num(t.blocks[0].displacement, nan=0.3) for t in (test, other)]

    def values(seen: Floats) -> Floats:
        made = BulgeTest.from_arrays(block.reference, seen, test.pressure)
        found = evaluate_resting(made, weight=0.1, setup=SETUP)
        return np.array([found[name] for name in NAMES])

    one, two = (values(seen) for seen in filled)
    np.testing.assert_allclose(values(sign * by * filled[0]), by * one, rtol=1e-12)
    assert (values(filled[0] + filled[1]) <= (one + two) * (1 + 1e-12)).all()


@some
@given(
    seed=seeds,
    unit=st.sampled_from(sorted(PRESSURE)),
    taken=st.sampled_from(sorted(PRESSURE)),
    length=st.sampled_from(sorted(LENGTH)),
)
def test_units_there_and_back(seed: int, unit: str, taken: str, length: str) -> None:
    """Numbers in one unit that were taken for another are mended to what they were."""
    test = drawn(seed)
    wrong = dataclasses.replace(test, pressure=test.pressure * PRESSURE[taken] / PRESSURE[unit])
    mended = in_unit(wrong, "pressure", unit, taken)
    np.testing.assert_allclose(mended.pressure, test.pressure, rtol=1e-14)
    block = test.blocks[0]
    shrunk = dataclasses.replace(block, displacement=block.displacement / LENGTH[length])
    mended = in_unit(dataclasses.replace(test, blocks=(shrunk,)), "displacement", length, "mm")
    np.testing.assert_allclose(mended.blocks[0].displacement, block.displacement, rtol=1e-14)


def made(truth: dict[str, float]) -> BulgeTest:
    """What the model itself predicts."""
    pressure = np.linspace(5e-5, 4e-4, FRAMES) * truth["E1"]
    empty = BulgeTest.from_arrays(places(), np.zeros((FRAMES, POINTS, 3)), pressure)
    seen = predict(empty, material("orthotropic", **truth), setup=SETUP).displacement
    return BulgeTest.from_arrays(places(), seen, pressure, name="made")


@few
@given(truth=truths)
def test_without_noise_the_truth_comes_back(truth: dict[str, float]) -> None:
    bounds = {name: (truth[name] / 2, truth[name] * 2) for name in ("E1", "E2", "G12")}
    result = fit(made(truth), starts=1, bounds=bounds, setup=SETUP)
    for name in bounds:
        assert result.material.values[name] == pytest.approx(truth[name], rel=1e-6)


@few
@given(truth=truths, z=st.tuples(*[st.floats(0.3, 0.7)] * 3), name=st.sampled_from(["e", "e_w"]))
def test_gradients_are_differences(
    truth: dict[str, float], z: tuple[float, float, float], name: str
) -> None:
    bounds = {key: (truth[key] / 3, truth[key] * 3) for key in ("E1", "E2", "G12")}
    problem = Problem(Objective([made(truth)], name, SETUP, weight=0.1), bounds=bounds)
    at = np.array(z)
    slope = problem.evaluate(at, derivatives=True).slope
    assert slope is not None
    scale = np.abs(slope).max()
    for j, step in enumerate(1e-5 * np.eye(3)):
        change = problem.evaluate(at + step).value - problem.evaluate(at - step).value
        # absolute deviations bend where one changes its sign within the step
        assert change / 2e-5 == pytest.approx(slope[j], rel=1e-3, abs=2e-3 * scale)
