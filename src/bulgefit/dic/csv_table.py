"""How is a table of numbers read, whatever its separator, with errors that name the cell?"""

from __future__ import annotations

import csv
import io
import reprlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.registry import text_of
from bulgefit.errors import InputError

__all__ = ["Table", "read_table"]

_SEPARATORS = (",", ";", "\t")
_LOST = ("", "nan", "na", "n/a", "-")


@dataclass(frozen=True)
class Table:
    """A CSV file: its header, and its body as text.

    Attributes
    ----------
    path : Path
    header : tuple of str
        Column names.
    separator : str
    body : str
        The lines below the header; decimal commas have become points.
    first_line : int
        Line of the file (from 1) where the body begins.
    """

    path: Path
    header: tuple[str, ...]
    separator: str
    body: str
    first_line: int

    def numbers(self, names: Sequence[str]) -> NDArray[np.float64]:
        """(rows, names) array of the named columns; NaN where a cell is empty or nan."""
        columns = [self._column(name) for name in names]
        if not self.body.strip():
            return np.empty((0, len(columns)))
        try:
            return np.loadtxt(
                io.StringIO(self.body),
                delimiter=self.separator,
                usecols=columns,
                ndmin=2,
                comments=None,
                quotechar='"',
            )
        except ValueError:
            # empty cells, or an error that has to be named: the slow way sees each cell
            return self._numbers_by_cell(columns)

    def texts(self, name: str) -> list[str]:
        """The cells of the named column."""
        column = self._column(name)
        return [self._cell(row, column, line) for line, row in self._rows()]

    def need_named_cells(self) -> None:
        """Refuse rows with more cells than the header: they would shift what the columns hold."""
        for line, row in self._rows():
            if any(map(str.strip, row[len(self.header) :])):
                raise InputError(
                    f"{self.path}: line {line} has {len(row)} cells, the header "
                    f"{len(self.header)}; name every column, and where the comma is decimal "
                    "separate cells by ;"
                )

    def _numbers_by_cell(self, columns: Sequence[int]) -> NDArray[np.float64]:
        values = [
            [self._number(self._cell(row, column, line), column, line) for column in columns]
            for line, row in self._rows()
        ]
        return np.array(values, dtype=np.float64).reshape(-1, len(columns))

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        return _rows(self.path, self.body, self.separator, self.first_line)

    def _column(self, name: str) -> int:
        if name not in self.header:
            raise InputError(
                f"{self.path}: has no column {name!r}; found {', '.join(self.header)} "
                "(say what it is called with --columns)"
            )
        if self.header.count(name) > 1:
            raise InputError(
                f"{self.path}: has {self.header.count(name)} columns {name!r}; give each its own "
                "name"
            )
        return self.header.index(name)

    def _cell(self, row: list[str], column: int, line: int) -> str:
        if column >= len(row):
            raise InputError(
                f"{self.path}: line {line} ends before the column {self.header[column]!r}"
            )
        return row[column].strip()

    def _number(self, cell: str, column: int, line: int) -> float:
        if cell.lower() in _LOST:
            return np.nan
        # float() takes 1_0 for 10, which numpy refuses where all cells are numbers
        if "_" not in cell and cell.isascii():
            with suppress(ValueError):
                return float(cell)
        raise InputError(
            f"{self.path}: line {line}, column {self.header[column]!r}: {reprlib.repr(cell)} is "
            "not a number; leave the cell empty where the point is lost"
        )


def _rows(
    path: Path, text: str, separator: str, first_line: int
) -> Iterator[tuple[int, list[str]]]:
    """The rows that are not blank, each with the line of the file on which it begins."""
    rows = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
    line = first_line
    try:
        for row in rows:
            if any(map(str.strip, row)):
                yield line, row
            line = first_line + rows.line_num
    except csv.Error as error:
        raise InputError(
            f"{path}: line {line} begins no row of cells ({error}); check its quotes"
        ) from None


def read_table(path: Path) -> Table:
    """Read a CSV file, separated by commas, semicolons or tabs.

    The header is the first line that is not blank; a leading # is allowed. In a file separated
    by semicolons or tabs a comma is a decimal comma.
    """
    # a header may hold a degree or micro sign in another encoding; numbers are plain ASCII
    text = text_of(path, errors="replace")
    lines = text.split("\n")
    start = next((i for i, line in enumerate(lines) if line.strip()), None)
    if start is None:
        raise InputError(f"{path}: is empty; it needs a header and rows")
    if "\0" in lines[start]:
        raise InputError(f"{path}: is not a text file; it must be CSV")
    head = lines[start].lstrip("# ").strip("\r")
    separator = max(_SEPARATORS, key=head.count)
    _, names = next(_rows(path, head, separator, start + 1), (0, []))
    body = "\n".join(lines[start + 1 :])
    if separator != ",":
        body = body.replace(",", ".")
    table = Table(path, tuple(name.strip() for name in names), separator, body, start + 2)
    table.need_named_cells()
    return table
