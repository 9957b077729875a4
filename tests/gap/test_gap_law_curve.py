"""A law that no catalogue has: the curve follows it, and is weighed against the laws with names."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from bulgefit.effects.parameter import Owned
from bulgefit.effects.registry import acting
from bulgefit.fem.laws.potential import KNOTS
from bulgefit.gap.data import Data
from bulgefit.gap.evidence.coordinates import Coordinates
from bulgefit.gap.evidence.descend import Fit, descend
from bulgefit.gap.evidence.outcome import regression_of
from bulgefit.gap.evidence.problem import Layout, freeze
from bulgefit.gap.evidence.weighing import Weighing
from bulgefit.gap.law_table import LawTable, law_table
from bulgefit.gap.level import Level

MODULI = {"E1": 500.0, "E2": 210.0, "G12": 20.0}
#: The warp starts stiff, softens and stiffens again; the fill starts soft.
SLOPES = {
    "warp": (0.0, -0.15, -0.6, -0.5, -0.1, 0.3, 0.3),
    "fill": (0.0, 0.2, 0.3, 0.4, 0.3, 0.3, 0.3),
}


def changes(slopes: Mapping[str, tuple[float, ...]]) -> dict[str, float]:
    return {
        f"law_curve.{axis}_{k}": float(change)
        for axis, logs in slopes.items()
        for k, change in enumerate(np.diff(logs), start=1)
    }


def fitted(data: Data, effect: str) -> tuple[Fit, LawTable]:
    """The largest form of one effect, freed beside the moduli."""
    coordinates = Coordinates.of([acting()[effect]], [data.specimen.nulls()])
    layout = Layout.of(coordinates.groups)
    start = np.array(layout.null)
    start[:3] = np.log([*MODULI.values()])
    weighing = Weighing([data], coordinates)
    form = len(layout.groups[Owned(effect)].shapes) - 1
    fit = descend(weighing, layout, freeze({Owned(effect): form}), start)
    return fit, law_table([data], regression_of(weighing, fit), Level())


@pytest.fixture(scope="module")
def kinked(made_by_the_model: Callable[..., Data]) -> Data:
    return made_by_the_model({**MODULI, **changes(SLOPES)}, 15.0, 8, 2)


def true_law(axis: int, strain: np.ndarray) -> np.ndarray:
    """t ∫ E s de of slopes E s that are linear between the knots."""
    modulus, logs = [*MODULI.values()][axis], [*SLOPES.values()][axis]
    fine = np.linspace(0.0, strain.max(), 60001)
    slope = modulus * np.interp(fine, KNOTS, np.exp(logs))
    stress = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(fine))])
    return 0.81 * np.interp(strain, fine, stress)


def test_the_curve_is_met_within_its_errors(kinked: Data) -> None:
    _, table = fitted(kinked, "law_curve")
    told = (table.strain >= 0.01) & (table.strain <= 0.05)
    for axis in (0, 1):
        true = true_law(axis, table.strain)
        off = np.abs(table.resultant[axis] - true)
        assert (off < 4.0 * table.stderr[axis])[told].all()
        assert (off < 0.02 * true)[told].all()
        assert (table.stderr[axis] < 0.02 * true)[told].all()
        assert (np.diff(table.resultant[axis]) > 0.0).all()


def test_knees_and_gains_do_not_reach_it(kinked: Data) -> None:
    """A true law of a visible size has hundreds on the scale of -2 ln Z."""
    curve, _ = fitted(kinked, "law_curve")
    named, _ = fitted(kinked, "nonlinear_material")
    assert named.score - curve.score > 100.0


def test_a_gain_is_told_by_its_name(made_by_the_model: Callable[..., Data]) -> None:
    """Where the simple law is true it has more evidence; the curve follows it all the same."""
    gains = {"nonlinear_material.k_x": 3.0, "nonlinear_material.k_y": 2.0}
    data = made_by_the_model({**MODULI, **gains}, 15.0, 8, 3)
    curve, table = fitted(data, "law_curve")
    coordinates = Coordinates.of([acting()["nonlinear_material"]], [data.specimen.nulls()])
    layout = Layout.of(coordinates.groups)
    start = np.array(layout.null)
    start[:3] = np.log([*MODULI.values()])
    gain = descend(
        Weighing([data], coordinates), layout, freeze({Owned("nonlinear_material"): 0}), start
    )
    assert curve.score - gain.score > 5.0
    strain = table.strain[table.strain <= 0.05]
    for axis, modulus in enumerate(("E1", "E2")):
        k = [*gains.values()][axis]
        true = 0.81 * MODULI[modulus] * (strain + k * strain**2)
        np.testing.assert_allclose(table.resultant[axis][: len(strain)], true, rtol=0.02)
