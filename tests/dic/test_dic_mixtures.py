"""Frames that were interpolated are told from recorded ones, and from computed ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.mixtures import independent_frames
from bulgefit.dic.readers import read_test
from bulgefit.dic.suspicions import suspicions
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

COMMON = np.linspace(0.01, 0.25, 20)


def dome(pressure: np.ndarray, noise: float) -> BulgeTest:
    """Heights as the cube root of pressure, and noise (mm)."""
    side = np.arange(-90.0, 91.0, 6.0)
    x, y = (g.ravel() for g in np.meshgrid(side, side))
    points = np.column_stack([x, y, np.zeros(len(x))])[np.hypot(x, y) < 94.0]
    square = (points[:, :2] ** 2).sum(axis=1) / 100.0**2
    rise = np.cbrt(pressure / 0.25)[:, None]
    height = 30.0 * rise * (1.0 - square) * (1.0 - 0.05 * rise**2 * square)
    moved = np.zeros((len(pressure), len(points), 3))
    moved[..., 2] = height
    moved[..., :2] = 0.06 * points[:, :2] * (rise**2 * (1.0 - square))[..., None]
    moved += noise * np.random.default_rng(3).normal(size=moved.shape)
    return BulgeTest.from_arrays(points, moved, pressure)


def interpolated(test: BulgeTest, dtype: type = np.float64) -> BulgeTest:
    """At common pressures, straight between the frames."""
    (block,) = test.blocks
    flat = block.displacement.reshape(test.n_frames, -1)
    columns = [np.interp(COMMON, test.pressure, column) for column in flat.T]
    moved = np.stack(columns, axis=1).reshape(len(COMMON), -1, 3)
    # a file of single precision
    moved = moved.astype(dtype).astype(np.float64)
    return BulgeTest.from_arrays(np.asarray(block.reference), moved, COMMON)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("recorded", [5, 11])
def test_mixtures_have_the_rank_of_what_was_recorded(recorded: int, dtype: type) -> None:
    test = interpolated(dome(np.linspace(0.01, 0.25, recorded), 0.005), dtype)
    assert independent_frames(test) == recorded
    (said,) = [s for s in suspicions(test) if s.code == "frames_interpolated"]
    assert f"the 20 frames are linear mixtures of {recorded}" in said.text


@pytest.mark.parametrize("rounding", [0.0, 8e-13, 2e-6])
def test_a_reference_image_is_no_mixture(rounding: float) -> None:
    """DIC systems write it as exact zeros, or as what rounding leaves of them."""
    test = dome(COMMON, 0.001)
    (block,) = test.blocks
    still = rounding * np.random.default_rng(4).normal(size=block.displacement[:1].shape)
    moved = np.concatenate([still, block.displacement])
    with_it = BulgeTest.from_arrays(block.reference, moved, [0.0, *COMMON])
    assert independent_frames(with_it) == 21
    assert not [s for s in suspicions(with_it) if s.code == "frames_interpolated"]


def test_recorded_frames_are_independent() -> None:
    test = dome(COMMON, 0.001)
    assert independent_frames(test) == 20
    assert not [s for s in suspicions(test) if s.code == "frames_interpolated"]


def test_a_frame_at_rest_is_one() -> None:
    recorded = dome(np.append(0.0, np.geomspace(1e-3, 0.25, 15)), 0.002)
    (block,) = recorded.blocks
    moved = block.displacement.copy()
    moved[0] = 0.0
    rest = BulgeTest.from_arrays(np.asarray(block.reference), moved, recorded.pressure)
    assert independent_frames(rest) == 16


def test_computed_frames_are_no_mixtures() -> None:
    """Without noise the patterns of a membrane grow ever fainter, but none is left out."""
    virtual = VirtualTest(dome(COMMON, 0.0), Setup(refine=2))
    seen = virtual.predict({"E1": 330.0, "E2": 200.0, "G12": 20.0}).displacement
    points = np.asarray(virtual.test.blocks[0].reference)
    assert independent_frames(BulgeTest.from_arrays(points, seen, COMMON)) == 20


def test_lost_points_are_left_out() -> None:
    test = interpolated(dome(np.linspace(0.01, 0.25, 6), 0.005))
    (block,) = test.blocks
    moved = block.displacement.copy()
    moved[3, ::4] = np.nan
    assert independent_frames(BulgeTest.from_arrays(block.reference, moved, COMMON)) == 6


@pytest.mark.parametrize(("number", "recorded"), [(2, 7), (4, 11)])
def test_the_studys_binned_frames_are_mixtures_of_those_recorded(
    shared: Path, number: int, recorded: int
) -> None:
    folder = shared / "data" / "dic"
    assert independent_frames(read_test(folder / f"valmex_test{number}_binned.npz")) == recorded
    assert independent_frames(read_test(folder / f"valmex_test{number}_recorded.npz")) == recorded
