"""The page of a cross-validation: do the parameters of some tests hold for the others?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bulgefit.fitting.result import unit_of
from bulgefit.report.numbers import CARE, USE, listed
from bulgefit.report.page import charts
from bulgefit.report.page.blocks import Answer, Block, Page, Value
from bulgefit.shown import after_value, plain

__all__ = ["page_of_crossval"]

Result = Mapping[str, Any]

_JUDGED = ("e", "e_w", "e_z")


def page_of_crossval(result: Result) -> Page:
    """The page of a cross-validation's JSON."""
    names = listed([str(fold["left_out"]) for fold in result["folds"]])
    blocks = [
        Block("heading", ("Fold by fold",)),
        Block("table", rows=_rows(result)),
        *_pictures(result),
        Block("fields"),
    ]
    title = f"Do the parameters of some tests hold for the others? {names}"
    return Page(title, "crossval", _answer(result), tuple(blocks))


def _values(result: Result) -> dict[str, list[float]]:
    """Of every parameter that varies over the folds."""
    folds = result["folds"]
    shared = [n for n in folds[0]["parameters"] if all(n in f["parameters"] for f in folds)]
    found = {name: [float(f["parameters"][name]) for f in folds] for name in shared}
    return {name: values for name, values in found.items() if len(set(values)) > 1}


def _answer(result: Result) -> Answer:
    found = _values(result)
    bounded = {name for fold in result["folds"] for name in fold["at_bound"]}
    values = tuple(_value(name, v, name in bounded) for name, v in found.items() if "." not in name)
    mean, spread = result["mean"], result["standard_deviation"]
    judged = result["judged_by"]
    if mean is None:
        headline = "No fold met the test that it left out: look at each test alone first."
        return Answer(headline, "bad", values)
    within = "" if spread is None else f" ± {spread:.2g}"
    trained = float(np.mean([fold["training"]["value"] for fold in result["folds"]]))
    headline = (
        f"A test that was left out is met within {judged} = {mean:.3g}{within} mm (mean ± standard "
        "deviation over folds)."
    )
    notes = []
    if result["objective"] == judged:
        notes.append(
            f"The tests that were fitted are met within {trained:.3g} mm: a test that was not "
            f"fitted is {mean / trained:.2g} times as far."
        )
    missed = [
        str(f["left_out"]) for f in result["folds"] if f["left_out_objectives"][judged] is None
    ]
    if missed:
        notes.append(f"The others' parameters do not reach the pressures of {listed(missed)}.")
    unsure = [v.name for v in values if v.use == "no"]
    if unsure:
        notes.append(f"Do not use {listed(unsure)}: the tests do not agree on it.")
    tone = "good" if not missed and all(v.use == "use" for v in values) else "care"
    return Answer(headline, tone, values, tuple(notes))


def _value(name: str, values: list[float], bounded: bool) -> Value:
    mean, spread = float(np.mean(values)), float(np.std(values, ddof=1))
    text = f"{mean:.4g} ± {spread:.2g}{after_value(unit_of(name))}"
    share = spread / abs(mean) if mean else np.inf
    why = f"varies by {plain(100 * share, 2)} % over the folds"
    if bounded:
        return Value(name, text, "no", "at a bound in a fold: no result")
    return Value(name, text, "use" if share <= USE else "care" if share <= CARE else "no", why)


def _rows(result: Result) -> tuple[tuple[str, ...], ...]:
    names = list(result["folds"][0]["parameters"])
    head = ("left out", *names, "training", *(f"{j} left out (mm)" for j in _JUDGED))
    rows: list[tuple[str, ...]] = [head]
    for fold in result["folds"]:
        judged = fold["left_out_objectives"]
        values = (*(fold["parameters"].get(n) for n in names), fold["training"]["value"])
        cells = (*values, *(judged[j] for j in _JUDGED))
        rows.append((str(fold["left_out"]), *("–" if c is None else f"{c:.4g}" for c in cells)))
    return tuple(rows)


def _pictures(result: Result) -> list[Block]:
    names = [str(fold["left_out"]) for fold in result["folds"]]
    return [
        Block(
            "spans",
            (f"**{parameter}** fitted without each test",),
            picture=charts.spans(
                [(f"without {n}", f"{v:.4g}", v, None) for n, v in zip(names, values, strict=True)]
            ),
        )
        for parameter, values in _values(result).items()
    ]
