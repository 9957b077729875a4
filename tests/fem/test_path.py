"""Is the dense output right between the levels, and its derivative exact?"""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from bulgefit.errors import InputError, SolveError
from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.equilibrium import solve
from bulgefit.fem.membrane import Membrane
from bulgefit.fem.mesh import disc
from bulgefit.fem.path import linear_interpolation_bound
from bulgefit.fem.trace import trace

LEVELS = np.linspace(0.001, 3.0, 200) / 10
CONSTANTS = (303.0, 229.0, 5.0, 0.24)


@pytest.mark.parametrize(
    "constants", [CONSTANTS, (200.0, 180.0, 6.0, 0.24), (200.0, 300.0, 6.0, 0.24),
                  (400.0, 300.0, 6.0, 0.24), (343.0, 248.0, 4.7, 0.24)]
)  # fmt: skip
def test_dense_output_at_the_study_levels(constants: tuple[float, ...]) -> None:
    stiffness = orthotropic_stiffness(*constants)
    membrane = Membrane(disc(), 0.81)
    path = trace(membrane, stiffness)
    shapes = path(LEVELS)
    errors = [
        np.abs(solve(membrane, shape, p, stiffness, follow=True).displacement - shape).max()
        for shape, p in zip(shapes[::9], LEVELS[::9], strict=True)
    ]
    assert max(errors) < 1e-3
    assert path.error_estimate < 1e-3
    assert path.factorisations <= 30


@pytest.mark.parametrize("g12", [2.0, 6.0])
@pytest.mark.parametrize("e2", [180.0, 300.0])
@pytest.mark.parametrize("e1", [200.0, 400.0])
def test_corners_of_the_study_bounds(e1: float, e2: float, g12: float) -> None:
    mesh = disc()
    path = trace(Membrane(mesh, 0.81), orthotropic_stiffness(e1, e2, g12, 0.24))
    assert 36.0 < path(0.3)[0, mesh.apex, 2] < 49.0


def test_sensitivities_are_the_dense_outputs_derivative() -> None:
    membrane = Membrane(disc(100.0, 3), 0.81)
    stiffness = orthotropic_stiffness(*CONSTANTS)
    pressures = np.array([0.001, 0.01, 0.07, 0.15, 0.22, 0.29])
    path = trace(membrane, stiffness, tolerance=1e-4, sensitivities=True)
    found = path.stiffness_sensitivity(pressures)
    for k in range(4):
        h = 1e-4 * stiffness[k]
        above, below = (
            trace(membrane, stiffness + sign * h * np.eye(4)[k], tolerance=1e-7)(pressures)
            for sign in (1, -1)
        )
        expected = (above - below) / (2 * h)
        for i in range(len(pressures)):
            scale = np.abs(expected[i]).max()
            np.testing.assert_allclose(found[k, i], expected[i], rtol=0, atol=1e-4 * scale)


def test_sensitivities_are_those_of_the_balanced_shapes() -> None:
    """Also where the tangent is nearly singular, so that it changes fast."""
    membrane = Membrane(disc(), 0.81)
    stiffness = orthotropic_stiffness(300.0, 220.0, 1.5, 0.24)
    path = trace(membrane, stiffness, sensitivities=True)
    assert path.sensitivity is not None
    for shape, p, found in zip(path.displacement, path.pressure, path.sensitivity, strict=True):
        tangent = membrane.state(shape, p, stiffness).tangent
        assert tangent is not None
        left = membrane.stiffness_force(shape, stiffness)
        left += membrane.tangent_product(shape, p, stiffness, found)
        error = membrane.linear.factorise_indefinite(tangent).solve(left.T)
        assert np.abs(error).max() < 1e-6 * np.abs(found).max()


def test_linear_interpolation_and_its_bound() -> None:
    path = trace(Membrane(disc(100.0, 2), 0.81), orthotropic_stiffness(*CONSTANTS), tolerance=1e-5)
    middle = 0.5 * (LEVELS[:-1] + LEVELS[1:])
    at_levels = path(LEVELS)
    linear = path.linear(middle, LEVELS)
    np.testing.assert_allclose(linear, 0.5 * (at_levels[:-1] + at_levels[1:]), atol=1e-12)
    error = np.abs(linear - path(middle)).max(axis=(1, 2))
    bound = linear_interpolation_bound(path, LEVELS)
    assert (error[1:] <= 1.001 * bound[1:]).all()
    assert (error[1:] >= 0.3 * bound[1:])[5:].all()  # and it is no empty bound
    with pytest.raises(InputError, match="outside the levels"):
        path.linear([0.31], LEVELS)


def test_blown_up_and_down_again() -> None:
    """A cycle of inflation ends where it began: nothing artificial stays in the shape."""
    membrane = Membrane(disc(100.0, 2), 0.81)
    stiffness = orthotropic_stiffness(*CONSTANTS)
    start = trace(membrane, stiffness, (0.05, 0.05)).displacement[0]
    shape = start
    for p in (0.1, 0.2, 0.1, 0.05):
        shape = solve(membrane, shape, p, stiffness).displacement
    np.testing.assert_allclose(shape, start, atol=1e-7)


def test_limit_pressure_is_named() -> None:
    soft = orthotropic_stiffness(3.0, 3.0, 3.0 / 2.6, 0.3)
    with pytest.raises(SolveError) as caught:
        trace(Membrane(disc(100.0, 2), 0.81), soft, parameters={"E": 3.0, "nu": 0.3})
    error = caught.value
    assert 0.12 < 10 * error.reached < 0.125
    assert error.pressure > error.reached
    assert np.isfinite(error.residual_norm)
    assert error.parameters == {"E": 3.0, "nu": 0.3}
    assert f"{10 * error.reached:.6g} bar" in str(error)
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error)
    assert copy.__dict__ == error.__dict__


@pytest.mark.parametrize("pressure", [(0.0, 0.3), (0.3, 0.1), (-0.1, 0.1), (0.1, np.inf)])
def test_pressures_out_of_order(pressure: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="pressures must satisfy"):
        trace(Membrane(disc(100.0, 1), 0.81), orthotropic_stiffness(*CONSTANTS), pressure)


def test_pressure_outside_the_path() -> None:
    path = trace(Membrane(disc(100.0, 1), 0.81), orthotropic_stiffness(*CONSTANTS), (0.01, 0.02))
    with pytest.raises(InputError, match="outside the traced range"):
        path(0.03)


def test_slopes_are_the_paths_derivative() -> None:
    """Whatever shape the factor belongs to that they were found with."""
    membrane = Membrane(disc(100.0, 2), 0.81)
    stiffness = orthotropic_stiffness(*CONSTANTS)
    path = trace(membrane, stiffness)
    for k, s in enumerate(np.cbrt(path.pressure)):
        h = 1e-3 * s
        above, below = (
            solve(
                membrane, path.displacement[k] + step * path.slope[k], (s + step) ** 3, stiffness
            ).displacement
            for step in (h, -h)
        )
        expected = (above - below) / (2 * h)
        np.testing.assert_allclose(
            path.slope[k], expected, rtol=0, atol=1e-4 * np.abs(expected).max()
        )


def test_a_factor_that_serves_longer_gives_the_same_shape() -> None:
    membrane = Membrane(disc(100.0, 2), 0.81)
    stiffness = orthotropic_stiffness(*CONSTANTS)
    start = trace(membrane, stiffness)(0.2)[0]
    sparing, renewed = (
        solve(membrane, start, 0.201, stiffness, thrifty=thrifty) for thrifty in (True, False)
    )
    assert sparing.factorisations < renewed.factorisations
    np.testing.assert_allclose(sparing.displacement, renewed.displacement, rtol=0, atol=1e-8)
