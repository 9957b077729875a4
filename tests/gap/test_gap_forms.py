"""The smallest form of an effect that the data are content with."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, MODULI
from bulgefit.gap.forms import in_smallest_forms, smallest_form
from bulgefit.gap.keys import start_of
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.search import Search

MATERIAL = {"E1": 340.0, "E2": 210.0, "G12": 20.0}
GAINS, KNEES, BOTH = CATALOGUE["nonlinear_material"].groups()
OFFSET = "pressure_offset.offset"


def scene(
    made: Callable[..., Data], truth: dict[str, float], keys: tuple[str, ...]
) -> tuple[Search, Regression]:
    """A search, and a fit with more freed than there is."""
    data = [made({**MATERIAL, **truth}, spacing=12.0, frames=8, seed=4)]
    start = {key: truth.get(key, start_of(key, data)) for key in keys}
    fit = regress(data, (*MODULI, *keys), {**MATERIAL, **start})
    search = Search(data, list(CATALOGUE.values()), ThreadPoolExecutor(1), lambda _: None)
    return search, fit


@pytest.mark.parametrize(
    ("truth", "form"),
    [
        (dict(zip(GAINS, (3.0, 2.0), strict=True)), GAINS),
        (dict(zip(KNEES, (-0.5, -0.4, 0.012, 0.015), strict=True)), KNEES),
    ],
    ids=["gains", "knees"],
)
def test_either_half_of_a_form_may_be_enough(
    made_by_the_model: Callable[..., Data], truth: dict[str, float], form: tuple[str, ...]
) -> None:
    """Gains are no part of a form with knees alone: that this is refused says nothing of them."""
    search, fit = scene(made_by_the_model, truth, BOTH)
    smaller, keys = smallest_form(search, fit, "nonlinear_material", BOTH)
    assert keys == form
    assert set(smaller.columns) == {*MODULI, *form}
    assert smaller.chi_square < 1.05 * smaller.normal.count


def test_no_form_is_as_small_as_the_one_that_was_there(
    made_by_the_model: Callable[..., Data],
) -> None:
    truth = dict(zip(GAINS, (3.0, 2.0), strict=True))
    search, fit = scene(made_by_the_model, truth, BOTH)
    kept, keys = smallest_form(search, fit, "nonlinear_material", BOTH, least=4.0)
    assert keys == BOTH
    assert kept is fit


def test_what_others_explain_makes_an_effect_small_again(
    made_by_the_model: Callable[..., Data],
) -> None:
    """A dome that had grown folds before the offset of pressure came in."""
    domes = CATALOGUE["initial_shape"].groups()
    truth = {domes[0][0]: 1.5, OFFSET: 0.02}
    search, fit = scene(made_by_the_model, truth, (*domes[2], OFFSET))
    groups = {"initial_shape": domes[2], "pressure_offset": (OFFSET,)}
    smaller, forms = in_smallest_forms(search, fit, groups)
    assert forms == {"initial_shape": domes[0], "pressure_offset": (OFFSET,)}
    assert smaller.values[domes[0][0]] == pytest.approx(1.5, rel=0.02)


def test_what_a_step_shows_to_be_needed_costs_no_fit(
    made_by_the_model: Callable[..., Data], monkeypatch: pytest.MonkeyPatch
) -> None:
    domes = CATALOGUE["initial_shape"].groups()
    truth = dict(zip(domes[2], (1.5, 0.4, 0.3, 0.3, 0.2, 0.3), strict=True))
    search, fit = scene(made_by_the_model, truth, domes[2])
    monkeypatch.delattr("bulgefit.gap.forms.regress")
    assert smallest_form(search, fit, "initial_shape", domes[2]) == (fit, domes[2])
