"""Which pressure belongs to each frame? It stands in a log, in the frames, or in their names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.contradictions import contradictions
from bulgefit.dic.formats.frames import Frame, Signal
from bulgefit.dic.formats.logs import LogError, is_log, read_log
from bulgefit.dic.formats.names import column
from bulgefit.dic.formats.source import Head
from bulgefit.dic.units import LENGTH, PRESSURE, TIME, usual
from bulgefit.errors import InputError
from bulgefit.shown import some_of

__all__ = ["BY_NAMES", "Pressures", "is_of_pressure", "pressures_of"]

Floats = NDArray[np.floating]

#: What `pressure` is where the names of the frames tell it.
BY_NAMES = "names"
# Columns that a message lists.
_SHOWN = 12
_WORD = re.compile(r"press|druck|presi|\bp\b", re.IGNORECASE)
_STRESS = re.compile(r"stress|spannung|sigma|modul|tresca|mises|\bs\d", re.IGNORECASE)
_IN_A_NAME = re.compile(r"(?<![\d.,])(\d+(?:[.,]\d+)?)[ _]?(mbar|bar|MPa|kPa|Pa)(?![A-Za-z])")
# What --pressure-unit may be: a unit, or what one of the recorded unit is worth: 2.5bar/V.
_WORTH = re.compile(r"\s*([-+.\deE]*)\s*([A-Za-z]+(?:/mm\^2)?)\s*(?:/\s*([A-Za-z]+))?\s*")


@dataclass(frozen=True)
class Pressures:
    """The pressures of a test, and where they come from.

    Attributes
    ----------
    values : (frames,) array, MPa
    unit : str
        Of the numbers in the file, one of `bulgefit.dic.units.PRESSURE`.
    time : (frames,) array, s, or None
    used : tuple of Path
        Files that were read for them.
    note : str
    """

    values: Floats
    unit: str
    time: Floats | None
    used: tuple[Path, ...]
    note: str


def is_of_pressure(name: str, unit: str | None) -> bool:
    """Whether a column's name or unit says that it holds pressures."""
    return bool(_WORD.search(name)) or (unit in PRESSURE and not _STRESS.search(name))


def pressures_of(
    frames: Sequence[Frame],
    others: Sequence[Head],
    beside: Iterable[Head],
    where: str,
    *,
    pressure: str | None = None,
    column: str | None = None,
    unit: str | None = None,
) -> Pressures:
    """Find the pressure of each frame.

    Parameters
    ----------
    frames : sequence of Frame
    others : sequence of Head
        What was given beside the frames, of which one may be a log.
    beside : iterable of Head
        Further files of the folder; a log of theirs counts if it has all the frames.
    where : str
        What is read, for messages.
    pressure : str, optional
        A table, or "names" where the names of the frames tell; by default a log beside the frames,
        else what was recorded in them, else their names.
    column : str, optional
        The column of the table or of the frames that is the pressure.
    unit : str, optional
        Its unit, or what one of its unit is worth, such as "2.5bar/V".

    Raises
    ------
    InputError
        There is none, several may be it, its unit is not stated or another one, or two columns
        contradict.
    """
    names = [frame.name for frame in frames]
    if pressure == BY_NAMES:
        if column is not None:
            raise InputError(
                f"--pressure {BY_NAMES}: names have no column; leave --pressure-column {column!r}, "
                f"or --pressure {BY_NAMES}, out"
            )
        return _from_names(names, unit, where)
    if pressure is not None:
        path = Path(pressure)
        if not path.is_file():
            raise InputError(f"{path}: no such file; --pressure is a table, or `{BY_NAMES}`")
        signals, how = read_log(path, names, in_order=True)
        return _from_log(path, how, signals, frames, column, unit)
    recorded = _recorded(frames)
    in_names = column is None and all(map(_IN_A_NAME.search, names))
    log = _log_of(names, others, beside, where)
    # a log of forces alone leaves the pressure to what else tells it
    if log is not None and not (in_names and not _candidates([*log[2], *recorded], None)):
        return _from_log(*log, frames, column, unit)
    if _candidates(recorded, column):
        signal = _chosen(recorded, column, where)
        values, known = _in_mpa(signal, unit, where)
        note = f"pressure from {signal.name!r} in the frames"
        return Pressures(values, known, _time(recorded), (), note)
    if in_names:
        return _from_names(names, unit, where)
    raise InputError(
        f"{where}: no pressure found in a log beside the frames, in the frames "
        f"({_listed(recorded)}) or in their names; give a table with --pressure FILE, or "
        "its column with --pressure-column"
    )


def _log_of(
    names: list[str], others: Sequence[Head], beside: Iterable[Head], where: str
) -> tuple[Path, str, list[Signal]] | None:
    """The one log beside the frames, how its rows were found, and what it recorded.

    Raises
    ------
    InputError
        There are several, or none of them has the frames.
    """
    found, refused = [], []
    for head in (*others, *beside):
        if is_log(head):
            try:
                signals, how = read_log(head.path, names)
                found.append((head.path, how, signals))
            except LogError as error:
                if head in others:
                    refused.append(error)
            except InputError:
                if head in others:
                    raise
    if len(found) > 1:
        files = ", ".join(path.name for path, _, _ in found)
        raise InputError(f"{where}: has several logs, {files}; name one with --pressure FILE")
    if refused and not found:
        raise refused[0]
    return found[0] if found else None


def _from_log(
    path: Path,
    how: str,
    signals: list[Signal],
    frames: Sequence[Frame],
    column: str | None,
    unit: str | None,
) -> Pressures:
    recorded = _recorded(frames)
    if not _candidates(signals, column) and _candidates(recorded, column):
        signal = _chosen(recorded, column, str(path))
        notes = [f"pressure from {signal.name!r} in the frames"]
    else:
        signal = _chosen(signals, column, str(path))
        notes = [f"pressure from {signal.name!r} of {path.name}, found by {how}"]
    values, known = _in_mpa(signal, unit, signal.where)
    confirmed = column is not None and unit is not None
    notes += contradictions(signal, [*signals, *recorded], confirmed)
    time = _time([*signals, *recorded])
    return Pressures(values, known, time, (path,), "; ".join(notes))


def _from_names(names: Sequence[str], unit: str | None, where: str) -> Pressures:
    found = [_IN_A_NAME.findall(name) for name in names]
    for name, numbers in zip(names, found, strict=True):
        if len(numbers) != 1:
            raise InputError(
                f"{where}: the name {name!r} does not tell one pressure with its unit, such as "
                "1.5bar; give a table with --pressure FILE"
            )
        if unit not in (None, numbers[0][1]):
            raise InputError(
                f"{where}: the name {name!r} tells the pressure in {numbers[0][1]}, not in {unit}; "
                "leave --pressure-unit out"
            )
    values = [float(n[0][0].replace(",", ".")) * PRESSURE[n[0][1]] for n in found]
    return Pressures(np.array(values), found[0][0][1], None, (), "pressure from the frames' names")


def _recorded(frames: Sequence[Frame]) -> list[Signal]:
    """What every frame has recorded, one value a frame."""
    shared = [name for name in frames[0].signals if all(name in f.signals for f in frames)]
    return [
        replace(
            frames[0].signals[name],
            values=np.array([float(frame.signals[name].values[0]) for frame in frames]),
        )
        for name in shared
    ]


def _candidates(signals: Sequence[Signal], name: str | None) -> list[Signal]:
    if name is not None:
        wanted = column(name)
        exact = [signal for signal in signals if signal.name == wanted.name]
        return exact or [signal for signal in signals if signal.quantity == wanted.name]
    named = [s for s in signals if is_of_pressure(s.quantity, s.unit)]
    # where one is given in volts and in bar, the latter is it
    return [s for s in named if s.unit in PRESSURE] or named


def _chosen(signals: Sequence[Signal], name: str | None, where: str) -> Signal:
    found = _candidates(signals, name)
    if len(found) == 1:
        return found[0]
    if name is not None and not found:
        raise InputError(f"{where}: has no column {name!r}; found {_listed(signals)}")
    which = "which of these" if found else "which of its columns"
    raise InputError(
        f"{where}: {which} is the pressure? {_listed(found or signals)}; say it with "
        "--pressure-column NAME"
    )


def _in_mpa(signal: Signal, unit: str | None, where: str) -> tuple[Floats, str]:
    """Values in MPa, and the unit of the file."""
    stated = signal.unit or None
    worth = f"what one {stated} is worth, such as --pressure-unit 2.5bar/{stated}"
    if unit is None:
        if stated in PRESSURE:
            return signal.values * PRESSURE[str(stated)], str(stated)
        if stated is None:
            raise InputError(
                f"{where}: the unit of {signal.name!r} is not stated; give it, such as "
                "--pressure-unit bar (or 2.5bar/V, for what a volt is worth)"
            )
        raise InputError(
            f"{where}: {signal.name!r} is in {stated}, which is no pressure; give {worth}"
        )
    size, name, per = _parsed(unit)
    if stated is not None and stated not in PRESSURE and per != stated:
        raise InputError(f"{where}: {signal.name!r} is in {stated}, not in {unit}; give {worth}")
    if None not in (stated, per) and per != stated:
        raise InputError(
            f"{where}: {signal.name!r} is in {stated}, not in {per}; leave --pressure-unit out, or "
            f"give {size:g}{name} if its numbers are in {per} all the same"
        )
    return signal.values * size * PRESSURE[name], name


def _parsed(unit: str) -> tuple[float, str, str | None]:
    found = _WORTH.fullmatch(usual(unit))
    try:
        size = float(found[1] or 1) if found else np.nan
    except ValueError:
        size = np.nan
    if found is None or not np.isfinite(size) or found[2] not in PRESSURE:
        raise InputError(
            f"--pressure-unit {unit}: is not one of {', '.join(PRESSURE)}, nor what one is worth, "
            "such as 2.5bar/V"
        )
    return size, found[2], found[3]


def _time(signals: Sequence[Signal]) -> Floats | None:
    """Times in s, where one column is of time and states its unit."""
    named = [s for s in signals if s.quantity.split(".")[-1].lower().startswith("time")]
    found = [s for s in named if s.unit in TIME]
    if len(found) != 1 or not np.isfinite(found[0].values).all():
        return None
    return found[0].values * TIME[str(found[0].unit)]


def _listed(signals: Sequence[Signal]) -> str:
    # what is no length and no time, and changes, comes first
    ordered = sorted(
        signals, key=lambda s: (s.unit in LENGTH or s.unit in TIME, not np.ptp(s.values))
    )
    return some_of([repr(signal.name) for signal in ordered], _SHOWN) or "nothing was recorded"
