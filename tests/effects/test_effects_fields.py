"""Generic fields: nothing at their null, what their docstrings say off it, and where they are."""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.fields.base import Field
from bulgefit.effects.fields.stiffness_field import CENTRES
from bulgefit.effects.places import Cloth
from bulgefit.effects.registry import acting, catalogue, chosen_effects, fields, scatter
from bulgefit.errors import InputError
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

VALUES = {"E1": 330.0, "E2": 210.0, "G12": 20.0, "initial_shape.h0": 0.5}
NAMES = [p.name for p in fields()["stiffness_field"].parameters]
EVERY = [field for field in fields().values() if field.parameters]


@pytest.fixture(scope="module")
def virtual() -> VirtualTest:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-65, 65, (40, 2)), np.zeros(40)])
    pressure, time = np.array([0.02, 0.1, 0.25]), np.array([5.0, 25.0, 405.0])
    test = BulgeTest.from_arrays(points, np.zeros((3, 40, 3)), pressure, time=time)
    return VirtualTest(test, Setup(refine=2))


def test_fields_stand_beside_the_catalogue():
    assert not set(fields()) & set(catalogue())
    assert set(acting()) == set(fields()) | set(catalogue()) | set(scatter())
    assert {f.place for f in EVERY} == {"shape", "material", "load", "camera"}
    with pytest.raises(InputError, match="stiffness_field"):
        chosen_effects(["stiffness_field"])


@pytest.mark.parametrize("field", EVERY, ids=lambda f: f.id)
def test_nothing_at_the_null_and_exact_derivatives(field: Field, virtual: VirtualTest):
    plain = virtual.predict(VALUES)
    nulls = dict.fromkeys(field.names, 0.0)
    none = virtual.predict({**VALUES, **nulls}, near=plain.shapes)
    np.testing.assert_allclose(none.displacement, plain.displacement, atol=1e-7)
    rng = np.random.default_rng(1)
    at = {
        f"{field.id}.{p.name}": 0.3 * p.prior * rng.normal() for p in field.parameters
    }  # away from the null, where products show
    names = [field.names[0], field.names[-1]]
    here = virtual.predict({**VALUES, **at}, names, plain.shapes)
    for name, derivative in zip(names, here.derivative, strict=True):
        step = 0.03 * field.parameter(name.partition(".")[2]).prior
        ahead, behind = (
            virtual.predict({**VALUES, **at, name: at[name] + h}, near=here.shapes).displacement
            for h in (step, -step)
        )
        change = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(derivative, change, atol=2e-3 * np.abs(change).max())


def own(field: Field, **values: float) -> dict[str, float]:
    return {**{p.name: 0.0 for p in field.parameters}, **values}


def test_a_soft_spot_is_where_its_bump_is():
    field = fields()["stiffness_field"]
    k = int(np.argmin(np.hypot(*(CENTRES - [0.44, -0.22]).T)))
    found = field.sampled(own(field, **{f"b{k}": -0.6}), 100.0, np.array([0.1]))
    size, where = found.largest
    assert size == pytest.approx(np.expm1(-0.6), abs=0.01)
    assert np.hypot(*([where["x_mm"], where["y_mm"]] - 100.0 * CENTRES[k])) < 2.0
    assert 0.0 < found.rms < 0.2


@pytest.mark.parametrize("place", [(0.15, -0.53), (-0.31, 0.22), (0.0, 0.07)])
def test_a_narrow_soft_spot_is_followed(place: tuple[float, float]):
    """Of 42 % and 0.13 of the radius, between the bumps as on them: within 5 % of its height."""
    field = fields()["stiffness_field"]
    line = np.linspace(-0.95, 0.95, 60)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(1, -1, 2)
    points = points[:, np.hypot(*points[0].T) <= 0.95]
    cloth = Cloth(1.0, 1.0, 1.0, 0.2, points)
    bumps = np.log([field.material(own(field, **{n: 1.0}), cloth).thickness[0] for n in NAMES])
    square = ((points[0] - place) ** 2).sum(axis=1)
    spot = np.log(1.0 - 0.42 * np.exp(-0.5 * square / 0.13**2))
    heights, *_ = np.linalg.lstsq(bumps.T, spot, rcond=1e-6)
    assert np.abs(bumps.T @ heights - spot).max() < 0.05 * np.abs(spot).max()


def test_a_lobe_is_at_its_angle():
    field = fields()["rim_field"]
    turn = np.deg2rad(25.0)
    values = own(field, c3=0.01 * np.cos(3 * turn), s3=0.01 * np.sin(3 * turn))
    size, where = field.sampled(values, 100.0, np.array([0.1])).largest
    assert abs(size) == pytest.approx(0.01, rel=1e-3)
    assert where["angle_degree"] % 60.0 == pytest.approx(25.0, abs=1.0)


def test_a_gauge_that_errs_is_told_by_pressure():
    field, pressure = fields()["pressure_field"], np.linspace(0.01, 0.25, 9)
    # a bow: P_2 is 1 - 6 x (1 - x)
    found = field.sampled(own(field, c2=-0.02), 100.0, pressure)
    share = pressure / 0.25
    np.testing.assert_allclose(found.values, 0.12 * share * (1.0 - share) - 0.02)
    size, where = found.largest
    assert (size, where) == (pytest.approx(-0.02), {"pressure_bar": pytest.approx(2.5)})


def test_frames_that_shift_are_told_by_their_size():
    field, pressure = fields()["frame_field"], np.linspace(0.01, 0.25, 9)
    found = field.sampled(own(field, z00_0=0.3, x00_0=0.4), 100.0, pressure)
    np.testing.assert_allclose(found.values, 0.5)


def test_a_drift_goes_with_the_time(virtual: VirtualTest):
    """Half a minute to the second frame, six more to the third."""
    plain = virtual.predict(VALUES)
    drifted = virtual.predict({**VALUES, "drift_field.x00_1": 0.4}, near=plain.shapes)
    moved = (drifted.displacement - plain.displacement)[:, :, 0]
    np.testing.assert_allclose(moved, np.array([[0.0], [0.02], [0.4]]) * np.ones(40), atol=1e-6)
    field = fields()["drift_field"]
    size, where = field.sampled(own(field, x00_1=0.4), 100.0, np.array([0.1])).largest
    assert (size, where) == (pytest.approx(0.4), {"time_share": 1.0})
