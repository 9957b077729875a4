"""How is one text export read, once it is known what its columns are called?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.base import Ask
from bulgefit.dic.formats.frames import Frame, Signal, measured_rows
from bulgefit.dic.formats.names import Column
from bulgefit.dic.formats.pressures import is_of_pressure
from bulgefit.dic.formats.source import Head, frame_name
from bulgefit.dic.formats.table import Table, find_header, read_table
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError

__all__ = ["Layout", "Three", "fitting_layout", "read_text", "recognises_text"]

Floats = NDArray[np.floating]
Three = tuple[str, str, str]


@dataclass(frozen=True)
class Layout:
    """What the columns of an export are called, without their units; letters keep their case.

    Attributes
    ----------
    position : three str
    displacement : three str or None
        None where it is `deformed` minus `position`.
    deformed : three str or None
        Positions at the frame.
    ids : tuple of str
        Columns that tell the points apart through the frames, where the file has them.
    rows_are_ids : bool
        Whether every file has a row for each point, lost or not; a join checks that.
    row : str or None
        The column of the pixel's row in the reference image.
    marks : tuple of (str, float)
        Columns, and the value in them that says that the point is lost.
    zeros : tuple of str
        Columns that are all exactly zero in the row of a lost point.
    also : tuple of str
        Further columns by which the layout is known.
    units : bool or None
        Whether the names of positions state units; None where that may be.
    """

    position: Three
    displacement: Three | None
    deformed: Three | None = None
    ids: tuple[str, ...] = ()
    rows_are_ids: bool = False
    row: str | None = None
    marks: tuple[tuple[str, float], ...] = ()
    zeros: tuple[str, ...] = ()
    also: tuple[str, ...] = ()
    units: bool | None = None

    def fits(self, columns: Sequence[Column]) -> bool:
        """Whether the columns are of this layout."""
        units = {column.quantity: column.unit for column in columns}
        needed = [*self.position, *(self.displacement or ()), *(self.deformed or ()), *self.also]
        if not units.keys() >= {*needed}:
            return False
        stated = all(units[name] is not None for name in self.position)
        return self.units is None or self.units == stated


def fitting_layout(layouts: Sequence[Layout], columns: Sequence[Column]) -> Layout | None:
    """The first layout that the columns are of."""
    return next((layout for layout in layouts if layout.fits(columns)), None)


def recognises_text(*layouts: Layout) -> Callable[[Head], bool]:
    """A function that says whether a file begins with columns of one of the layouts."""

    def recognises(head: Head) -> bool:
        return (
            find_header(head.headers, lambda c: fitting_layout(layouts, c) is not None) is not None
        )

    return recognises


def read_text(layouts: Sequence[Layout], path: Path, ask: Ask) -> tuple[Frame, Table]:
    """Read a file into its frame, and the table for what else a format finds in it.

    Raises
    ------
    InputError
        A cell is no number, or a length is in an unknown unit.
    """
    table = read_table(path, lambda columns: fitting_layout(layouts, columns) is not None)
    layout = fitting_layout(layouts, table.columns)
    assert layout is not None
    values = _values(table, layout)
    position = _lengths(table, values, layout.position, ask)
    if layout.displacement is not None:
        displacement = _lengths(table, values, layout.displacement, ask)
    else:
        assert layout.deformed is not None
        displacement = _lengths(table, values, layout.deformed, ask) - position
    lost = np.zeros(len(position), dtype=bool)
    for name, value in layout.marks:
        if name in values:
            lost |= values[name] == value
    if layout.zeros:
        zero = ~np.column_stack([values[name] for name in layout.zeros]).any(axis=1)
        # a flat fabric at rest has no heights and no displacements either
        if not zero.all() or not position.any():
            lost |= zero
    frame = Frame(
        path=path,
        name=frame_name(path.name),
        position=position,
        displacement=displacement,
        ids=np.arange(len(position))[:, None] if layout.rows_are_ids else _ids(values, layout.ids),
        pixels=None if layout.row is None else values.get(layout.row),
        signals=_signals(table, ask.signal),
        has_units=all(_states_unit(table, name) for name in layout.position),
    )
    return measured_rows(frame, lost), table


def _values(table: Table, layout: Layout) -> dict[str, Floats]:
    """The columns of numbers that a layout asks for, read at once, by quantity."""
    wanted = [
        *layout.position,
        *(layout.displacement or ()),
        *(layout.deformed or ()),
        *layout.ids,
        *(name for name, _ in layout.marks),
        *((layout.row,) if layout.row else ()),
    ]
    found = {name: _find(table, name) for name in dict.fromkeys(wanted)}
    columns = {name: column for name, column in found.items() if column is not None}
    numbers = table.numbers([column.name for column in columns.values()])
    return dict(zip(columns, numbers.T, strict=True))


def _find(table: Table, quantity: str) -> Column | None:
    return next((column for column in table.columns if column.quantity == quantity), None)


def _states_unit(table: Table, quantity: str) -> bool:
    column = _find(table, quantity)
    return column is not None and column.unit is not None


def _lengths(table: Table, values: dict[str, Floats], quantities: Three, ask: Ask) -> Floats:
    scaled = []
    for quantity in quantities:
        column = _find(table, quantity)
        assert column is not None
        where = f"{table.path}: {column.name!r}"
        scale = ask.length if column.unit is None else factor(column.unit, LENGTH, where)
        scaled.append(values[quantity] * scale)
    return np.column_stack(scaled)


def _ids(values: dict[str, Floats], quantities: Sequence[str]) -> NDArray[np.int64] | None:
    if not quantities or not values.keys() >= {*quantities}:
        return None
    numbers = np.column_stack([values[name] for name in quantities])
    if not (np.abs(numbers) < 2**53).all() or (numbers != np.rint(numbers)).any():
        return None
    return numbers.astype(np.int64)


def _signals(table: Table, wanted: str | None) -> dict[str, Signal]:
    """What was recorded with the frame: columns of loads, which hold one number all through."""
    found = {}
    for column in table.columns:
        asked = wanted is not None and column.is_called(wanted)
        is_load = column.quantity.startswith("ext.") or is_of_pressure(column.quantity, column.unit)
        if not (asked or is_load) or table.header.count(column.name) > 1:
            continue
        values = table.numbers([column.name])[:, 0]
        values = values[np.isfinite(values)]
        if len(values) and (values == values[0]).all():
            found[column.name] = Signal(
                column.name, column.quantity, column.unit, values[:1], str(table.path)
            )
        elif asked:
            raise InputError(
                f"{table.path}: column {column.name!r} is not one number all through; a pressure "
                "is one number a frame"
            )
    return found
