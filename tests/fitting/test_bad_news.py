"""What is said first of bad tests and bad fits: word by word, in the report and by `info`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bulgefit.dic import read_test
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.inspect import describe
from bulgefit.fem.mesh import disc
from bulgefit.fitting.fit import fit
from bulgefit.model.predict import predict
from bulgefit.model.setup import Setup
from bulgefit.model.simulation import simulate

#: A coarse mesh, which every bad test is far beyond.
QUICK = Setup(refine=2, correct_mesh=False)

Arrays = dict[str, np.ndarray]
EXAMPLE = Path(__file__).parents[2] / "data" / "example_bulge.npz"


@pytest.fixture(scope="module")
def good() -> BulgeTest:
    """A part of the shipped example, in which nothing is wrong."""
    test = read_test(EXAMPLE)
    some = np.random.default_rng(0).permutation(test.n_points) < 500
    return replace(test, static_displacement=None).select(frames=slice(0, None, 2), points=some)


def spoilt(good: BulgeTest, spoil: Callable[[Arrays], None]) -> BulgeTest:
    block = good.blocks[0]
    arrays = {
        "reference": block.reference.copy(),
        "displacement": block.displacement.astype(np.float64),
        "pressure": good.pressure.copy(),
    }
    spoil(arrays)
    return BulgeTest.from_arrays(
        **arrays,
        name="bad",
        radius=good.radius,
        thickness=good.thickness,
        poisson_ratio=good.poisson_ratio,
    )


def half_corrupt(arrays: Arrays) -> None:
    rng = np.random.default_rng(0)
    seen = arrays["displacement"]
    lost = rng.random(seen.shape[:2]) < 0.5
    seen[lost] = rng.uniform(-20.0, 20.0, (lost.sum(), 3))


def noise_only(arrays: Arrays) -> None:
    arrays["displacement"] = np.random.default_rng(0).normal(0, 0.03, arrays["displacement"].shape)


def turned(arrays: Arrays) -> None:
    """The specimen was cut by 90 degrees, or x and y were exchanged everywhere."""
    for name in ("reference", "displacement"):
        arrays[name] = arrays[name][..., [1, 0, 2]] * [-1, 1, 1]


def psi_as_bar(arrays: Arrays) -> None:
    arrays["pressure"] *= 14.5


def lengths_in_cm(arrays: Arrays) -> None:
    arrays["displacement"] *= 0.1


def hole(arrays: Arrays) -> None:
    near = np.hypot(*arrays["reference"][:, :2].T) < 40
    arrays["displacement"][:, near] = np.nan


def positions(arrays: Arrays) -> None:
    arrays["displacement"] += arrays["reference"]


def gauge_stuck(arrays: Arrays) -> None:
    arrays["pressure"][-3:] = arrays["pressure"][-3]


#: What is wrong, what is said of the test, and the code of what is said of its fit beside that.
BAD: dict[str, tuple[Callable[[Arrays], None], str, str | None]] = {
    "half the data corrupt": (
        half_corrupt,
        "the heights lie on no surface in 4 of 4 frames under half the highest pressure "
        "or more: the best quadratic one leaves 60% of their mean square, as noise alone "
        "does, or points whose correlation was lost; correlate again with an image at "
        "rest, leave out the frames and points that lost the pattern, and look at dz with"
        " bulgefit show",
        "explains_little",
    ),
    "noise only": (
        noise_only,
        "the heights lie on no surface in 4 of 4 frames under half the highest pressure "
        "or more: the best quadratic one leaves 99% of their mean square, as noise alone "
        "does, or points whose correlation was lost; correlate again with an image at "
        "rest, leave out the frames and points that lost the pattern, and look at dz with"
        " bulgefit show",
        "worse_than_undeformed",
    ),
    "axes by 90 degrees": (
        turned,
        "the in-plane motion is 1.04 of an evenly strained cap's along x and 0.99 along "
        "y, so that E2 will come out above E1; the data cannot tell whether warp and fill"
        " were swapped in all arrays; if the warp lies along y: bulgefit convert IN OUT "
        "--swap-xy",
        None,
    ),
    "psi taken for bar": (
        psi_as_bar,
        "highest pressure is 36.2 bar, where fabrics are tested at 0.02 to 10: are the "
        "pressures in the unit that the file says or asks for?; if they are in another "
        "one: bulgefit convert IN OUT --unit pressure=UNIT/TAKEN, such as psi/bar or "
        "MPa/bar",
        None,
    ),
    "displacement in cm": (
        lengths_in_cm,
        "a rise of 3.69 mm at 2.5 bar asks for E t of about 1.4e+05 N/mm, which no fabric"
        " has (5 to 5,000): pressures, displacement or radius are in another unit; "
        "bulgefit convert IN OUT --unit pressure=UNIT/TAKEN, such as psi/bar or MPa/bar; "
        "likewise displacement=cm/mm; the radius is given with --radius",
        "at_bound",
    ),
    "a hole at the apex": (
        hole,
        "no height was measured within 40.7 mm of the centre in 8 of 8 frames: how high "
        "the specimen rises there is not known; correlate again where points are missing;"
        " --objective e_z would fit the nearest point that was measured",
        None,
    ),
    "positions as displacements": (
        positions,
        "dy changes by 1.00 mm per mm of y over the disc, where a clamp lets it change by"
        " 0: displacement holds deformed positions; bulgefit convert IN OUT "
        "--from-positions takes the reference off",
        "explains_little",
    ),
    "a gauge that is stuck": (
        gauge_stuck,
        "the pressure stays at 1.814 bar from frame 5 to 7 while the centre rises by 4.6 "
        "mm: the gauge kept its last value, or the pressure was held and the cloth crept;"
        " give these frames the pressures of another gauge, or leave them out; if the "
        "pressure was held, give their times, and bulgefit diagnose frees creep",
        None,
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_first_line_of_a_bad_test(case: str, good: BulgeTest) -> None:
    spoil, said, code = BAD[case]
    test = spoilt(good, spoil)
    warned = describe(test).warnings[0]
    assert f"{warned.text}; {warned.remedy}" == said
    result = fit(test, starts=1, setup=QUICK)
    assert result.report().splitlines()[0] == f"WARNING: bad: {said}"
    assert code is None or code in [w.code for w in result.quality.warnings]


def test_some_corrupt_frames_do_not_make_a_bad_test(good: BulgeTest) -> None:
    """Fewer than half are for the objective, which is robust."""

    def one_frame(arrays: Arrays) -> None:
        noise = np.random.default_rng(0).uniform(-20, 20, arrays["displacement"][-2].shape)
        arrays["displacement"][-2] = noise

    said = {w.code: w.text for w in describe(spoilt(good, one_frame)).warnings}
    assert "no_surface" not in said
    assert said["rough_frames"].startswith(
        "the heights lie on no surface in 1 of 4 frames under half the highest pressure or more: "
        "in frame 6"
    )


def test_a_held_pressure_at_which_nothing_rises_is_no_stuck_gauge(good: BulgeTest) -> None:
    def held(arrays: Arrays) -> None:
        arrays["pressure"][-2:] = arrays["pressure"][-1]
        noise = np.random.default_rng(0).normal(0, 0.01, arrays["displacement"][-1].shape)
        arrays["displacement"][-2] = arrays["displacement"][-1] + noise

    codes = [w.code for w in describe(spoilt(good, held)).warnings]
    assert codes == ["pressure_not_increasing"]


def test_a_hole_is_no_apex_that_falls(good: BulgeTest) -> None:
    """The next point at which a height is known lies lower than the one that was lost."""

    def late(arrays: Arrays) -> None:
        near = np.hypot(*arrays["reference"][:, :2].T) < 60
        arrays["displacement"][-3:, near] = np.nan

    test = spoilt(good, late)
    assert (np.diff(test.apex_displacement) < -1.0).any()
    codes = [w.code for w in describe(test).warnings]
    assert codes == ["lost_points", "apex_hole"]


def test_nothing_is_said_of_a_good_test(good: BulgeTest) -> None:
    assert describe(good).warnings == ()
    result = fit(good, starts=1)
    assert result.quality.warnings == []
    assert result.report().startswith("misfit ")


def test_what_is_no_noise_is_said_to_be_in_the_parameters(good: BulgeTest) -> None:
    """As where the cameras see a face of the cloth and the model does not know."""
    seen = predict(
        good, {"E1": 330.0, "E2": 240.0, "G12": 30.0}, effects={"surface_offset.share": 0.5}
    ).as_test()
    noise = np.random.default_rng(5).normal(0.0, 0.005, seen.blocks[0].displacement.shape)

    def noisy(arrays: Arrays) -> None:
        arrays["displacement"] = np.asarray(seen.blocks[0].displacement) + noise

    test = spoilt(good, noisy)
    (said,) = fit(test, starts=1, bounds={"G12": (10.0, 400.0)}).quality.warnings
    assert said.code == "model_lacks"
    assert "bulgefit diagnose looks for it" in said.text
    assert fit(test, starts=1, effects=("surface_offset",)).quality.warnings == []


@pytest.mark.parametrize("frames", [1, 5])
def test_a_flat_objective(frames: int) -> None:
    """One height at one pressure, however often: any modulus can make up for the others."""
    mesh, pressure = disc(100.0, 2), np.full(frames, 0.2)
    made = simulate({"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24}, [0.2], mesh=mesh)
    apex = np.hypot(*mesh.nodes.T).argmin()
    points = np.append(mesh.nodes[apex], 0.0)[None]
    seen = made.displacement[:, [apex]] + np.random.default_rng(0).normal(0, 0.01, (frames, 1, 3))
    test = BulgeTest.from_arrays(points, seen, pressure, name="flat")
    bounds = {"E1": (200.0, 500.0), "E2": (150.0, 400.0), "G12": (10.0, 60.0)}
    result = fit(test, "e_z", starts=2, bounds=bounds, setup=QUICK)
    assert result.report().splitlines()[:2] == [
        "WARNING: 1 point for 3 parameters: they cannot all be found; fit the fields "
        "(--objective e_w), or fewer parameters",
        "WARNING: E1 and E2 and G12 cannot be found from this test, other values fit as well: "
        "hold what is known, or fit more of what was measured (--objective e_w)",
    ]
    assert set(result.uncertainty.stderr.values()) == {None}


def test_a_bound_that_keeps_the_truth_out(good: BulgeTest) -> None:
    result = fit(good, bounds={"E1": (50.0, 300.0)}, starts=1, setup=QUICK)
    assert result.report().splitlines()[0] == (
        "WARNING: E1 = 300 is the bound of the search, and no result: widen "
        "--bounds E1=50:300, or hold it"
    )


def test_two_optima_of_equal_worth() -> None:
    """Heights on the diagonals are those of the cloth with warp and fill exchanged."""
    mesh, pressure = disc(100.0, 2), np.linspace(0.02, 0.3, 6)
    x, y = np.abs(mesh.nodes.T)
    diagonal = np.isclose(x, y) & (np.hypot(x, y) < 99)
    made = simulate({"E1": 420.0, "E2": 210.0, "G12": 30.0, "nu12": 0.0}, pressure, mesh=mesh)
    heights = np.array(made.displacement[:, diagonal])
    heights[..., :2] = np.nan
    heights[..., 2] += np.random.default_rng(0).normal(0, 0.005, heights.shape[:2])
    points = np.column_stack([mesh.nodes[diagonal], np.zeros(diagonal.sum())])
    test = BulgeTest.from_arrays(points, heights, pressure, name="diagonals", poisson_ratio=0.0)
    bounds = {"E1": (100.0, 700.0), "E2": (100.0, 700.0), "G12": (10.0, 60.0)}
    result = fit(test, "e", starts=6, bounds=bounds, setup=QUICK)
    found = sorted(result.material.values[name] for name in ("E1", "E2"))
    (said,) = [w.text for w in result.quality.warnings if w.code == "other_optimum"]
    low, high = (f"{value:.4g}" for value in found)
    for one, other in ((low, high), (high, low)):
        assert f"E1 = {one}, E2 = {other}, G12 = " in said
    assert "fit as well as" in said
    # half of the starts, but for those that found the other one
    assert result.quality.agreeing < result.quality.starts == 6
    assert found == pytest.approx([210.0, 420.0], rel=0.03)
