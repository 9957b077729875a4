"""The objectives: sums that can be checked by hand, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import InputError
from bulgefit.fitting import objective as module
from bulgefit.fitting.evaluate import cross_table, evaluate, evaluate_resting
from bulgefit.fitting.objective import OBJECTIVES, Objective, displacement_weight
from bulgefit.fitting.problem import Problem
from bulgefit.model.parameters import Material, material
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup

NAN = np.nan
REFERENCE = [[0.0, 1.0, 0.0], [30.0, 0.0, 0.0], [0.0, -40.0, 0.0]]
# two frames of three points; a resting model misses them by these numbers themselves
DISPLACEMENT = [
    [[0.1, -0.2, 3.0], [0.3, NAN, 1.0], [-0.5, 0.4, NAN]],
    [[0.2, -0.2, 6.0], [0.6, 0.8, 4.0], [NAN, NAN, NAN]],
]


def small(displacement: object = DISPLACEMENT, name: str = "small") -> BulgeTest:
    return BulgeTest.from_arrays(REFERENCE, displacement, [0.1, 0.2], name=name)


COARSE = Setup(refine=1)


def value_of(target: Objective, at: Material) -> float:
    """The objective of a material."""
    return target.value(target.shapes([at.constants()] * len(target.tests)))


def slope_of(target: Objective, at: Material) -> tuple[float, np.ndarray]:
    """The objective of a material, and its derivative by E1, E2, G12, nu12."""
    names = [tuple(at.constants())] * len(target.tests)
    shapes = target.shapes([at.constants()] * len(target.tests), names)
    return target.slope(shapes, names, [np.eye(4)] * len(target.tests))


def test_paper_average_by_hand() -> None:
    found = evaluate_resting(small(), weight=0.1, setup=COARSE)
    (parts,) = found["tests"]
    assert parts["dx"] == pytest.approx((0.1 + 0.3 + 0.5 + 0.2 + 0.6) / 5)
    assert parts["dy"] == pytest.approx((0.2 + 0.4 + 0.2 + 0.8) / 4)
    assert parts["dz"] == pytest.approx((3 + 1 + 6 + 4) / 4)
    assert found["e"] == pytest.approx(0.34 + 0.4 + 3.5)
    assert found["e_w"] == pytest.approx(0.34 + 0.4 + 0.1 * 3.5)
    assert found["e_z"] == pytest.approx((3 + 6) / 2)


def test_code_average_weighs_every_frame_alike() -> None:
    found = evaluate_resting(small(), weight=0.1, average="frames", setup=COARSE)
    (parts,) = found["tests"]
    assert parts["dx"] == pytest.approx(0.5 * ((0.1 + 0.3 + 0.5) / 3 + (0.2 + 0.6) / 2))
    assert parts["dy"] == pytest.approx(0.5 * ((0.2 + 0.4) / 2 + (0.2 + 0.8) / 2))
    assert parts["dz"] == pytest.approx(0.5 * ((3 + 1) / 2 + (6 + 4) / 2))


def test_averages_agree_where_every_point_was_seen() -> None:
    whole = small(np.nan_to_num(np.array(DISPLACEMENT), nan=0.7))
    paper, code = (
        evaluate_resting(whole, average=average, setup=COARSE) for average in ("points", "frames")
    )
    for key in OBJECTIVES:
        assert paper[key] == pytest.approx(code[key], rel=1e-14)


def test_several_tests_are_averaged_test_by_test() -> None:
    other = small(2 * np.array(DISPLACEMENT)[:, ::-1], "other")
    both = evaluate_resting([small(), other], weight=0.1, setup=COARSE)
    alone = [evaluate_resting(t, weight=0.1, setup=COARSE) for t in (small(), other)]
    for key in OBJECTIVES:
        assert both[key] == pytest.approx(np.mean([a[key] for a in alone]))


def test_weight_from_the_largest_displacements_of_all_tests() -> None:
    assert displacement_weight([small()]) == pytest.approx(0.5 * (0.6 + 0.8) / 6)
    larger = small(3 * np.array(DISPLACEMENT))
    assert displacement_weight([small(), larger]) == pytest.approx(0.5 * (1.8 + 2.4) / 18)
    assert Objective([small()], setup=COARSE).weight == pytest.approx(0.7 / 6)


def test_weight_without_dz_or_without_dx_and_dy_is_one() -> None:
    flat = np.array(DISPLACEMENT)
    flat[..., 2] = NAN
    assert displacement_weight([small(flat)]) == 1.0
    alone = np.array(DISPLACEMENT)
    alone[..., :2] = NAN
    assert displacement_weight([small(alone)]) == 1.0


def test_three_weights_one_for_each_component() -> None:
    found = evaluate_resting(small(), weight=[2.0, 0.0, 0.5], setup=COARSE)
    assert found["e_w"] == pytest.approx(2 * 0.34 + 0.5 * 3.5)


@pytest.mark.parametrize("weight", [-1.0, [1.0, 2.0], NAN, [1, 1, -0.1]])
def test_weights_that_cannot_be(weight: object) -> None:
    with pytest.raises(InputError, match="weight: give one number of dz, or three"):
        Objective([small()], setup=COARSE, weight=weight)  # type: ignore[arg-type]


def test_e_z_takes_the_point_nearest_the_centre_that_was_seen() -> None:
    moved = np.array(DISPLACEMENT)
    moved[0, 0, 2] = NAN  # the next one, at 30 mm, stands in for this frame
    found = evaluate_resting(small(moved), setup=COARSE)
    assert found["e_z"] == pytest.approx((1.0 + 6.0) / 2)
    looks = Objective([small(moved)], "e_z", COARSE).looks(None)
    assert {tuple(look.position[0]): look.frames.tolist() for look in looks} == {
        (0.0, 1.0): [1],
        (30.0, 0.0): [0],
    }


def test_points_of_a_group_are_looked_at_one_after_another() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-60.0, 60.0, (9000, 2)), np.zeros(9000)])
    test = BulgeTest.from_arrays(points, rng.normal(size=(1, 9000, 3)), [0.1])

    def side(_: int, position: np.ndarray) -> np.ndarray:
        return (position[:, 0] > 10.0).astype(np.intp)

    target = Objective([test], "e", COARSE)
    plain, grouped = (list(target.looks(None, group=group)) for group in (None, side))
    sides = np.concatenate([side(0, look.position) for look in grouped])
    assert 0 < sides.sum() < len(sides) == 9000
    assert (np.diff(sides) >= 0).all()
    totals = [
        sum(float((look.scale * np.abs(look.residual).sum(axis=1)).sum()) for look in looks)
        for looks in (plain, grouped)
    ]
    assert totals[0] == pytest.approx(totals[1], rel=1e-12)


def test_without_dz_there_is_no_e_z() -> None:
    flat = np.array(DISPLACEMENT)
    flat[..., 2] = NAN
    found = evaluate_resting(small(flat), setup=COARSE)
    assert found["e_z"] is None
    assert found["tests"][0]["dz"] is None
    assert found["e"] == pytest.approx(0.34 + 0.4)
    with pytest.raises(InputError, match="nothing was measured that e_z compares"):
        Objective([small(flat)], "e_z", COARSE)


def test_frames_with_points_of_their_own_count_the_same() -> None:
    frames = []
    for frame in np.array(DISPLACEMENT):
        seen = np.isfinite(frame).any(axis=1)
        frames.append((np.array(REFERENCE)[seen], frame[seen]))
    # the same points, told as clouds that share none of them
    shifted = [(at + np.array([0, 0, 1e-3 * i]), d) for i, (at, d) in enumerate(frames)]
    ragged = BulgeTest.from_frames(shifted, [0.1, 0.2], name="ragged")
    assert len(ragged.blocks) == 2
    for average in ("points", "frames"):
        one = evaluate_resting(small(), weight=0.1, average=average, setup=COARSE)
        two = evaluate_resting(ragged, weight=0.1, average=average, setup=COARSE)
        for key in OBJECTIVES:
            assert two[key] == pytest.approx(one[key], rel=1e-13)


def test_single_precision_gives_the_same_sums(make: Callable[..., BulgeTest], setup: Setup) -> None:
    test = make(noise=0.05, frames=8)
    block = test.blocks[0]
    single = BulgeTest.from_arrays(
        block.reference, block.displacement.astype(np.float32), test.pressure
    )
    at = material("orthotropic", E1=300, E2=200, G12=25, nu12=0.24)
    for key in OBJECTIVES:
        assert evaluate(single, at, weight=0.1, setup=setup)[key] == pytest.approx(
            evaluate(test, at, weight=0.1, setup=setup)[key], rel=1e-6
        )


def test_the_truth_has_no_deviation(make: Callable[..., BulgeTest], setup: Setup) -> None:
    truth = material("orthotropic", E1=330, E2=240, G12=30, nu12=0.24)
    found = evaluate(make(), truth, setup=setup)
    assert found["e"] < 3e-4  # the tolerance of the dense output


def test_ratios_that_differ_are_asked_for(make: Callable[..., BulgeTest], setup: Setup) -> None:
    tests = [make(name="a"), make(name="b", noise=1e-9, poisson_ratio=0.4)]
    moduli = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
    for given in (moduli, {"E": 250.0}):
        with pytest.raises(InputError, match=r"different Poisson ratios \(0\.24, 0\.4\)"):
            evaluate(tests, given, setup=setup)
    told = evaluate(tests, {**moduli, "nu12": 0.24}, setup=setup)
    assert told["parameters"]["nu12"] == 0.24
    assert evaluate(tests, {"E": 250.0, "nu": 0.3}, setup=setup)["parameters"]["nu"] == 0.3
    assert evaluate(tests, {"E": 250.0, "G": 100.0}, setup=setup)["parameters"]["G"] == 100.0
    assert evaluate(tests[1], moduli, setup=setup)["parameters"]["nu12"] == 0.4


def test_rest_costs_what_was_measured(make: Callable[..., BulgeTest], setup: Setup) -> None:
    test = make()
    measured = np.abs(test.blocks[0].displacement).mean(axis=(0, 1))
    assert evaluate_resting(test, setup=setup)["e"] == pytest.approx(measured.sum())


def test_cross_table(make: Callable[..., BulgeTest], setup: Setup) -> None:
    test = make()
    at = {
        "truth": material("orthotropic", E1=330, E2=240, G12=30, nu12=0.24),
        "soft": material("orthotropic", E1=200, E2=200, G12=20, nu12=0.24),
    }
    table = cross_table(test, at, weight=0.1, setup=setup)
    assert list(table) == ["truth", "soft", "undeformed"]
    for key in OBJECTIVES:
        assert table["truth"][key] < table["soft"][key] < table["undeformed"][key]
        assert table["soft"][key] == pytest.approx(
            evaluate(test, at["soft"], weight=0.1, setup=setup)[key]
        )


@pytest.mark.parametrize("evaluation", ["smooth", "rbf"])
@pytest.mark.parametrize("average", ["points", "frames"])
@pytest.mark.parametrize("name", [*OBJECTIVES, "likelihood"])
def test_gradient_by_differences(
    name: str, average: str, evaluation: str, make: Callable[..., BulgeTest]
) -> None:
    setup = Setup(refine=2, tolerance=1e-6, evaluation=evaluation, correct_mesh=False)
    target = Objective([make(frames=4)], name, setup, average=average, weight=0.1)
    at = {"E1": 250.0, "E2": 200.0, "G12": 20.0, "nu12": 0.3}
    value, slope = slope_of(target, material("orthotropic", **at))
    # a path with derivatives has levels of its own: both are right to the path's tolerance
    assert value == pytest.approx(value_of(target, material("orthotropic", **at)), rel=1e-5)
    for j, (key, centre) in enumerate(at.items()):
        h = 1e-4 * centre  # few residuals change their sign on the way
        high = value_of(target, material("orthotropic", **at | {key: centre + h}))
        low = value_of(target, material("orthotropic", **at | {key: centre - h}))
        assert slope[j] * centre == pytest.approx((high - low) / 2e-4, rel=1e-3, abs=1e-4 * value)


def test_gradient_through_the_studys_levels(make: Callable[..., BulgeTest]) -> None:
    setup = Setup(refine=2, tolerance=1e-5, interpolation="study")
    problem = Problem(Objective([make(frames=4)], "e", setup))
    z = np.array([0.6, 0.7, 0.9])
    slope = problem.evaluate(z, derivatives=True).slope
    assert slope is not None
    for j in range(3):
        step = 1e-4 * np.eye(3)[j]
        difference = problem.evaluate(z + step).value - problem.evaluate(z - step).value
        assert slope[j] == pytest.approx(difference / 2e-4, rel=2e-3)


def test_the_likelihood_by_hand(make: Callable[..., BulgeTest], setup: Setup) -> None:
    """½ Σ (r/σ)² / v with the noise that the test shows of itself."""
    test = make(noise=0.05, points=200, frames=8)
    target = Objective([test], "likelihood", setup)
    (noise,) = target.noise()
    assert noise is not None
    truth = material("orthotropic", E1=330, E2=240, G12=30, nu12=0.24)
    modelled = predict(test, truth, setup=setup).displacement
    left = (test.blocks[0].displacement - modelled) / noise.sigma
    assert value_of(target, truth) == pytest.approx(0.5 * (left**2).sum() / noise.inflation)
    assert (target.squared, target.unit) == (True, "1")
    with pytest.raises(InputError, match="too little was measured to tell its noise"):
        Objective([small()], "likelihood", COARSE)


@pytest.mark.parametrize("name", ["e_w", "likelihood"])
def test_rows_are_the_objective_and_its_slope(
    name: str, make: Callable[..., BulgeTest], setup: Setup
) -> None:
    tests = [make(noise=0.05, name="a"), make(noise=0.05, seed=1, frames=7, name="b")]
    problem = Problem(Objective(tests, name, setup))
    z = np.array([0.5, 0.5, 0.9])
    at = problem.evaluate(z, derivatives=True)
    assert at.rows is not None
    assert at.rows.whole
    whole = problem.on_all_data().evaluate(z, derivatives=True)
    assert whole.value == pytest.approx(at.value, rel=1e-12)
    assert problem.objective.value(problem.shapes(z, derivatives=True)) == pytest.approx(at.value)
    assert at.rows.value(np.zeros(3)) == pytest.approx(at.value, rel=1e-12)
    np.testing.assert_allclose(at.rows.slope(), at.slope, rtol=1e-9)
    hessian, gradient = at.rows.normal(np.zeros(3), 1e-12)
    np.testing.assert_allclose(gradient, at.slope, rtol=1e-9)
    assert np.linalg.eigvalsh(hessian).min() > 0


def test_a_sample_stands_for_all_points(
    make: Callable[..., BulgeTest], setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SAMPLE", 3_000)
    problem = Problem(Objective([make(noise=0.05, points=2_000)], "e", setup))
    z = np.array([0.5, 0.5, 0.9])
    at, whole = (p.evaluate(z, derivatives=True) for p in (problem, problem.on_all_data()))
    assert at.rows is not None
    assert whole.slope is not None
    assert not at.rows.whole
    assert len(at.rows.residual) == 3_000
    # a mean of 3,000 of 30,000 values that differ by as much as they are large
    assert at.value == pytest.approx(whole.value, rel=3 / np.sqrt(3_000))
    spread = 3 * np.abs(whole.slope).max() / np.sqrt(3_000)
    np.testing.assert_allclose(at.slope, whole.slope, rtol=0.0, atol=spread)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"name": "e_x"}, "objective: 'e_x' is unknown; choose from e, e_w, e_z, likelihood"),
        ({"average": "median"}, "average: 'median' is unknown; choose from points, frames"),
    ],
)
def test_unknown_names(arguments: dict[str, str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Objective([small()], setup=COARSE, **arguments)
