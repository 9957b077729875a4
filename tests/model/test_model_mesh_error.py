"""The mesh's error is taken off where shapes are smooth, and let be where they are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.readers import read_test
from bulgefit.fitting.fit import fit
from bulgefit.model.mesh_error import correct_mesh, corrected, mesh_remainder
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

EXAMPLE = Path(__file__).parents[2] / "data" / "example_slip.npz"


@pytest.fixture(scope="module")
def test_with_slip() -> BulgeTest:
    return read_test(EXAMPLE)


def test_shapes_with_bands_keep_the_meshs_error(test_with_slip):
    """Soft shear localises above some pressure, in bands as wide as a cell."""
    virtual = VirtualTest(test_with_slip, Setup(refine=3))
    soft = {"E1": 381.0, "E2": 174.0, "G12": 1.0, "nu12": 0.24}
    shapes = virtual.shapes(soft)
    assert shapes.stable.any()
    assert not shapes.stable.all()
    correct_mesh(virtual, shapes)
    taken = np.abs(virtual.correction).max(axis=(1, 2))
    assert (taken[~shapes.stable] == 0.0).all()
    assert (taken[shapes.stable] > 0.0).any()
    assert taken.max() < 0.5
    assert mesh_remainder(virtual, shapes) is None


def test_stiff_shear_has_it_taken_off_in_every_frame(test_with_slip):
    virtual = VirtualTest(test_with_slip, Setup(refine=3))
    shapes = virtual.shapes({"E1": 330.0, "E2": 240.0, "G12": 30.0, "nu12": 0.24})
    correct_mesh(virtual, shapes)
    assert (np.abs(virtual.correction).max(axis=(1, 2)) > 0.0).all()
    left = mesh_remainder(virtual, shapes)
    assert np.abs(left).max() < 0.2 * np.abs(virtual.correction).max()


def test_a_fit_to_soft_shear_does_not_end_worse_than_its_starts(test_with_slip):
    found = fit(test_with_slip, starts=1, weight=0.1)
    assert found.stability.frames_beyond > 0
    assert found.value < 1.1 * min(d.best.value for d in found.descents)


def test_what_other_meshes_do_not_have_alike_keeps_its_error():
    """At 3 bar bands of shear have formed on the finer mesh, 11 mm from this one's shape."""
    at = np.array([[0.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
    pressure = np.array([0.1, 0.2, 0.3])
    test = BulgeTest.from_arrays(at, np.zeros((3, 2, 3)), pressure)
    virtual = VirtualTest(test, Setup(refine=3))
    soft = {"E1": 87.0, "E2": 247.0, "G12": 5.91, "axis_misalignment.angle": 27.0}
    shapes = virtual.shapes(soft)
    correct_mesh(virtual, shapes)
    taken = np.abs(virtual.correction).max(axis=(1, 2))
    assert shapes.stable.all()
    assert (taken[:2] > 0.1).all()
    assert taken[2] == 0.0
    assert corrected(virtual, shapes).tolist() == [True, True, False]
    given = virtual.description(soft)
    membrane = virtual.inflation.membrane(given)
    assert not membrane.is_elliptic(shapes.displacement[1], given.stiffness)
