"""Forecasts of effects leaving and coming, and an early stand-in that has to go."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.gap.exchange import evidence_of, exchanged, fits_without, without_superfluous
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.search import Search, Trial
from bulgefit.gap.structure import structure
from bulgefit.gap.universe import universe
from bulgefit.parallel.workers import open_executor

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0, "pressure_offset.offset": 0.03}
EFFECTS = [CATALOGUE[e] for e in ("pressure_offset", "rigid_motion", "reference_state")]
SHIFT = tuple(f"rigid_motion.shift_{a}" for a in "xyz")


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> list[Data]:
    return [made_by_the_model(TRUTH, spacing=9.0, frames=8, seed=5)]


@pytest.fixture(scope="module")
def search(data: list[Data]) -> Iterator[Search]:
    with open_executor(2) as threads:
        yield Search(data, EFFECTS, threads, lambda _: None)


def fitted(data: list[Data], keys: tuple[str, ...]) -> Regression:
    return regress(data, (*MODULI, *keys), {**TRUTH, **dict.fromkeys(keys, 0.0)})


def test_moving_what_is_linear_is_exact(data: list[Data]) -> None:
    """A shift of the frame enters linearly: forecasts at another shift are those made there."""
    here = universe(data, fitted(data, SHIFT), EFFECTS)
    changes = dict.fromkeys(SHIFT, 0.05)
    fit = fitted(data, SHIFT)
    fit.values.update({k: fit.values[k] + 0.05 for k in SHIFT})
    there = universe(data, fit, EFFECTS)
    moved = here.moved(changes)
    assert moved.normal.whole.square == pytest.approx(there.normal.whole.square, rel=1e-6)
    assert moved.held_out((*MODULI, *SHIFT)) == pytest.approx(
        there.held_out((*MODULI, *SHIFT)), rel=1e-6
    )


def test_a_stand_in_makes_room(search: Search, data: list[Data]) -> None:
    """A reference state and a moved frame were taken for what is an offset of pressure."""
    state = CATALOGUE["reference_state"].groups()[1]
    groups = {"rigid_motion": CATALOGUE["rigid_motion"].all_keys, "reference_state": state}
    wrong = fitted(data, tuple(k for keys in groups.values() for k in keys))
    fit, found = exchanged(search, wrong, groups)
    assert "pressure_offset" in found
    assert fit.chi_square < 1.05 * fit.normal.count


def test_what_does_nothing_goes_though_an_early_fit_of_the_rest_got_stuck(
    search: Search, data: list[Data]
) -> None:
    """A fit of the offset alone stopped far off, where nothing balances; a shift came beside it."""
    offset = CATALOGUE["pressure_offset"].all_keys
    early = fitted(data, offset)
    search.remember(replace(early, values={**early.values, "E1": 20.0, "E2": 20.0, "G12": 0.5}))
    fit = fitted(data, (*offset, *SHIFT))
    groups = {"pressure_offset": offset, "rigid_motion": SHIFT}
    _, left, _ = without_superfluous(search, fit, groups)
    assert [*left] == ["pressure_offset"]


def test_where_structure_is_left_an_exchange_has_to_take_most_of_it(
    search: Search, made_by_the_model: Callable[..., Data]
) -> None:
    """A moved frame was taken for what is a slipping clamp, or a turned fabric, none of them here.

    A reference state comes far nearer to the first; beside one, nothing comes near the second.
    """
    frame = {"rigid_motion": CATALOGUE["rigid_motion"].all_keys}
    state = {"reference_state": CATALOGUE["reference_state"].groups()[1]}
    for truth, groups, most in (
        ({"clamp_slip.compliance": 0.01}, frame, True),
        ({"axis_misalignment.angle": 1.0}, {**frame, **state}, False),
    ):
        truth = {**TRUTH, **truth}
        data = [made_by_the_model(truth, spacing=9.0, frames=8, seed=7)]
        wrong = fitted(data, tuple(k for keys in groups.values() for k in keys))
        here = replace(search, data=data)
        assert structure(data, wrong).significant
        assert exchanged(here, wrong, groups)[1] != groups
        fit, found = exchanged(here, wrong, groups, largely=True)
        assert (found != groups, fit is not wrong) == (most, most)


def test_an_effect_grows_into_the_place_of_a_stand_in(
    search: Search, made_by_the_model: Callable[..., Data]
) -> None:
    """A reference state was taken for the shifts of a moved frame, whose turns came after it."""
    truth = {**TRUTH, "rigid_motion.rotation_x": 0.2, **dict.fromkeys(SHIFT, -0.2)}
    data = [made_by_the_model(truth, spacing=9.0, frames=8, seed=6)]
    turns, whole = CATALOGUE["rigid_motion"].groups()
    groups = {"reference_state": CATALOGUE["reference_state"].groups()[1], "rigid_motion": turns}
    stand_in = fitted(data, tuple(k for keys in groups.values() for k in keys))
    search = replace(search, data=data, effects=EFFECTS[1:])
    fit, found = exchanged(search, stand_in, groups)
    assert found == {"rigid_motion": whole}
    assert {*fit.keys} == {*MODULI, *whole}
    assert fit.values["rigid_motion.shift_y"] == pytest.approx(-0.2, rel=0.02)


def test_a_fit_starts_where_one_of_the_same_keys_ended(search: Search, data: list[Data]) -> None:
    """Wherever it is told to start: without a step it is there."""
    near, keys = fitted(data, SHIFT), (*MODULI, "pressure_offset.offset")
    (end,) = search.fits(near, [Trial("to the end", keys, {**TRUTH, "E1": 250.0})])
    (start,) = search.fits(near, [Trial("again", keys, {**TRUTH, "E1": 400.0})], steps=0)
    assert end is not None
    assert start is not None
    assert end.values["E1"] == pytest.approx(TRUTH["E1"], rel=0.01)
    assert start.values == end.values


def test_evidence_says_what_an_effect_is_worth(search: Search, data: list[Data]) -> None:
    keys = ("pressure_offset.offset",)
    fit = fitted(data, keys)
    known = universe(data, fit, EFFECTS)
    groups = {"pressure_offset": keys}
    without = fits_without(search, fit, groups)
    alone = regress(data, MODULI, {name: TRUTH[name] for name in MODULI})
    found = evidence_of(search, known, fit, groups, without, worst=alone, rivals=True)
    evidence = found["pressure_offset"]
    assert evidence.rivals == ()
    assert evidence.without is not None
    assert evidence.without.values == pytest.approx(alone.values, rel=1e-4)
    assert evidence.without.held_out() == pytest.approx(alone.held_out(), rel=1e-4)
    assert evidence.without.held_out() > 3 * evidence.held_out
    assert evidence.held_out == pytest.approx(fit.normal.count, rel=0.05)


def test_evidence_where_nothing_balances_without_an_effect(
    search: Search, data: list[Data]
) -> None:
    """Its worth is not known, rather than that of the moduli alone; its rivals are found."""
    keys = ("pressure_offset.offset",)
    fit = fitted(data, keys)
    alone = regress(data, MODULI, {name: TRUTH[name] for name in MODULI})
    groups = {"pressure_offset": keys}
    known = universe(data, fit, EFFECTS)
    found = evidence_of(
        search, known, fit, groups, {"pressure_offset": None}, worst=alone, rivals=True
    )
    assert found["pressure_offset"].without is None
    assert found["pressure_offset"].rivals == ()
