"""Where fits of freed effects start: a knee of the material is found from either side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bulgefit.effects.parameter import Key
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI, SHEAR
from bulgefit.gap.regress import regress

KNEE = CATALOGUE["nonlinear_material"].groups()[1]
MATERIAL = {"E1": 340.0, "E2": 210.0, "G12": 14.0}


def keys(*names: str) -> tuple[Key, ...]:
    """Of names."""
    return tuple(Key.of(name) for name in names)


def keyed(values: dict[str, float]) -> dict[Key, float]:
    """The same by keys."""
    return {Key.of(name): value for name, value in values.items()}


@pytest.mark.parametrize("change", [(-0.6, -0.4), (0.9, 0.6)], ids=["softer", "stiffer"])
def test_a_knee_is_found_from_either_side(
    made_by_the_model: Callable[..., Data], change: tuple[float, float]
) -> None:
    truth = {**MATERIAL, **dict(zip(KNEE, (*change, 0.011, 0.016), strict=True))}
    data = [made_by_the_model(truth, spacing=12.0, frames=10, seed=3)]
    near = dict(zip(KNEE, (*np.sign(change) * 0.3, 0.015, 0.015), strict=True))
    fit = regress(data, (*MODULI, *keys(*KNEE)), keyed({**MATERIAL, **near}))
    assert fit.converged
    assert fit.values == pytest.approx(keyed(truth), rel=0.1)
    assert fit.normal.whole.square < 1.05 * fit.floor


def test_a_valley_of_equal_products_is_followed(
    made_by_the_model: Callable[..., Data],
) -> None:
    """Far along the valley where E(1 + s), the slope past a knee at little strain, is the same."""
    gains, knees, both = CATALOGUE["nonlinear_material"].groups()
    slack = CATALOGUE["prestrain"].names
    truth = {"E1": 402.0, "E2": 159.0, "G12": 17.2}
    truth |= dict(zip((*gains, *slack), (1.6, 4.3, -0.0044, 0.0061), strict=True))
    data = [made_by_the_model(truth, spacing=12.0, frames=12, seed=3)]
    off = {"E1": 565.0, "E2": 148.0, "G12": 14.0}
    off |= dict(zip((*gains, *slack), (1.33, 4.26, -0.0029, 0.0057), strict=True))
    off |= dict(zip(knees, (-0.3, 0.146, 0.004, 0.0072), strict=True))
    fit = regress(data, (*MODULI, *keys(*both, *slack)), keyed(off), iterations=6)
    assert fit.values[MODULI[0]] == pytest.approx(402.0, rel=0.1)
    assert fit.normal.whole.square < 1.03 * fit.floor


def test_steps_end_at_what_is_plausible(made_by_the_model: Callable[..., Data]) -> None:
    """A slope that grows more than plausible: steps in logarithms do not leap over the edge."""
    s_x, _, knee_x, _ = KNEE
    data = [made_by_the_model({**MATERIAL, s_x: 6.0, knee_x: 0.02}, 12.0, 8, seed=3)]
    fit = regress(data, (*MODULI, *keys(s_x)), keyed({**MATERIAL, s_x: 0.3, knee_x: 0.02}))
    assert fit.values[Key.of(s_x)] == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize(("slip", "held"), [(0.02, True), (0.0, False)])
def test_a_shear_modulus_held_by_stability_is_told(
    made_by_the_model: Callable[..., Data], slip: float, held: bool
) -> None:
    """The moduli of a fabric that slips: a softer shear would fit better, and lose stability."""
    truth = {**MATERIAL, "G12": 16.0, "clamp_slip.compliance": slip}
    data = [made_by_the_model(truth, spacing=12.0, frames=10, seed=3)]
    fit = regress(data, MODULI, keyed(MATERIAL))
    assert fit.held is held
    assert (fit.values[SHEAR] < 11.0) == held
