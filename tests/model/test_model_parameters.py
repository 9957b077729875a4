"""Materials: admissible or refused by name, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from bulgefit.errors import InputError
from bulgefit.fem.elasticity import orthotropic_stiffness_derivative
from bulgefit.model.parameters import MATERIALS, Material, free_parameters, material

EXAMPLES = {
    "orthotropic": {"E1": 303.0, "E2": 229.0, "G12": 5.0, "nu12": 0.24},
    "isotropic": {"E": 250.0, "nu": 0.3},
    "isotropic-EG": {"E": 250.0, "G": 100.0},
}


def test_orthotropic_stiffness_by_hand() -> None:
    d11, d22, d12, d33 = material("orthotropic", E1=200, E2=100, G12=7, nu12=0.4).stiffness()
    shrink = 1 / (1 - 0.4 * 0.2)
    np.testing.assert_allclose(
        [d11, d22, d12, d33], [200 * shrink, 100 * shrink, 40 * shrink, 7], rtol=1e-14
    )


def test_isotropic_kinds_are_the_same_material() -> None:
    by_ratio = material("isotropic", E=250, nu=0.25)
    by_shear = material("isotropic-EG", E=250, G=100)
    full = material("orthotropic", E1=250, E2=250, G12=100, nu12=0.25)
    np.testing.assert_allclose(by_ratio.stiffness(), full.stiffness(), rtol=1e-14)
    np.testing.assert_allclose(by_shear.stiffness(), full.stiffness(), rtol=1e-14)


@pytest.mark.parametrize("kind", MATERIALS)
def test_derivative_of_the_stiffness(kind: str) -> None:
    given = EXAMPLES[kind]
    made = material(kind, **given)
    by_constants = orthotropic_stiffness_derivative(*made.constants().values())
    exact = by_constants @ made.constants_derivative()
    for j, (name, value) in enumerate(given.items()):
        h = 1e-5 * value
        high = material(kind, **given | {name: value + h}).stiffness()
        low = material(kind, **given | {name: value - h}).stiffness()
        np.testing.assert_allclose(exact[:, j], (high - low) / (2 * h), rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "change", "said"),
    [
        ("orthotropic", {"G12": 0.0}, "G12 must be positive"),
        ("orthotropic", {"E1": -1.0}, "E1 must be positive"),
        ("orthotropic", {"E1": 1.0, "nu12": 0.4}, "E1/E2 must exceed nu12²"),
        ("orthotropic", {"E2": np.nan}, "E2 must be positive"),
        ("isotropic", {"nu": 0.5}, "nu must lie in 0 <= nu < 0.5"),
        ("isotropic", {"nu": -0.1}, "nu must lie in 0 <= nu < 0.5"),
        ("isotropic-EG", {"G": 83.0}, "nu = E/2G - 1"),
        ("isotropic-EG", {"G": 126.0}, "nu = E/2G - 1"),
    ],
)
def test_what_is_not_admissible_is_refused_by_name(
    kind: str, change: dict[str, float], said: str
) -> None:
    with pytest.raises(InputError) as refused:
        material(kind, **EXAMPLES[kind] | change)
    assert said in str(refused.value)


def test_admissible_limits_are_accepted() -> None:
    material("isotropic", E=250, nu=0.0)
    material("isotropic-EG", E=250, G=125)
    material("orthotropic", E1=20, E2=300, G12=1, nu12=0.25)  # 0.0667 > 0.0625


def test_missing_and_unknown_parameters_are_named() -> None:
    with pytest.raises(InputError, match=r"missing: G12, nu12; unknown: E"):
        material("orthotropic", E1=1, E2=1, E=3)
    with pytest.raises(InputError, match=r"'steel' is unknown"):
        material("steel")


def test_free_parameters_and_their_bounds() -> None:
    assert [p.name for p in free_parameters("orthotropic")] == ["E1", "E2", "G12"]
    assert [p.name for p in free_parameters("orthotropic", ["nu12"])] == ["E1", "E2", "G12", "nu12"]
    assert [p.name for p in free_parameters("isotropic")] == ["E"]
    assert [p.name for p in free_parameters("isotropic-EG")] == ["E", "G"]
    found = free_parameters("orthotropic", bounds={"G12": (3, 4)})
    assert [(p.lower, p.upper) for p in found] == [(100, 400), (50, 300), (3, 4)]
    held = free_parameters("orthotropic", ["nu12"], {"E1": (200, 200), "nu12": (0.3, 0.3)})
    assert [p.name for p in held] == ["E2", "G12"]


@pytest.mark.parametrize(
    ("free", "bounds", "said"),
    [
        ([], {"E1": (300, 200)}, "bounds of E1 are reversed: 300:200"),
        ([], {"E1": (-200, -200)}, "bounds of E1 must be positive"),
        ([], {"E1": (0, 200)}, "bounds of E1 must be positive"),
        ([], {"E1": (1, np.inf)}, "bounds of E1 must be finite"),
        ([], {"E": (1, 2)}, "'E' is no parameter of orthotropic"),
        ([], {"nu12": (0, 0.3)}, "nu12 is held fixed; free it to bound it"),
        (["nu"], {}, "'nu' is no parameter of orthotropic"),
    ],
)
def test_bounds_that_cannot_be(free: list[str], bounds: dict, said: str) -> None:
    with pytest.raises(InputError) as refused:
        free_parameters("orthotropic", free, bounds)
    assert said in str(refused.value)


def test_a_material_that_is_not_checked_fails_when_it_is_used() -> None:
    with pytest.raises(InputError, match="E1/E2"):
        Material("orthotropic", {"E1": 10.0, "E2": 300.0, "G12": 5.0, "nu12": 0.4}).stiffness()
