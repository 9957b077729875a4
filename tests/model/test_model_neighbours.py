"""Shapes found from a neighbour's: are they the same, and as soon found whatever the nulls are?"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.errors import SolveError
from bulgefit.fem.equilibrium import NewtonError
from bulgefit.fem.membrane import Membrane
from bulgefit.model.description import active_effects, null_values, with_value
from bulgefit.model.inflation import Shapes
from bulgefit.model.setup import Setup
from bulgefit.model.virtual_test import VirtualTest

MODULI = {"E1": 320.0, "E2": 210.0, "G12": 20.0}
#: Parameters whose null is not zero, and the one that balances frame by frame.
NAMES = ("prestrain.slack_x", "specimen_factor.warp", "specimen_factor.fill", "poisson_ratio.nu12")
MOVED = {
    "prestrain.slack_x": 1e-5,
    "specimen_factor.warp": 0.9999,
    "specimen_factor.fill": 1.0001,
    "poisson_ratio.nu12": 0.2401,
}


def plain() -> VirtualTest:
    at = np.array([[0.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
    test = BulgeTest.from_arrays(at, np.zeros((2, 2, 3)), [0.1, 0.2], poisson_ratio=0.24)
    return VirtualTest(test, Setup(refine=3, correct_mesh=False))


@pytest.mark.parametrize("there_and_back", [False, True])
def test_what_is_not_named_stands_at_its_null(
    there_and_back: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The start is off by second order alone: no frame needs more than one factorisation."""
    from bulgefit.model import frame

    virtual, spent = plain(), []
    solve = frame.solve

    def counted(*args, **more):  # type: ignore[no-untyped-def]
        found = solve(*args, **more)
        spent.append(found.factorisations)
        return found

    here = {**MODULI, "prestrain.slack_x": 2e-5, **(MOVED if there_and_back else {})}
    there = {**MODULI, **({"prestrain.slack_x": 2e-5} if there_and_back else MOVED)}
    near = virtual.shapes(here, NAMES)
    monkeypatch.setattr(frame, "solve", counted)
    found = virtual.shapes(there, near=near)
    assert spent == [1, 1]
    afresh = virtual.shapes(there)
    np.testing.assert_allclose(found.displacement, afresh.displacement, atol=1e-7)


def test_a_shape_is_found_once_whatever_it_is_differentiated_by(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From all sides of a lift that is none: to the last bit as it is found each time."""
    from bulgefit.model import frame

    virtual, solved = plain(), []
    solve = frame.solve

    def counted(*args, **more):  # type: ignore[no-untyped-def]
        solved.append(args[2])
        return solve(*args, **more)

    near = virtual.shapes({**MODULI, "prestrain.slack_x": 2e-5})
    sides = [{**near.values, "rim_lift.direction": angle} for angle in (0.0, 90.0, 180.0)]
    each = [virtual.shapes(side, ["rim_lift.amplitude"], near) for side in sides]
    monkeypatch.setattr(frame, "solve", counted)
    with virtual.inflation.remembering():
        found = [virtual.shapes(side, ["rim_lift.amplitude"], near) for side in sides]
        assert solved == [0.1, 0.2]
        for one, other in zip(found, each, strict=True):
            np.testing.assert_array_equal(one.displacement, other.displacement)
            by, otherwise = one.derivative, other.derivative
            np.testing.assert_array_equal(by["rim_lift.amplitude"], otherwise["rim_lift.amplitude"])
        virtual.shapes({**sides[0], "E1": 321.0}, near=near)
        assert len(solved) == 4
        # from the very guess, of another cloth
        stiffer = {**sides[0], "E1": 322.0}
        virtual.shapes(stiffer, near=replace(near, values=stiffer))
        virtual.shapes(sides[0], near=near)
        assert len(solved) == 8
    virtual.shapes(sides[0], near=near)
    assert len(solved) == 10


def test_a_shape_without_derivatives_is_an_error_with_its_state(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Wrinkles of a law that softens may have none: a descent goes on from elsewhere."""

    def none(*args: Any, **more: Any) -> np.ndarray:
        raise ArithmeticError("sensitivity asked for at a collapsed shape")

    monkeypatch.setattr(Membrane, "law_changes", none)
    with pytest.raises(SolveError, match="no derivatives") as caught:
        plain().shapes({**MODULI, "prestrain.slack_x": 2e-5}, NAMES)
    assert caught.value.pressure == 0.1
    assert caught.value.parameters["E1"] == MODULI["E1"]


def test_a_frame_without_balance_says_how_far_others_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of two frames at 1 and 2 bar the second fails."""
    from bulgefit.model import frame

    solve = frame.solve

    def no_more(membrane, guess, pressure, *args, **more):  # type: ignore[no-untyped-def]
        if pressure > 0.15:
            raise NewtonError("no step makes progress", 7, 0.5, 9)
        return solve(membrane, guess, pressure, *args, **more)

    monkeypatch.setattr(frame, "solve", no_more)
    with pytest.raises(SolveError, match="equilibrium was reached up to 1 bar;") as caught:
        plain().shapes({**MODULI, "prestrain.slack_x": 2e-5})
    assert (caught.value.pressure, caught.value.reached) == (0.2, 0.1)
    assert (caught.value.iteration, caught.value.residual_norm) == (7, 0.5)


def test_a_path_that_another_thread_takes_meanwhile_is_not_taken_for_ones_own() -> None:
    """The path that is kept is replaced between two looks at it."""
    virtual = plain()
    soft = virtual.shapes({**MODULI, "E1": 200.0}).displacement
    virtual.shapes(MODULI)
    inflation = virtual.inflation
    kept = inflation._path
    other = plain()
    other.shapes({**MODULI, "E1": 200.0})

    class Other:
        """Of the other specimen, as soon as the first of its parts was looked at."""

        def __getitem__(self, index: int) -> Any:
            inflation._path = other.inflation._path
            return kept[index]

    inflation._path = Other()  # type: ignore[assignment]
    found = virtual.shapes(MODULI).displacement
    np.testing.assert_array_equal(found, plain().shapes(MODULI).displacement)
    assert np.abs(found - soft).max() > 0.1


def test_a_difference_by_a_modulus_keeps_it_above_zero() -> None:
    virtual = plain()
    for modulus in MODULI:
        low, high = virtual.span(modulus, {**MODULI, modulus: 1e-6})
        assert 0.0 < low < 1e-6 < high
    assert virtual.span("G12", MODULI) == (20.0 - 1e-3, 20.0 + 1e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("prestrain.slack_x", 2e-3),  # of one that acts
        ("prestrain.slack_x", 0.0),  # of one that then does no more
        ("clamp_slip.compliance", 0.01),  # of one that did not, before and between others
        ("lens_distortion.k1", 1e-3),
        ("stiffness_field.b7", 0.1),
        ("poisson_ratio.nu12", 0.24),  # of one whose null is the test's
        ("poisson_ratio.nu12", 0.3),
        ("rigid_motion.rotation_z", 0.0),
    ],
)
def test_effects_by_one_value_more_are_those_by_all_values(name: str, value: float) -> None:
    """In the order in which they act."""
    nulls = null_values(0.24)
    values = {
        **MODULI, "poisson_ratio.nu12": 0.2, "prestrain.slack_x": 1e-3, "dic_scale.scale": 0.01,
        "rigid_motion.rotation_z": 1.0, "rigid_motion.shift_x": 0.1, "creep.rate": 0.0,
    }  # fmt: skip
    found = with_value(active_effects(values, nulls), name, value, nulls)
    assert found == active_effects({**values, name: value}, nulls)


@pytest.mark.parametrize("offset", [-0.02, 0.0, 0.1])
def test_what_is_not_inflated_does_not_move_with_the_gauge(offset: float) -> None:
    """Along a path as frame by frame: near no pressure at all, shapes change without end."""
    recorded = np.array([-0.005, 0.0, 0.1])
    test = BulgeTest.from_arrays(np.zeros((1, 3)), np.zeros((3, 1, 3)), recorded)
    values = {**MODULI, "pressure_offset.offset": offset}
    path, frames = (
        VirtualTest(test, Setup(refine=2, tolerance=1e-5, correct_mesh=False, interpolation=way))
        .shapes(values, ("pressure_offset.offset",))
        .derivative["pressure_offset.offset"]
        for way in ("dense", "none")
    )
    rest = recorded - 0.1 * offset <= 0.0
    assert rest.any()
    assert not path[rest].any()
    for along, own in zip(path, frames, strict=True):
        np.testing.assert_allclose(along, own, atol=1e-3 * np.abs(own).max())


def test_a_frame_is_found_beside_one_whose_path_is_coarse() -> None:
    """Beyond ellipticity levels may be a descent apart, and dense output between them far off."""
    at = np.array([[0.0, 0.0, 0.0], [40.0, 10.0, 0.0]])
    moduli = {"E1": 64.2, "E2": 23.7, "G12": 0.96, "axis_misalignment.angle": 27.0}

    def found(*pressures: float) -> Shapes:
        nothing = np.zeros((len(pressures), 2, 3))
        test = BulgeTest.from_arrays(at, nothing, pressures, poisson_ratio=0.3)
        setup = Setup(refine=2, correct_mesh=False, interpolation="none")
        return VirtualTest(test, setup).shapes(moduli)

    both, alone = found(0.0774, 0.12), found(0.0774)
    assert both.stable.all()
    np.testing.assert_allclose(both.displacement[0], alone.displacement[0], atol=1e-6)
