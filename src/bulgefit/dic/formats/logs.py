"""How does a table of loads belong to the frames? By file names, by image numbers, or in order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.frames import Signal
from bulgefit.dic.formats.names import Column
from bulgefit.dic.formats.source import Head, frame_name, head_of
from bulgefit.dic.formats.table import BLANKS, Table, find_header, read_table
from bulgefit.errors import InputError

__all__ = ["LogError", "is_log", "read_log"]

Floats = NDArray[np.floating]

_FILE = re.compile(r"\b(file ?names?|files?|images?|bild|dateiname|datei)(_|\b)", re.IGNORECASE)
_NUMBER = re.compile(r"[-+]?\d*[.,]?\d+([eE][-+]?\d+)?")
# Rows below the names of the columns: the first may be of units.
_LOOKED_AT = 3
_INDEX = re.compile(r"\b(index|nummer|number|stage|stufe)\b", re.IGNORECASE)


class LogError(InputError):
    """A table that does not belong to the frames."""


def is_log(head: Head) -> bool:
    """Whether a file begins like a table of loads: with a column that names or numbers images.

    Below it stand cells with numbers, which notes that speak of files and images have not.
    """
    header = find_header(head.headers, _tells_frames)
    if header is None:
        return False
    below = [line for line in head.lines[header.line + 1 :] if line.strip()]
    return any(_has_number(line, header.separator) for line in below[:_LOOKED_AT])


def _has_number(line: str, separator: str) -> bool:
    cells = line.split(None if separator == BLANKS else separator)
    return len(cells) > 1 and any(_NUMBER.fullmatch(cell.strip(' "')) for cell in cells)


def read_log(
    path: Path, frames: Sequence[str], *, in_order: bool = False
) -> tuple[list[Signal], str]:
    """What a table says of each frame.

    Rows are found by the file names in them: other rows, such as those of calibration images,
    shift every count. Where no column holds file names, by image numbers.

    Parameters
    ----------
    path : Path
    frames : sequence of str
        Names of the frames.
    in_order : bool
        Whether a table with as many rows as there are frames, and neither names nor numbers,
        belongs to them row by row.

    Returns
    -------
    list of Signal
        Its columns of numbers, one value a frame.
    str
        How the rows were found.

    Raises
    ------
    LogError
        Rows of frames are missing, or nothing tells which row is whose.
    InputError
        The file is no table.
    """
    table = read_table(path, _tells_frames) if is_log(head_of(path)) else read_table(path)
    rows, how = _rows_of(table, frames, in_order)
    signals = []
    for column in table.columns:
        if table.header.count(column.name) > 1 or not column.name:
            continue
        values = _numbers_of(table, column)
        if values is not None:
            signals.append(
                Signal(column.name, column.quantity, column.unit, values[rows], str(path))
            )
    return signals, how


def _tells_frames(columns: Sequence[Column]) -> bool:
    # a header names its columns: no cell of it is a number
    names = [column.name for column in columns]
    if any(re.fullmatch(r"[-+.,\deE]+", name) for name in names):
        return False
    return any(_FILE.search(name) or _INDEX.search(name) for name in names)


def _numbers_of(table: Table, column: Column) -> Floats | None:
    try:
        return table.numbers([column.name])[:, 0]
    except InputError:  # a column of text
        return None


def _rows_of(table: Table, frames: Sequence[str], in_order: bool) -> tuple[NDArray[np.intp], str]:
    for column in table.columns:
        if _FILE.search(column.name) and table.header.count(column.name) == 1:
            rows = _rows_by_name(table, column, frames)
            shorter = [*map(_without_camera, frames)]
            # exports may leave out which of the cameras it was
            if rows is None and len({*shorter}) == len(frames):
                rows = _rows_by_name(table, column, shorter)
            if rows is not None:
                return rows, f"file names in its column {column.name!r}"
    for column in table.columns:
        if _INDEX.search(column.name) and table.header.count(column.name) == 1:
            rows = _rows_by_number(table, column, frames)
            if rows is not None:
                return rows, f"image numbers in its column {column.name!r}"
    count = len(table.texts(table.header[0]))
    if in_order and count == len(frames):
        return np.arange(count), "the order of its rows"
    raise LogError(
        f"{table.path}: no column names the frames (such as {frames[0]!r}) and none numbers them, "
        f"and it has {count} rows for {len(frames)} frames; add a column `file`"
    )


def _rows_by_name(table: Table, column: Column, frames: Sequence[str]) -> NDArray[np.intp] | None:
    names: dict[str, int] = {}
    texts = [frame_name(text) for text in table.texts(column.name)]
    if not {*texts} & {*frames}:
        texts = [*map(_without_camera, texts)]
    for row, name in enumerate(texts):
        if name in names and name in frames:
            raise LogError(
                f"{table.path}: column {column.name!r} names {name!r} twice; one row a frame"
            )
        names[name] = row
    missing = [frame for frame in frames if frame not in names]
    if len(missing) == len(frames):
        return None
    if missing:
        raise LogError(
            f"{table.path}: has no row for {len(missing)} of {len(frames)} frames, first "
            f"{missing[0]!r}; add it, or move that frame out"
        )
    return np.array([names[frame] for frame in frames])


def _without_camera(name: str) -> str:
    return re.sub(r"_[01]$", "", name)


def _rows_by_number(table: Table, column: Column, frames: Sequence[str]) -> NDArray[np.intp] | None:
    found = _numbers_of(table, column)
    if found is None or not len(found):
        return None
    known = found[np.isfinite(found)]
    if (known != np.rint(known)).any():
        return None
    numbers = _frame_numbers(frames, table.path)
    rows = []
    for frame, number in zip(frames, numbers, strict=True):
        at = np.flatnonzero(found == number)
        if not len(at):
            raise LogError(
                f"{table.path}: column {column.name!r} has no {number}, for the frame {frame!r}; "
                "add its row, or move the frame out"
            )
        if len(at) > 1:
            raise LogError(
                f"{table.path}: column {column.name!r} has {number} in {len(at)} rows, for the "
                f"frame {frame!r}; one row a frame"
            )
        rows.append(int(at[0]))
    return np.array(rows)


def _frame_numbers(frames: Sequence[str], path: Path) -> list[int]:
    """The numbers of frames: the digits of their names that change from one to the next."""
    parts = [re.findall(r"\d+", name) for name in frames]
    if len({re.sub(r"\d+", "0", name) for name in frames}) == 1 and parts[0]:
        columns = list(zip(*parts, strict=True))
        changing = [digits for digits in columns if len(set(digits)) > 1]
        if len(columns) == 1 or len(changing) == 1:
            return [int(digits) for digits in (changing or columns)[0]]
    raise LogError(
        f"{path}: numbers the images, but the names of the frames (first {frames[0]!r}) do not "
        "tell their numbers; add a column `file`"
    )
