"""A strip that is pulled: against closed forms, and the energy of a membrane that is pulled."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.laws import LAWS
from bulgefit.fem.membrane import Fabric, Membrane
from bulgefit.fem.mesh import rectangle
from bulgefit.fem.uniaxial import uniaxial

STIFFNESS = orthotropic_stiffness(330.0, 200.0, 16.0, 0.24)
STRAIN = np.array([0.0, 0.004, 0.015, 0.03, 0.05])


def test_hencky_pulls_with_its_modulus_and_gain() -> None:
    """Across the pull the fabric is compressed, where stress gains nothing."""
    q = Fabric(gain=(3.0 * 330.0, 1.5 * 200.0)).law_parameters(STIFFNESS)
    for axis, modulus, gain in ((0, 330.0, 3.0), (1, 200.0, 1.5)):
        found = uniaxial(LAWS["hencky"], q, STRAIN, axis)
        np.testing.assert_allclose(
            found, modulus * (STRAIN + gain * STRAIN**2), rtol=1e-10, atol=1e-15
        )


@pytest.mark.parametrize(("k", "s"), [(-8.0, 0.0), (-8.0, -0.9), (-2.0, 3.0)])
def test_a_gain_that_softens_leaves_a_slope(k: float, s: float) -> None:
    """A tenth of what the bend leaves, at any strain; before that the gain is k E e²."""
    fabric = Fabric(gain=(k * 330.0, 0.0), bend=(s * 330.0, 0.0), knee=(0.01, 0.01))
    q = fabric.law_parameters(STIFFNESS)
    strain = np.linspace(0.0, 0.6, 2401)
    found = uniaxial(LAWS["hencky"], q, strain, 0)
    left = 330.0 * (1.0 + min(s, 0.0))
    assert (np.diff(found) / np.diff(strain)).min() >= 0.0999 * left
    early = strain < 0.45 * (1.0 + min(s, 0.0)) / -k
    e = strain[early]
    bent = s * (e - 0.01 * np.arctan(e / 0.01))
    np.testing.assert_allclose(found[early], 330.0 * (e + k * e**2 + bent), rtol=1e-9, atol=1e-12)


def test_svk_pulls_with_its_modulus_by_greens_strain() -> None:
    """S = E ε, and ∂W/∂e = S C by the logarithmic strain."""
    q = Fabric().law_parameters(STIFFNESS)
    c = np.exp(2.0 * STRAIN)
    found = uniaxial(LAWS["svk"], q, STRAIN, 1)
    np.testing.assert_allclose(found, 200.0 * 0.5 * (c - 1.0) * c, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("law", ["hencky", "svk", "yarn"])
def test_a_strip_narrows_until_its_energy_is_least(law: str) -> None:
    """Its slope is the pull then, by differences of the membrane's energy."""
    fabric = Fabric(gain=(900.0, 300.0), curve=np.array([[0.2, 0.0, -0.3, 0.1, 0.4, 0.4, 0.4]] * 2))
    q = fabric.law_parameters(STIFFNESS)
    mesh = rectangle((0.0, 10.0), (0.0, 10.0), 2, 2)
    strip = Membrane(mesh, 0.81, law, fabric=fabric, relaxation=False)
    for axis in (0, 1):

        def energy(along: float, across: float, axis: int = axis) -> float:
            strains = np.array([along, across] if axis == 0 else [across, along])
            plane = mesh.nodes * (np.exp(strains) - 1.0)
            moved = np.column_stack([plane, np.zeros(len(plane))])
            return strip.state(moved, 0.0, STIFFNESS, tangent=False).potential

        least = minimize_scalar(
            lambda e, energy=energy: energy(0.03, e), (-0.02, 0.0), options={"xtol": 1e-9}
        ).x
        step = 1e-5
        slope = (energy(0.03 + step, least) - energy(0.03 - step, least)) / (2.0 * step)
        (pull,) = uniaxial(LAWS[law], q, np.array([0.03]), axis)
        assert slope / (0.81 * 100.0) == pytest.approx(pull, rel=1e-6)
