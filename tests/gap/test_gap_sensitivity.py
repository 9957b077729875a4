"""Every effect: exact derivative against differences, and definition and sign as documented."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.fem.clamp import LEAST_COMPLIANCE
from bulgefit.gap.effects import CATALOGUE
from bulgefit.gap.specimen import Specimen

MODULI = {"E1": 330.0, "E2": 200.0, "G12": 20.0}
#: One parameter set with every effect on, so that cross terms are tested too.
EVERYTHING = {
    **MODULI,
    "poisson_ratio.nu12": 0.3,
    "initial_shape.h0": 0.8,
    "initial_shape.hx": 0.3,
    "initial_shape.c4": 0.2,
    "clamp_shape.ellipticity": 0.004,
    "clamp_shape.radius_error": 0.003,
    "prestrain.slack_x": -0.002,
    "prestrain.slack_y": -0.001,
    "clamp_slip.compliance": 0.01,
    "axis_misalignment.angle": 4.0,
    "nonlinear_material.k_x": 1.5,
    "nonlinear_material.k_y": 0.5,
    "nonlinear_material.s_x": 0.4,
    "nonlinear_material.s_y": -0.2,
    "nonlinear_material.knee_x": 0.012,
    "nonlinear_material.knee_y": 0.018,
    "stiffness_gradient.g_x": 0.1,
    "stiffness_gradient.g_y": -0.05,
    "creep.rate": 0.03,
    "pressure_offset.offset": 0.02,
    "pressure_gain.gain": 0.01,
    "rigid_motion.rotation_y": 0.2,
    "rigid_motion.shift_z": 0.3,
    "fixture_motion.rotation_x": 0.1,
    "fixture_motion.shift_x": 0.1,
    "reference_state.z11": 0.2,
    "reference_state.flattening": 0.15,
    "registration.x0": 0.7,
    "dic_scale.scale": 0.004,
    "dic_smoothing.window": 4.0,
}
STEPS = {"mm": 1e-3, "1": 1e-5, "degree": 1e-3, "bar": 1e-4, "mm per N/mm": 1e-5}


@pytest.fixture(scope="module")
def specimen() -> Specimen:
    rng = np.random.default_rng(3)
    points = rng.uniform(-90, 90, (60, 3)) * [1, 1, 0.01]
    points = points[np.hypot(points[:, 0], points[:, 1]) < 92]
    pressure = np.array([0.02, 0.1, 0.2])
    test = BulgeTest.from_arrays(
        points, np.zeros((3, len(points), 3)), pressure, time=np.array([0.0, 30.0, 70.0])
    )
    return Specimen(test, refine=2)


def _keys() -> list[str]:
    keys = [*MODULI]
    for effect in CATALOGUE.values():
        if effect.id == "reference_state":
            keys += [f"reference_state.{name}" for name in ("x10", "z11", "flattening")]
        else:
            keys += effect.all_keys
    return keys


@pytest.fixture(scope="module")
def exact(specimen: Specimen) -> dict[str, np.ndarray]:
    keys = _keys()
    found = specimen.predict(EVERYTHING, keys)
    return dict(zip(keys, found.derivative, strict=True))


@pytest.mark.parametrize("key", _keys())
def test_derivative_is_that_of_differences(
    specimen: Specimen, exact: dict[str, np.ndarray], key: str
) -> None:
    if key in MODULI:
        step = 1e-3 * MODULI[key]
    else:
        effect, _, name = key.partition(".")
        (parameter,) = (p for p in CATALOGUE[effect].parameters if p.name == name)
        step = STEPS.get(parameter.unit, 1e-4)
    near = specimen.predict(EVERYTHING).shapes
    here = EVERYTHING.get(key, 0.0)
    window = key == "dic_smoothing.window"
    if window:  # enters as its square, averaged over a difference of the same span
        ends = np.sqrt(np.array([here**2 - 4.0, here**2 + 4.0]))
        span = 8.0
    else:
        ends, span = np.array([here - step, here + step]), 2 * step
    low, high = (specimen.predict({**EVERYTHING, key: v}, near=near).displacement for v in ends)
    difference = (high - low) / span
    size = np.abs(difference).max()
    assert size > 0
    miss = np.abs(exact[key] - difference)
    if key.startswith(("registration", "dic_scale", "clamp_shape")):
        # the nodes nearest a point may change on the way, and the field jumps by micrometres
        miss = miss[:, np.sort(np.argsort(miss.max(axis=(0, 2)))[:-2])]
    assert miss.max() < (2e-3 if window else 5e-4) * size


def test_a_clamp_that_does_not_slip_yet_may_begin_to(specimen: Specimen) -> None:
    """At the null, which stands for the least compliance of the springs, there is one side."""
    key = "clamp_slip.compliance"
    (exact,) = specimen.predict(MODULI, [key]).derivative
    step = 2e-5
    low, middle, high = (
        specimen.predict({**MODULI, key: LEAST_COMPLIANCE + c}).displacement
        for c in (0.0, 0.5 * step, step)
    )
    one_sided = (4.0 * middle - 3.0 * low - high) / step  # of second order
    np.testing.assert_allclose(exact, one_sided, atol=0.01 * np.abs(one_sided).max())


def _change(specimen: Specimen, **changed: float) -> np.ndarray:
    """Reported displacement with an effect, minus without it."""
    values = {**MODULI, **{k.replace("__", "."): v for k, v in changed.items()}}
    return specimen.predict(values).displacement - specimen.predict(MODULI).displacement


def test_offset_and_gain_are_recorded_over_true(specimen: Specimen) -> None:
    """Recorded pressure reads high: the fabric sees less and rises less."""
    centre = np.argmin(np.hypot(*specimen.reference[:, :2].T))
    assert (_change(specimen, pressure_offset__offset=0.02)[:, centre, 2] < 0).all()
    assert (_change(specimen, pressure_gain__gain=0.02)[:, centre, 2] < 0).all()
    shifted = Specimen(
        BulgeTest.from_arrays(
            specimen.reference,
            np.zeros((3, len(specimen.reference), 3)),
            (specimen.recorded - 0.002) / 1.03,
        ),
        refine=2,
    )
    with_effects = specimen.predict(
        {**MODULI, "pressure_offset.offset": 0.02, "pressure_gain.gain": 0.03}
    )
    np.testing.assert_allclose(
        with_effects.displacement, shifted.predict(MODULI).displacement, atol=1e-6
    )


def test_pressure_gain_is_a_gain_of_every_modulus(specimen: Specimen) -> None:
    stiffer = {k: 1.04 * v for k, v in MODULI.items()}
    np.testing.assert_allclose(
        specimen.predict({**MODULI, "pressure_gain.gain": 0.04}).displacement,
        specimen.predict(stiffer).displacement,
        atol=2e-5,  # the springs of the clamp that holds are not scaled
    )


def test_rigid_motion_moves_the_frame(specimen: Specimen) -> None:
    turn, shift = np.array([0.3, -0.2, 0.1]), np.array([0.1, 0.2, -0.3])
    values = {f"rigid_motion.rotation_{a}": t for a, t in zip("xyz", turn, strict=True)}
    values |= {f"rigid_motion.shift_{a}": s for a, s in zip("xyz", shift, strict=True)}
    plain = specimen.predict(MODULI).displacement
    rotation = Rotation.from_rotvec(turn, degrees=True)
    place = specimen.reference
    expected = np.stack([rotation.apply(place + u) + shift - place for u in plain])
    found = specimen.predict({**MODULI, **values}).displacement
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_fixture_moves_with_the_true_pressure(specimen: Specimen) -> None:
    load = {**MODULI, "pressure_offset.offset": 0.02, "pressure_gain.gain": 0.03}
    moved = specimen.predict({**load, "fixture_motion.shift_x": 0.1}).displacement
    found = moved - specimen.predict(load).displacement
    expected = 0.1 * (10.0 * specimen.recorded - 0.02) / 1.03
    np.testing.assert_allclose(
        found[..., 0], np.broadcast_to(expected[:, None], found.shape[:2]), atol=1e-12
    )


def test_reference_state_is_taken_off(specimen: Specimen) -> None:
    x = specimen.reference[:, 0] / 100.0
    found = _change(specimen, reference_state__z10=0.5)
    np.testing.assert_allclose(found[..., 2], np.broadcast_to(-0.5 * x, found.shape[:2]), atol=1e-9)


def test_pressure_flattens_the_reference_state(specimen: Specimen) -> None:
    """Half of it is gone at the flattening pressure."""
    whole = _change(specimen, reference_state__z10=0.5)
    part = _change(specimen, reference_state__z10=0.5, reference_state__flattening=0.2)
    share = np.array([1 / 2, 5 / 6, 10 / 11])  # at 0.2, 1 and 2 bar
    np.testing.assert_allclose(part, share[:, None, None] * whole, atol=1e-9)


def test_slack_raises_and_pretension_lowers_the_dome(specimen: Specimen) -> None:
    centre = np.argmin(np.hypot(*specimen.reference[:, :2].T))
    slack = _change(specimen, prestrain__slack_x=0.002, prestrain__slack_y=0.002)
    tense = _change(specimen, prestrain__slack_x=-0.002, prestrain__slack_y=-0.002)
    assert (slack[:, centre, 2] > 0).all()
    assert (tense[:, centre, 2] < 0).all()


def test_slip_moves_the_rim_inwards_by_compliance_times_traction() -> None:
    test = BulgeTest.from_arrays(np.zeros((1, 3)), np.zeros((1, 1, 3)), [0.2])
    specimen = Specimen(test, refine=2)
    values = {**MODULI, "clamp_slip.compliance": 0.02}
    shapes = specimen.shapes(values)
    membrane = specimen.membrane(shapes.values)
    assert membrane.clamp is not None
    rim, radial = membrane.mesh.rim, membrane.clamp.radial
    moved = (shapes.displacement[0, rim, :2] * radial).sum(axis=1)
    held = membrane.clamp.length  # mm of rim a node stands for
    membrane.clamp.stiffness[:] = 0.0  # the fabric's pull alone
    stiffness = np.array([*_stiffness(values)])
    pull = membrane.state(shapes.displacement[0], 0.2, stiffness, tangent=False).reaction
    traction = (pull[rim, :2] * radial).sum(axis=1) / held
    assert traction.min() > 0
    np.testing.assert_allclose(moved, -0.02 * traction, rtol=1e-5)


def _stiffness(values: dict[str, float]) -> np.ndarray:
    from bulgefit.fem.elasticity import orthotropic_stiffness

    return orthotropic_stiffness(values["E1"], values["E2"], values["G12"], 0.24)


def test_oval_clamp_is_longer_along_x(specimen: Specimen) -> None:
    from bulgefit.model.places import reference_surface

    surface = reference_surface(specimen.mesh, 100.0, {"clamp_shape.ellipticity": 0.01})
    assert surface[:, 0].max() == pytest.approx(101.0)
    assert surface[:, 1].max() == pytest.approx(99.0)


def test_axes_turn_counter_clockwise(specimen: Specimen) -> None:
    """Turned by 90°, warp lies along y: the moduli change places."""
    turned = specimen.predict({**MODULI, "axis_misalignment.angle": 90.0})
    swapped = specimen.predict(
        {"E1": 200.0, "E2": 330.0, "G12": 20.0, "poisson_ratio.nu12": 0.24 * 200 / 330}
    )
    np.testing.assert_allclose(turned.displacement, swapped.displacement, atol=1e-6)
    few = _change(specimen, axis_misalignment__angle=5.0)
    mirrored = _change(specimen, axis_misalignment__angle=-5.0)
    assert np.abs(few - mirrored).max() > 1e-3
