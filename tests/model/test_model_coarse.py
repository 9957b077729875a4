"""Frames for which a path's levels are too far apart: are they balanced, and so differentiated?"""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import SolveError
from bulgefit.fem.path import Path
from bulgefit.model.coarse import balanced_where_coarse
from bulgefit.model.inflation import Inflation
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

MODULI = ("E1", "E2", "G12")
#: Its path goes on by descent, over snaps; 1.03 bar lies between levels on either side of one.
SOFT = {"E1": 121.97, "E2": 21.52, "G12": 3.621}
#: At 1.0255 bar there is no balanced shape near by: the path is unstable, and has a singular point.
SINGULAR = {"E1": 30.1, "E2": 119.74, "G12": 0.66}


def inflated(*pressures: float, interpolation: str = "dense") -> VirtualTest:
    at = np.array([[0.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
    test = BulgeTest.from_arrays(at, np.zeros((len(pressures), 2, 3)), pressures)
    return VirtualTest(test, Setup(refine=3, correct_mesh=False, interpolation=interpolation))


def test_frames_between_levels_on_either_side_of_a_snap_are_balanced() -> None:
    """The dense output is off by 0.2 mm there, and its derivatives by many times themselves."""
    pressures = (0.02, 0.103, 0.11)
    dense, each = inflated(*pressures), inflated(*pressures, interpolation="none")
    found, balanced = dense.shapes(SOFT, MODULI), each.shapes(SOFT, MODULI)
    here, changes = dense._described(dense.given(SOFT), MODULI)
    along = dense.inflation.along_path(here, dense.given(SOFT), changes)
    off = np.abs(along.displacement - balanced.displacement).max(axis=(1, 2))
    assert off[0] < 1e-4
    assert off[1] > 0.1
    far, rate = along.derivative["G12"][1], balanced.derivative["G12"][1]
    assert np.abs(far).max() > 10.0 * np.abs(rate).max()
    assert found.error < dense.setup.tolerance
    np.testing.assert_allclose(found.displacement, balanced.displacement, atol=1e-4)
    for name in MODULI:
        step = 1e-4 * SOFT[name]
        ends = (inflated(*pressures).shapes({**SOFT, name: SOFT[name] + k * step}) for k in (-1, 1))
        below, above = (end.displacement for end in ends)
        rate = (above - below) / (2 * step)
        np.testing.assert_allclose(
            found.derivative[name], rate, atol=1e-3 * np.abs(rate).max(axis=(1, 2)).max()
        )


def test_at_a_singular_point_the_dense_output_stays_and_tells_its_error() -> None:
    dense = inflated(0.02, 0.1025517, 0.11)
    found = dense.shapes(SINGULAR, MODULI)
    assert dense.setup.tolerance < found.error < np.inf


def test_a_frame_is_not_told_by_an_error_that_is_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    def unbalanced(*given: object, **more: object) -> None:
        raise SolveError(
            "no step", pressure=0.1, reached=0.0, iteration=0, residual_norm=0.0, parameters={}
        )

    dense = inflated(0.103, 0.11)
    here, changes = dense._described(dense.given(SOFT), ())
    along = dense.inflation.along_path(here, dense.given(SOFT), changes)
    monkeypatch.setattr(Inflation, "balanced", unbalanced)
    kept = balanced_where_coarse(dense.inflation, along, here, changes, 1)
    assert 1e-4 < kept.error < np.inf
    monkeypatch.setattr(Path, "errors_at", lambda path, pressure: np.full(len(pressure), np.inf))
    with pytest.raises(SolveError, match="no step"):
        balanced_where_coarse(dense.inflation, along, here, changes, 1)


def test_a_path_within_its_tolerance_is_read_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Inflation, "balanced", None)
    found = inflated(0.0, 0.02, 0.1).shapes({"E1": 330.0, "E2": 240.0, "G12": 30.0}, MODULI)
    assert 0.0 < found.error < 1e-4


def test_what_couples_shear_to_stretch_is_differentiated_off_the_mirrors() -> None:
    """Shapes mirror where it is absent; what it does to them is odd in both mirrors."""
    virtual = inflated(0.1, 0.2)
    stiff = {"E1": 330.0, "E2": 240.0, "G12": 30.0}
    names = ("coupling_field.c_x", "coupling_field.c_y")
    found = virtual.shapes(stiff, names)
    for name in names:
        ends = (virtual.shapes({**stiff, name: k * 1e-3}).displacement for k in (-1, 1))
        below, above = ends
        rate = (above - below) / 2e-3
        np.testing.assert_allclose(found.derivative[name], rate, atol=1e-4 * np.abs(rate).max())
