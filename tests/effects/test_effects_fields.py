"""Generic fields: nothing at their null, what their docstrings say off it, and where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.effects.base import PLACES, Effect
from bulgefit.effects.fields.base import Field
from bulgefit.effects.fields.stiffness_field import CENTRES
from bulgefit.effects.places import Clamping, Cloth
from bulgefit.effects.registry import acting, catalogue, chosen_effects, fields, scatter
from bulgefit.errors import InputError
from bulgefit.fem.clamp import LEAST_COMPLIANCE
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import flat_guess, solve
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import disc
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
    assert {f.place for f in EVERY} == set(PLACES)
    with pytest.raises(InputError, match="stiffness_field"):
        chosen_effects(["stiffness_field"])


def test_thickening_in_closed_form_is_what_the_hook_does_to_the_cloth():
    """Of each effect that states it: by differences of its hook, which changes nothing else."""
    rng = np.random.default_rng(3)
    cloth = Cloth(300.0, 200.0, 20.0, 0.24, rng.uniform(-0.6, 0.6, (7, 4, 2)))
    stated = 0
    for effect in acting().values():
        own = {p.name: 0.3 * p.prior * rng.normal() for p in effect.parameters}
        for name, rate in effect.thickening(own, cloth.points).items():
            stated += 1
            ends = [effect.material({**own, name: own[name] + h}, cloth) for h in (-1e-4, 1e-4)]
            low, high = (end.thickness for end in ends)
            assert low is not None
            assert high is not None
            np.testing.assert_allclose((np.log(high) - np.log(low)) / 2e-4, rate, atol=1e-8)
            assert vars(ends[1]) | {"thickness": None} == vars(cloth)
    assert stated == len(NAMES)


@pytest.mark.parametrize("field", EVERY, ids=lambda f: f.id)
def test_nothing_at_the_null_and_exact_derivatives(field: Field, virtual: VirtualTest):
    plain = virtual.predict(VALUES)
    nulls = dict.fromkeys(field.names, 0.0)
    none = virtual.predict({**VALUES, **nulls}, near=plain.shapes)
    np.testing.assert_allclose(none.displacement, plain.displacement, atol=1e-7)
    rng = np.random.default_rng(1)
    at = {
        f"{field.id}.{p.name}": 0.3 * p.prior * (abs(size) if p.begins_at_null else size)
        for p, size in zip(field.parameters, rng.normal(size=len(field.parameters)), strict=True)
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


def own(field: Effect, **values: float) -> dict[str, float]:
    return {**{p.name: 0.0 for p in field.parameters}, **values}


def test_a_soft_spot_is_where_its_bump_is():
    field = fields()["stiffness_field"]
    k = int(np.argmin(np.hypot(*(CENTRES - [0.44, -0.22]).T)))
    found = field.sampled(own(field, **{f"b{k}": -0.6}), 100.0, np.array([0.1]))
    size, where = found.largest
    assert size == pytest.approx(np.expm1(-0.6), abs=0.01)
    assert np.hypot(*([where["x_mm"], where["y_mm"]] - 100.0 * CENTRES[k])) < 2.0
    assert 0.0 < found.rms < 0.2


def test_a_soft_spot_is_told_against_the_cloth_about_it():
    """The moduli are the specimen's mean; cloth in most places is stiffer by what a spot takes."""
    field = fields()["stiffness_field"]
    assert field.typical(own(field)).value == 1.0
    k = int(np.argmin(np.hypot(*(CENTRES - [0.44, -0.22]).T)))
    values = own(field, **{f"b{k}": -0.6})
    # a bump's mean over the disc is 2w²
    assert field.typical(values).value == pytest.approx(np.exp(0.6 * 2.0 * 0.11**2), rel=1e-3)
    size, _ = field.sampled(values, 100.0, np.array([0.1])).largest
    assert size == pytest.approx(np.expm1(-0.6), abs=0.01)
    assert fields()["rim_field"].typical({}).value == 1.0


def test_a_level_moves_as_the_field_does_where_it_is_the_median():
    """Against differences of the median itself; and its error is that of a median of so many."""
    field, rng = fields()["stiffness_field"], np.random.default_rng(7)
    values = own(field, **dict(zip(NAMES, rng.normal(0.0, 0.1, len(NAMES)), strict=True)))
    level, slopes, changes = field.typical(values), [], []
    for _ in range(30):
        along = dict(zip(NAMES, rng.normal(0.0, 1.0, len(NAMES)), strict=True))
        ends = [
            field.typical({n: values[n] + sign * 1e-2 * along[n] for n in NAMES}).value
            for sign in (1.0, -1.0)
        ]
        slopes.append(sum(level.slopes[n] * along[n] for n in NAMES))
        changes.append(np.log(ends[0] / ends[1]) / 2e-2)
    assert np.corrcoef(slopes, changes)[0, 1] > 0.9
    assert np.dot(slopes, changes) / np.dot(slopes, slopes) == pytest.approx(1.0, abs=0.1)
    # the field is normal: the median of n values has √(π/2n) standard deviations (the density is
    # told by the tenth of 160 places); beside it stands how far off the half is that is most alike
    found = np.sort(np.log1p(field.sampled(values, 100.0, np.array([0.1])).values))
    half = len(found) // 2
    halves = [found[k : k + half + 1] for k in range(len(found) - half)]
    apart = min(halves, key=np.ptp).mean()
    alone = np.sqrt(level.error**2 - apart**2)
    assert alone == pytest.approx(found.std() * np.sqrt(0.5 * np.pi / (np.pi / 0.14**2)), rel=0.25)


def test_what_stands_out_on_one_side_leaves_the_level_open():
    """A wide spot's skirts lie over most of the cloth: its median is off by about its error."""
    field = fields()["stiffness_field"]
    bells = np.exp(-0.5 * ((CENTRES - [-0.5, -0.1]) ** 2).sum(axis=1) / 0.2**2)
    values = dict(zip(NAMES, -0.12 * bells, strict=True))
    size, _ = field.sampled(own(field, **values), 100.0, np.array([0.1])).largest
    assert size < -0.29
    level = field.typical(own(field, **values))
    at = np.array([[0.8, 0.3], [0.5, -0.6], [0.6, 0.6]])  # far from the spot
    cloth = field.material(own(field, **values), Cloth(1.0, 1.0, 1.0, 0.2, at[None]))
    off = float(np.log(level.value) - np.log(cloth.thickness).max())
    assert 5e-4 < -off < 2.0 * level.error


def test_stiffness_as_a_whole_is_the_moduli():
    """Equal bumps, those beyond the rim among them, change next to nothing up to the rim."""
    field = fields()["stiffness_field"]
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    points = np.concatenate([r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in
                             (0.0, 0.5, 0.8)])[None]  # fmt: skip
    cloth = Cloth(1.0, 1.0, 1.0, 0.2, points)
    even = np.log(field.material(own(field, **dict.fromkeys(NAMES, 0.1)), cloth).thickness)
    # of 2πw²/s² = 0.39 that they would sum to
    assert np.abs(even).max() < 0.01


@pytest.mark.parametrize("place", [(0.15, -0.53), (-0.31, 0.22), (0.0, 0.07), (0.6, -0.75)])
def test_a_narrow_soft_spot_is_followed(place: tuple[float, float]):
    """Of 42 % and 0.13 of the radius, between the bumps as on them: within 5 % of its height."""
    field = fields()["stiffness_field"]
    line = np.linspace(-1.0, 1.0, 60)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(1, -1, 2)
    points = points[:, np.hypot(*points[0].T) <= 1.0]
    cloth = Cloth(1.0, 1.0, 1.0, 0.2, points)
    bumps = np.log([field.material(own(field, **{n: 1.0}), cloth).thickness[0] for n in NAMES])
    bumps = np.vstack([bumps, np.ones(len(points[0]))])  # beside the moduli
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


def test_waves_of_the_height_are_orthogonal_over_the_disc_also_to_those_that_have_a_name():
    field, named = fields()["height_field"], catalogue()["initial_shape"]
    # exact for polynomials of the waves' degrees: Gauss in r², evenly round
    knots, weights = np.polynomial.legendre.leggauss(12)
    angle = np.arange(32) * 2.0 * np.pi / 32
    r, turn = (a.ravel() for a in np.meshgrid(np.sqrt(0.5 * (knots + 1.0)), angle))
    unit, area = np.column_stack([r * np.cos(turn), r * np.sin(turn)]), np.tile(weights, 32)
    every = [(e, p.name) for e in (field, named) for p in e.parameters]
    waves = np.array([e.height(own(e, **{name: 1.0}), unit) for e, name in every])
    size = np.sqrt((waves**2 * area).sum(axis=1))
    cosine = (waves * area) @ waves.T / np.outer(size, size)
    own_waves = cosine[: len(field.parameters)]
    np.testing.assert_allclose(own_waves, np.eye(*own_waves.shape), atol=1e-12)


@pytest.mark.parametrize("name", fields()["height_field"].names)
def test_a_wave_of_the_height_is_as_high_as_it_says_and_ends_at_the_rim(name: str):
    field = fields()["height_field"]
    values = own(field, **{name.partition(".")[2]: -0.7})
    found = field.sampled(values, 100.0, np.array([0.1]))
    size, where = found.largest
    assert abs(size) == pytest.approx(0.7, rel=5e-3)
    assert np.hypot(where["x_mm"], where["y_mm"]) < 95.0
    angle = np.linspace(0.0, 6.0, 9)
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(field.height(values, rim), 0.0, atol=1e-14)


def test_the_rim_rises_by_its_waves_and_less_as_pressure_grows(virtual: VirtualTest):
    values = {"lift_field.c2": 0.2, "lift_field.s3": -0.1, "lift_field.shape": 0.5}
    shapes = virtual.shapes({**VALUES, **values})
    rim = virtual.mesh.nodes[virtual.mesh.rim]
    angle = np.arctan2(rim[:, 1], rim[:, 0])
    bar = np.array([0.2, 1.0, 2.5])[:, None]
    rise = (0.2 * np.cos(2 * angle) - 0.1 * np.sin(3 * angle)) * (1 - np.exp(-0.5 * bar)) / 0.5
    np.testing.assert_allclose(shapes.displacement[:, virtual.mesh.rim, 2], rise, atol=1e-12)
    field = fields()["lift_field"]
    given = {name.partition(".")[2]: value for name, value in values.items()}
    found = field.sampled(own(field, **given), 100.0, virtual.recorded)
    size, where = found.largest
    assert abs(size) == pytest.approx(np.abs(rise[-1]).max(), rel=1e-2)
    assert "angle_degree" in where


SLIP = {"slip_field.c2_0": 0.2, "slip_field.s3_0": -0.1, "slip_field.c0_1": 0.05}


def inwards(angle: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """What SLIP says, (frames, n) mm."""
    load = (pressure[:, None] / 0.25) ** (2 / 3)
    even = 0.2 * np.cos(2 * angle) - 0.1 * np.sin(3 * angle)
    return load * (even + 0.05 * np.cos(np.pi * load))


def test_the_rim_moves_inwards_by_its_waves(virtual: VirtualTest):
    shapes = virtual.shapes({**VALUES, **SLIP})
    rim = virtual.mesh.nodes[virtual.mesh.rim]
    angle = np.arctan2(rim[:, 1], rim[:, 0])
    moved = inwards(angle, virtual.recorded)[..., None] * -rim / 100.0
    np.testing.assert_allclose(shapes.displacement[:, virtual.mesh.rim, :2], moved, atol=1e-12)
    given = {name.partition(".")[2]: value for name, value in SLIP.items()}
    found = fields()["slip_field"].sampled(
        own(fields()["slip_field"], **given), 100.0, virtual.recorded
    )
    by_angle = inwards(np.deg2rad(found.where["angle_degree"]), virtual.recorded)[-1]
    np.testing.assert_allclose(found.values, by_angle, atol=1e-12)


def test_a_sector_that_slips_by_its_own_traction_is_followed():
    """What gives eases its own traction: of uneven springs no angle has the others' course."""
    membrane = Membrane(disc(), 0.81, "hencky", fabric=Fabric(compliance=0.005))
    clamp = membrane.clamp
    assert clamp is not None
    angle = np.arctan2(clamp.radial[:, 1], clamp.radial[:, 0])
    away = np.minimum(np.abs(angle - 0.4) / np.deg2rad(41.0), 1.0)
    more = 0.03 * np.cos(0.5 * np.pi * away) ** 2
    change = clamp.length / (0.005 + more) - clamp.length / 0.005
    clamp.stiffness += change[:, None, None] * clamp.radial[:, :, None] * clamp.radial[:, None, :]
    stiffness = orthotropic_stiffness(330.0, 210.0, 20.0, 0.24)
    pressure, moved, shape = np.linspace(0.01, 0.3, 12), [], None
    for p in pressure:
        start = flat_guess(membrane, p, stiffness) if shape is None else shape
        shape = solve(membrane, start, p, stiffness).displacement
        moved.append(-(shape[clamp.rim, :2] * clamp.radial).sum(axis=1))
    # beside springs that are alike, which follow the traction
    traction = np.array(moved) / (0.005 + more)
    slip = more * traction
    field, clamping = fields()["slip_field"], Clamping(angle, pressure)
    each = [own(field, **{p.name: 1.0}) for p in field.parameters]
    waves = np.array([field.clamp(values, clamping).inwards for values in each])
    basis = np.concatenate([waves, traction[None]]).reshape(len(waves) + 1, -1).T
    found, *_ = np.linalg.lstsq(basis, slip.ravel(), rcond=None)
    left = slip.ravel() - basis @ found
    # 0.044 with courses of orders 0 to 2 alone
    assert np.sqrt((left**2).mean() / (slip**2).mean()) < 0.02


ALONG = {"tangential_slip_field.s2_0": 0.3, "tangential_slip_field.c3_1": -0.05}


def test_the_rim_moves_along_itself_by_its_waves(virtual: VirtualTest):
    """Counter-clockwise, and nowhere else."""
    shapes = virtual.shapes({**VALUES, **ALONG})
    rim = virtual.mesh.nodes[virtual.mesh.rim] / 100.0
    load = (virtual.recorded[:, None] / 0.25) ** (2 / 3)

    def along(angle: np.ndarray) -> np.ndarray:
        course = np.cos(np.pi * load)
        return load * (0.3 * np.sin(2 * angle) - 0.05 * course * np.cos(3 * angle))

    moved = along(np.arctan2(rim[:, 1], rim[:, 0]))[..., None] * rim[:, ::-1] * [-1.0, 1.0]
    np.testing.assert_allclose(shapes.displacement[:, virtual.mesh.rim, :2], moved, atol=1e-12)
    np.testing.assert_allclose(shapes.displacement[:, virtual.mesh.rim, 2], 0.0, atol=1e-12)
    field = fields()["tangential_slip_field"]
    given = {name.partition(".")[2]: value for name, value in ALONG.items()}
    found = field.sampled(own(field, **given), 100.0, virtual.recorded)
    by_angle = along(np.deg2rad(found.where["angle_degree"]))[-1]
    np.testing.assert_allclose(found.values, by_angle, atol=1e-12)


def test_an_edge_that_gives_along_itself_is_followed():
    """Warp that is stiffer than fill pulls along the edge by sin 2φ, and turns nothing."""
    membrane = Membrane(disc(), 0.81, "yarn", fabric=Fabric(compliance=0.02))
    clamp = membrane.clamp
    assert clamp is not None
    along = np.stack([-clamp.radial[:, 1], clamp.radial[:, 0]], axis=1)
    softer = clamp.length / 0.02 - clamp.length / LEAST_COMPLIANCE
    clamp.stiffness += softer[:, None, None] * along[:, :, None] * along[:, None, :]
    stiffness = orthotropic_stiffness(600.0, 210.0, 15.0, 0.24)
    pressure, moved, shape = np.linspace(0.01, 0.3, 12), [], None
    for p in pressure:
        start = flat_guess(membrane, p, stiffness) if shape is None else shape
        shape = solve(membrane, start, p, stiffness).displacement
        moved.append((shape[clamp.rim, :2] * along).sum(axis=1))
    slip, angle = np.array(moved), np.arctan2(clamp.radial[:, 1], clamp.radial[:, 0])
    second, fourth, *finer = (slip[-1] @ np.sin(m * angle) for m in (2, 4, 6, 8))
    assert second > fourth > 0.0
    assert np.abs(finer).max() < 0.1 * second
    assert np.abs((slip * clamp.length).sum(axis=1)).max() < 1e-6 * np.abs(slip).max() * 628.0
    field, clamping = fields()["tangential_slip_field"], Clamping(angle, pressure)
    each = [own(field, **{p.name: 1.0}) for p in field.parameters]
    waves = [field.clamp(values, clamping).along for values in each]
    basis = np.array(waves).reshape(len(waves), -1).T
    found, *_ = np.linalg.lstsq(basis, slip.ravel(), rcond=None)
    left = slip.ravel() - basis @ found
    # 0.025 in proportion to traction alone, 0.51 with order 2 alone
    assert np.sqrt((left**2).mean() / (slip**2).mean()) < 0.012


def decades_of(virtual: VirtualTest) -> np.ndarray:
    """Of time since the first frame, in median intervals."""
    assert virtual.test.time is not None
    passed = virtual.test.time - virtual.test.time[0]
    return np.log10(1.0 + passed / np.median(np.diff(virtual.test.time)))


def course_of(virtual: VirtualTest) -> np.ndarray:
    """Decades of time over those of the last frame: none at the first."""
    decades = decades_of(virtual)
    return np.asarray(decades / decades[-1])


def test_the_rim_goes_on_giving_by_the_decade(virtual: VirtualTest):
    """No time at the first frame, half a minute at the second, ten at the third."""
    shapes = virtual.shapes({**VALUES, "slow_slip_field.s1_2": 0.1})
    rim = virtual.mesh.nodes[virtual.mesh.rim]
    angle = np.arctan2(rim[:, 1], rim[:, 0])
    load = (virtual.recorded[:, None] / virtual.recorded.max()) ** (2 / 3)
    inwards = load * 0.1 * course_of(virtual)[:, None] ** 2 * np.sin(angle)
    moved = inwards[..., None] * -rim / 100.0
    np.testing.assert_allclose(shapes.displacement[:, virtual.mesh.rim, :2], moved, atol=1e-12)
    field = fields()["slow_slip_field"]
    size, where = field.sampled(own(field, c0_1=0.2, s1_2=0.1), 100.0, virtual.recorded).largest
    assert (size, where) == (pytest.approx(0.3), {"angle_degree": pytest.approx(90.0)})


def test_what_gives_more_all_round_is_a_clamp_that_slips_more_in_each_frame(virtual: VirtualTest):
    """0.2 mm under 10 N/mm at the last frame, beside a slip of 0.01 mm per N/mm."""
    slip = {"clamp_slip.compliance": 0.01}
    eased = virtual.shapes({**VALUES, **slip, "slow_slip_field.c0_1": 0.2})
    assert virtual.mesh.rim.size
    for frame, course in enumerate(course_of(virtual)):
        alike = virtual.shapes({**VALUES, "clamp_slip.compliance": 0.01 + 0.02 * course})
        np.testing.assert_allclose(
            eased.displacement[frame], alike.displacement[frame], rtol=0.0, atol=1e-8
        )


def test_a_clamp_gives_by_the_traction_of_cloth_that_has_crept(virtual: VirtualTest):
    """Cloth creeps and its clamp does not: in each frame as cloth of so much less stiffness."""
    slip = {"clamp_slip.compliance": 0.02, "slow_slip_field.c0_1": 0.1}
    crept = virtual.shapes({**VALUES, **slip, "creep.rate": 0.1})
    for frame, softened in enumerate(1.0 - 0.1 * decades_of(virtual)):
        soft = {name: softened * VALUES[name] for name in ("E1", "E2", "G12")}
        alike = virtual.shapes({**VALUES, **soft, **slip})
        np.testing.assert_allclose(
            crept.displacement[frame], alike.displacement[frame], rtol=0.0, atol=1e-6
        )


@pytest.mark.parametrize("name", ["creep.rate", "clamp_slip.compliance", "slow_slip_field.c0_1"])
def test_derivatives_by_what_creeps_on_a_clamp_that_slips(virtual: VirtualTest, name: str):
    values = {**VALUES, "creep.rate": 0.05, "clamp_slip.compliance": 0.02}
    values["slow_slip_field.c0_1"] = 0.1
    found = virtual.predict(values, [name]).derivative[0]
    step = {"creep.rate": 1e-4, "clamp_slip.compliance": 1e-4, "slow_slip_field.c0_1": 1e-3}[name]
    low, high = (
        virtual.predict({**values, name: values[name] + way * step}).displacement
        for way in (-1.0, 1.0)
    )
    by_difference = (high - low) / (2.0 * step)
    scale = np.abs(by_difference).max()
    np.testing.assert_allclose(found, by_difference, rtol=0.0, atol=2e-5 * scale)


@pytest.mark.parametrize("given", [0.0, 0.15])
def test_derivatives_by_a_slow_slip_are_those_of_differences(virtual: VirtualTest, given: float):
    values = {
        **VALUES,
        "clamp_slip.compliance": 0.01,
        "slow_slip_field.c0_1": given,
        "slow_slip_field.s1_2": 0.05,
        "clamp_shape.radius_error": 0.4,
    }
    names = ["clamp_slip.compliance", *(f"slow_slip_field.{n}" for n in ("c0_1", "c0_2", "s1_2"))]
    names += ["clamp_shape.radius_error", "E1"]
    here = virtual.predict(values, names)
    for name, derivative in zip(names, here.derivative, strict=True):
        step = {"clamp_slip.compliance": 1e-5, "E1": 0.1}.get(name, 1e-3)
        ends = [
            virtual.predict({**values, name: values.get(name, 0.0) + h}, near=here.shapes)
            for h in (step, -step)
        ]
        change = (ends[0].displacement - ends[1].displacement) / (2.0 * step)
        np.testing.assert_allclose(derivative, change, atol=2e-5 * np.abs(change).max())


def test_a_clamp_that_gives_by_one_step_still_has_its_derivative(virtual: VirtualTest):
    """One end of the difference is the null, where the clamp holds."""
    name = "slow_slip_field.c0_1"
    step = fields()["slow_slip_field"].parameter("c0_1").step
    at = virtual.predict({**VALUES, name: step}, [name])
    ends = [virtual.predict({**VALUES, name: k * step}) for k in (0.5, 1.5)]
    change = (ends[1].displacement - ends[0].displacement) / step
    assert np.abs(change).max() > 0.01
    np.testing.assert_allclose(at.derivative[0], change, atol=0.02 * np.abs(change).max())


def test_coupled_cloth_is_turned_cloth_to_first_order(virtual: VirtualTest):
    """Turning an orthotropic law by a small angle makes D13 and D23, and nothing else, to first
    order: D13 = a (D11 - D12 - 2 D33), D23 = a (D12 + 2 D33 - D22) of warp at -a."""
    turn = 1e-3
    e1, e2, g12 = (VALUES[name] for name in ("E1", "E2", "G12"))
    nu12 = virtual.test.poisson_ratio
    d11, d22, d12, d33 = orthotropic_stiffness(e1, e2, g12, nu12)
    d13, d23 = turn * (d11 - d12 - 2.0 * d33), turn * (d12 + 2.0 * d33 - d22)
    coupling = {"c_x": d13 / np.sqrt(e1 * g12), "c_y": d23 / np.sqrt(e2 * g12)}
    plain = virtual.predict(VALUES).displacement
    coupled, turned = (
        virtual.predict({**VALUES, **more}).displacement - plain
        for more in (
            {f"coupling_field.{name}": value for name, value in coupling.items()},
            {"axis_misalignment.angle": float(np.rad2deg(turn))},
        )
    )
    assert np.abs(coupled - turned).max() < 0.01 * np.abs(turned).max()


def test_a_rim_on_springs_is_pulled_at_their_ends(virtual: VirtualTest):
    """Hard springs do as a rim that is held; derivatives by both are those of differences."""
    stiff = {"clamp_slip.compliance": 2e-6}
    held = virtual.shapes({**VALUES, **SLIP})
    sprung = virtual.shapes({**VALUES, **SLIP, **stiff}, near=held)
    np.testing.assert_allclose(sprung.displacement, held.displacement, atol=3e-4)
    values = {**VALUES, **SLIP, **ALONG, "clamp_slip.compliance": 0.02, "lift_field.c2": 0.1}
    names = ["slip_field.c2_0", "slip_field.c0_1", "clamp_slip.compliance", "lift_field.c2"]
    names += ALONG
    here = virtual.predict(values, names, sprung)
    for name, derivative in zip(names, here.derivative, strict=True):
        step = 1e-3 if name == "clamp_slip.compliance" else 0.01
        ahead, behind = (
            virtual.predict({**values, name: values[name] + h}, near=here.shapes).displacement
            for h in (step, -step)
        )
        change = (ahead - behind) / (2.0 * step)
        np.testing.assert_allclose(derivative, change, atol=2e-3 * np.abs(change).max())


def test_a_gauge_that_errs_is_told_by_pressure():
    field, pressure = fields()["pressure_field"], np.linspace(0.01, 0.25, 9)
    found = field.sampled(own(field, s1=-0.02), 100.0, pressure)
    size, where = found.largest
    assert size == pytest.approx(-0.02 * np.sin(0.52 * np.pi))
    assert where == {"pressure_bar": pytest.approx(1.3)}


@pytest.mark.parametrize(("name", "missed"), [("bow", 0.01), ("walk", 0.35)])
def test_a_gauge_that_lags_or_walks_is_followed(name: str, missed: float):
    """A bow to a hundredth of its size, a random walk between its ends to a third of it.

    Six terms leave Σ 1/k² beyond 6 over all of a walk's variance, 0.093, the root of which is 0.31.
    """
    field, share = fields()["pressure_field"], np.linspace(0.005, 1.0, 200)
    names = [p.name for p in field.parameters]
    basis = np.stack([field.sampled(own(field, **{n: 1.0}), 100.0, share).values for n in names])
    walk = np.cumsum(np.random.default_rng(1).normal(size=(200, 200)), axis=1)
    errors = {"bow": (4.0 * share * (1.0 - share))[None], "walk": walk - share * walk[:, -1:]}
    left = errors[name] - np.linalg.lstsq(basis.T, errors[name].T)[0].T @ basis
    assert np.sqrt((left**2).mean() / (errors[name] ** 2).mean()) < missed


def test_frames_that_shift_are_told_by_their_size():
    field, pressure = fields()["frame_field"], np.linspace(0.01, 0.25, 9)
    found = field.sampled(own(field, z00_0=0.3, x00_0=0.4), 100.0, pressure)
    np.testing.assert_allclose(found.values, 0.5)


def test_frames_move_by_the_sum_of_their_terms(virtual: VirtualTest):
    """Each by itself: a power of x and y in one component, a cosine of pressure."""
    plain = virtual.predict(VALUES)
    terms = {"x00_0": 0.1, "y10_2": -0.2, "z11_5": 0.3, "z02_1": 0.05}
    own = {f"frame_field.{name}": value for name, value in terms.items()}
    moved = virtual.predict({**VALUES, **own}, near=plain.shapes)
    x, y = virtual.test.blocks[0].reference[:, :2].T / virtual.test.radius
    way = np.pi * virtual.recorded / virtual.recorded.max()
    expected = np.zeros_like(plain.displacement)
    expected[..., 0] = 0.1
    expected[..., 1] = -0.2 * np.outer(np.cos(2 * way), x)
    expected[..., 2] = 0.3 * np.outer(np.cos(5 * way), x * y) + 0.05 * np.outer(np.cos(way), y * y)
    np.testing.assert_allclose(moved.displacement - plain.displacement, expected, atol=1e-6)


def test_frames_with_points_of_their_own_move_by_the_same_pressures(virtual: VirtualTest):
    """By their share of the test's highest, not of the highest at which a point was seen."""
    (block,) = virtual.test.blocks
    alone = tuple(Block(block.reference, np.array([i]), block.displacement[[i]]) for i in range(3))
    apart = VirtualTest(replace(virtual.test, blocks=alone), virtual.setup)
    values = {**VALUES, "frame_field.z00_1": 0.1, "frame_field.x10_2": 0.2}
    together, shapes = virtual.predict(values).displacement, apart.shapes(values)
    seen = [apart.observe(shapes, block=i).displacement[0] for i in range(3)]
    np.testing.assert_allclose(seen, together, atol=1e-9)


def test_the_centre_moves_where_points_stand_under_a_turned_frame(virtual: VirtualTest):
    """The height that a point stands at is that of its place on the fabric."""
    values = {
        **VALUES, "initial_shape.h0": 4.0, "initial_shape.hx": 2.0,
        "rigid_motion.rotation_x": 0.8, "rigid_motion.rotation_y": -0.5,
    }  # fmt: skip
    names = ["registration.x0", "registration.y0"]
    found = virtual.predict(values, names)
    for name, derivative in zip(names, found.derivative, strict=True):
        ends = [{**values, name: step} for step in (-0.01, 0.01)]
        below, above = (virtual.predict(v, near=found.shapes).displacement for v in ends)
        np.testing.assert_allclose(derivative, (above - below) / 0.02, atol=2e-5)


def test_a_lift_of_a_rim_that_slides_moves_it_too(virtual: VirtualTest):
    """The load of an edge that is lifted has a skew part, which no tangent has."""
    values = {**VALUES, "clamp_slip.compliance": 0.03, "rim_lift.amplitude": 0.5}
    found = virtual.predict(values, ["rim_lift.amplitude"])
    ends = [{**values, "rim_lift.amplitude": 0.5 + step} for step in (-1e-3, 1e-3)]
    below, above = (virtual.predict(v, near=found.shapes).displacement for v in ends)
    difference = (above - below) / 2e-3
    miss = np.abs(found.derivative[0] - difference).max(axis=(0, 1))
    assert (miss < 5e-3 * np.abs(difference).max(axis=(0, 1))).all()


def test_a_drift_goes_with_the_time(virtual: VirtualTest):
    """Half a minute to the second frame, six more to the third."""
    plain = virtual.predict(VALUES)
    drifted = virtual.predict({**VALUES, "drift_field.x00_1": 0.4}, near=plain.shapes)
    moved = (drifted.displacement - plain.displacement)[:, :, 0]
    np.testing.assert_allclose(moved, np.array([[0.0], [0.02], [0.4]]) * np.ones(40), atol=1e-6)
    field = fields()["drift_field"]
    size, where = field.sampled(own(field, x00_1=0.4), 100.0, np.array([0.1])).largest
    assert (size, where) == (pytest.approx(0.4), {"time_share": 1.0})
