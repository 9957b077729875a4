"""Is a column what its unit says? Two columns may contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bulgefit.dic.formats.frames import Signal
from bulgefit.errors import InputError

__all__ = ["contradictions"]


def contradictions(signal: Signal, all_signals: Sequence[Signal], confirmed: bool) -> list[str]:
    """What is not what its unit says; refuse the chosen column if that is so of it.

    Some exports put the volts of an input under the unit of what it measures.

    Parameters
    ----------
    signal : Signal
        The chosen one.
    all_signals : sequence of Signal
    confirmed : bool
        Whether the user has named both the column and its unit, and so said what holds where two
        columns leave that open.

    Returns
    -------
    list of str
        Columns that the others show to be something else, a line each.

    Raises
    ------
    InputError
        The chosen column is one of these, or two columns leave it open.
    """
    notes = []
    others = [other for other in all_signals if other is not signal]
    rivals = [s for s in others if _is_same_quantity(signal, s) and not _are_equal(signal, s)]
    if twin := _same_in_another_unit(signal, others):
        same = (
            f"{signal.where}: {_place(signal)} and {_place(twin)} hold the same numbers, in "
            f"{signal.unit} and in {twin.unit}"
        )
        if rivals:
            raise InputError(
                f"{same}, and {_place(rivals[0])} others in {signal.unit}; give that one with "
                "--pressure-column"
            )
        if not confirmed:
            raise InputError(
                f"{same}, so one unit is wrong; say what holds with --pressure-column and "
                "--pressure-unit"
            )
    for rival in rivals:
        if twin := _same_in_another_unit(rival, [s for s in others if s is not rival]):
            notes.append(f"{_place(rival)} holds the {twin.unit} of {twin.name!r} and is not used")
        elif not confirmed:
            raise InputError(
                f"{signal.where}: {_place(signal)} and {_place(rival)} are both in {signal.unit} "
                "and differ; say which holds with --pressure-column and --pressure-unit"
            )
    return notes


def _same_in_another_unit(signal: Signal, others: Sequence[Signal]) -> Signal | None:
    # constant columns, such as those of an input that is not connected, say nothing
    if signal.unit is None or not np.ptp(signal.values):
        return None
    for other in others:
        if other.unit not in (None, signal.unit) and _are_equal(signal, other):
            return other
    return None


def _are_equal(one: Signal, other: Signal) -> bool:
    # exports round to six digits and more
    return bool(np.allclose(one.values, other.values, rtol=1e-5, atol=0, equal_nan=True))


def _is_same_quantity(one: Signal, other: Signal) -> bool:
    last = [signal.quantity.split(".")[-1] for signal in (one, other)]
    return last[0] == last[1] and one.unit == other.unit and one.unit is not None


def _place(signal: Signal) -> str:
    return f"{signal.name!r} of {Path(signal.where).name}"
