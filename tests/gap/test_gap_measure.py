"""The gap on what is held out: by derivatives at an optimum, by shapes short of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bulgefit.errors import InputError
from bulgefit.gap.data import FOLDS, Data
from bulgefit.gap.effects import MODULI
from bulgefit.gap.regress import Regression, regress
from bulgefit.gap.residual.measure import held_out_gap

TRUTH = {"E1": 340.0, "E2": 210.0, "G12": 20.0}


@pytest.fixture(scope="module")
def data(made_by_the_model: Callable[..., Data]) -> Data:
    return made_by_the_model(TRUTH, 15.0, frames=8, seed=3)


def short_of_it(data: Data) -> Regression:
    """A fit that stands far from its optimum."""
    start = dict(zip(MODULI, (120.0, 800.0, 250.0), strict=True))
    fit = regress([data], MODULI, start, iterations=0)
    assert not fit.converged
    return fit


def by_hand(data: Data, fit: Regression, share: float = 1.0) -> float:
    """Mean |dx| + |dy| + |dz| where a fold is held out, at the end of a share of its step."""
    left = np.full(data.used.shape, np.nan)
    for fold in range(FOLDS):
        step = share * fit.normal.step_without(fold)
        values = {
            m.name: fit.values[m] * np.exp(s / fit.values[m])
            for m, s in zip(MODULI, step, strict=True)
        }
        held = data.blocks.held(fold)
        seen = data.specimen.predict(values).displacement
        left[held] = (data.specimen.measured - seen)[held]
    return float(np.abs(left).mean(axis=(0, 1)).sum())


def test_at_the_optimum_both_ways_agree(data: Data) -> None:
    fit = regress([data], MODULI, dict(zip(MODULI, TRUTH.values(), strict=True)))
    assert fit.converged
    first_order = held_out_gap([data], fit, 0.1)
    shapes = held_out_gap([data], replace(fit, converged=False), 0.1)
    assert shapes == pytest.approx(first_order, rel=2e-3)
    assert shapes["e"] == pytest.approx(by_hand(data, fit), rel=1e-6)


def test_short_of_it_shapes_are_what_counts(data: Data) -> None:
    """Derivatives lead elsewhere than the model does, by more than the gap that is to be told."""
    fit = short_of_it(data)
    told = held_out_gap([data], fit, 0.1)["e"]
    assert told == pytest.approx(by_hand(data, fit), rel=1e-6)
    assert abs(held_out_gap([data], replace(fit, converged=True), 0.1)["e"] - told) > 0.01 * told


def test_where_no_shape_is_at_its_end_a_step_is_halved(
    data: Data, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, tried = short_of_it(data), []
    whole = data.specimen.predict

    def predict(values: dict[str, float], *args: Any) -> Any:
        tried.append(values["E1"])
        if len(tried) % 3:  # each fold's first two
            raise InputError("no such cloth")
        return whole(values, *args)

    monkeypatch.setattr(data.specimen, "predict", predict)
    told = held_out_gap([data], fit, 0.1)["e"]
    monkeypatch.undo()
    assert len(tried) == 3 * FOLDS
    assert told == pytest.approx(by_hand(data, fit, 0.25), rel=1e-6)


def test_where_no_shape_is_on_the_way_the_step_is_told_to_first_order(
    data: Data, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The gap of what was fitted is none of what is held out."""
    fit = short_of_it(data)
    whole = data.specimen.predict

    def predict(values: dict[str, float], names: Any, *args: Any) -> Any:
        if not names:  # shapes alone
            raise InputError("no such cloth")
        return whole(values, names, *args)

    monkeypatch.setattr(data.specimen, "predict", predict)
    told = held_out_gap([data], fit, 0.1)
    assert told == held_out_gap([data], replace(fit, converged=True), 0.1)
