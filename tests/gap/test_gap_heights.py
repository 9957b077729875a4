"""Heights measured before inflation are data: rows, planes they are counted from, offsets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import Key, Owned
from bulgefit.effects.registry import acting
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.creases import Creases
from bulgefit.gap.evidence.descend import descend
from bulgefit.gap.evidence.heights import height_rows, plane_rows
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.specimen import Specimen

TRUTH = {
    "E1": 340.0, "E2": 210.0, "G12": 20.0, "initial_shape.h0": 2.0, "initial_shape.hx": -0.7,
}  # fmt: skip
NAMES = ("initial_shape", "height_field", "dic_scale", "depth_scale", "reference_state")
#: Tilt and offset of the axes in which heights are reported.
TILT = np.array([0.3, 0.02, -0.01])


@pytest.fixture(scope="module")
def flat(made_by_the_model: Callable[..., Data]) -> Data:
    """Without heights."""
    return made_by_the_model(TRUTH, 15.0, frames=6, seed=5)


def with_measured_heights(d: Data, seed: int = 7) -> Data:
    """The same where z was kept: (1 - r²)(h0 + hx x) from a tilted plane, with a frame's noise."""
    points = np.array(d.specimen.reference)
    x, y = points[:, :2].T / 100.0
    noise = np.random.default_rng(seed).normal(scale=d.sigma[2], size=len(points))
    points[:, 2] = (1 - x**2 - y**2) * (2.0 - 0.7 * x) + noise
    points[:, 2] += np.column_stack([np.ones(len(x)), 100.0 * x, 100.0 * y]) @ TILT
    test = BulgeTest.from_arrays(points, d.specimen.measured, d.specimen.recorded)
    return replace(d, specimen=Specimen(test, refine=2))


@pytest.fixture(scope="module")
def data(flat: Data) -> Data:
    return with_measured_heights(flat)


def weighing_of(
    d: Data, offsets: np.ndarray | None = None, names: tuple[str, ...] = NAMES
) -> tuple[Weighing, Layout]:
    effects = [acting()[name] for name in names]
    coordinates = Coordinates.of(effects, [d.specimen.nulls()])
    layout = Layout.of(coordinates.groups)
    creases = None if offsets is None else [Creases.of(d, offsets, 0.0)]
    return Weighing([d], coordinates, creases), layout


def off_the_null(layout: Layout) -> np.ndarray:
    x = layout.null + layout.width * np.random.default_rng(1).uniform(0.02, 0.1, len(layout.null))
    x[:3] = np.log([TRUTH[name] for name in ("E1", "E2", "G12")])
    return x


def test_heights_are_seen_through_scales_beside_what_the_reference_image_shows(data: Data) -> None:
    values = {
        **TRUTH, "dic_scale.scale": 0.02, "depth_scale.scale_z": -0.01, "reference_state.z10": 0.3,
    }  # fmt: skip
    seen, _ = data.specimen.heights(values)
    x, y = data.specimen.reference[:, :2].T / 100.0
    # points seen at p lie at p/1.02
    height = (1 - (x**2 + y**2) / 1.02**2) * (2.0 - 0.7 * x / 1.02)
    at_rest = acting()["reference_state"].at_rest(
        {**{p.name: 0.0 for p in acting()["reference_state"].parameters}, "z10": 0.3},
        data.specimen.reference,
        100.0,
    )[:, 2]
    assert np.abs(at_rest).max() > 0.1
    np.testing.assert_allclose(seen, 0.99 * (1.02 * height + at_rest), atol=1e-12)


@pytest.mark.parametrize(
    "name",
    ["initial_shape.c2", "height_field.s1_1", "dic_scale.scale", "depth_scale.scale_z",
     "reference_state.z10", "registration.x0", "clamp_shape.radius_error", "rigid_motion.shift_z"],
)  # fmt: skip
def test_their_derivatives_are_those_of_differences(name: str, data: Data) -> None:
    values = {**TRUTH, "depth_scale.scale_z": 0.01, "clamp_shape.ellipticity": 0.01}
    _, (found,) = data.specimen.heights(values, [name])
    step = 0.1 * acting()[name.partition(".")[0]].parameter(name.partition(".")[2]).prior
    low, high = (data.specimen.heights({**values, name: h})[0] for h in (-step, step))
    difference = (high - low) / (2.0 * step)
    np.testing.assert_allclose(found, difference, atol=2e-4 * max(np.abs(difference).max(), 1e-9))
    assert difference.any() == (name != "rigid_motion.shift_z")


def test_gradients_are_those_of_the_misfit(data: Data) -> None:
    weighing, layout = weighing_of(data)
    x = off_the_null(layout)
    groups = [Owned(name) for name in NAMES]
    columns = np.unique(
        [0, *(layout.part(n).start for n in groups), layout.part(groups[1]).stop - 1]
    )
    here = weighing.linearise(x, columns)
    assert weighing.noise * data.inflation == pytest.approx(data.used.sum() + data.used.shape[1])
    for place, column in enumerate(columns):
        step, none = 1e-3 * layout.width[column], columns[:0]
        squares = []
        for way in (step, -step):
            there = np.array(x)
            there[column] += way
            squares.append(weighing.linearise(there, none, here.near).square)
            assert weighing.again(here, there).square == pytest.approx(squares[-1], rel=1e-9)
        slope = -0.5 * (squares[0] - squares[1]) / (2 * step)
        assert slope == pytest.approx(here.gradient[place], rel=5e-3), column


@pytest.mark.parametrize("sizes", [None, np.array([0.01, 0.02, 0.05])], ids=["plain", "offsets"])
def test_rows_are_those_of_a_dense_covariance(data: Data, sizes: np.ndarray | None) -> None:
    """r C⁻¹ r: noise, planes of any size, and offsets by which points stand too high."""
    used = np.array(data.used)
    used[2, ::3] = False
    used[:, 5, 2] = False  # a point whose height was never seen
    some = replace(data, used=used)
    weighing, layout = weighing_of(some, sizes)
    x, columns = off_the_null(layout), np.arange(3, 6)
    found = weighing.linearise(x, columns)
    one = weighing.seen(x, list(columns), 0)
    names = [weighing.coordinates.every[c].key.name for c in columns]
    frames = np.stack([*one.derivative(), np.zeros_like(one.displacement)]) * some.weight
    frames[-1] = some.residual(one)
    heights = height_rows(some, one.shapes.values, names)
    for_z = np.zeros((len(names) + 1, 1, *used.shape[1:]))
    for_z[:, 0, :, 2] = heights
    rows = np.concatenate([frames, for_z], axis=1)
    planes = np.zeros((3, *rows.shape[1:]))
    planes[:, -1, :, 2] = plane_rows(some)
    flat = planes.reshape(3, -1)
    covariance = np.eye(flat.shape[1]) + 1e9 * flat.T @ flat / (flat**2).sum()
    if sizes is not None:
        for point in range(used.shape[1]):
            for c in range(3):
                way = np.zeros(rows.shape[1:])
                way[:-1, point, c] = used[:, point, c]
                if c == 2 and used[:, point, 2].any():
                    way[-1, point, 2] = -1.0
                way = sizes[c] / some.sigma[c] * way.ravel()
                covariance += np.outer(way, way)
    flat = rows.reshape(len(rows), -1)
    exact = flat @ np.linalg.solve(covariance, flat.T)
    size = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(
        found.hessian, exact[:-1, :-1], atol=1e-5 * np.outer(size, size)[:-1, :-1].max()
    )
    assert found.square == pytest.approx(exact[-1, -1], rel=1e-5)
    np.testing.assert_allclose(found.gradient, exact[:-1, -1], atol=1e-5 * size.max() ** 2)


def test_a_shape_that_was_measured_is_told_from_frames_that_bend(flat: Data, data: Data) -> None:
    """A dome at rest is a constant bend of the frames but for its mechanics, until it is measured.

    The fit meets the truth, whatever plane heights are counted from.
    """
    errors = []
    for d in (flat, data):
        weighing, layout = weighing_of(d, names=("initial_shape", "frame_field"))
        model = freeze({Owned("initial_shape"): 1, Owned("frame_field"): 0})
        found = regression_of(weighing, descend(weighing, layout, model, off_the_null(layout)))
        se = found.standard_errors()
        for name, truth in TRUTH.items():
            assert abs(found.values[Key.of(name)] - truth) < 3.5 * se[Key.of(name)], name
        errors.append(se[Key.of("initial_shape.h0")])
    assert errors[1] < 0.2 * errors[0], errors
