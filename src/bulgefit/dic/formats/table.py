"""How is a table of numbers read, whatever its separator, with errors that name the cell?"""

from __future__ import annotations

import csv
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.formats.encoding import text_of
from bulgefit.dic.formats.names import Column, column
from bulgefit.errors import InputError

__all__ = ["BLANKS", "Header", "Table", "find_header", "headers_of", "read_table"]

#: The separator of tables whose cells are kept apart by blanks.
BLANKS = " "
_SEPARATORS = (",", ";", "\t")
_LOST = ("", "nan", "na", "n/a", "-", "nan(ind)", "-nan(ind)", "-1.#ind", "1.#qnan", "-1.#qnan")
_NUMBER = re.compile(r"\s*[-+]?[.,]?\d+([.,]\d*)?([eE][-+]?\d+)?\s*([,;\t ]|$)")
_COMMENT = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
# Lines before the header; DIC systems write some tens of them.
_LONGEST_PREAMBLE = 500

Wanted = Callable[[Sequence[Column]], bool]


@dataclass(frozen=True)
class Header:
    """Where the names of the columns stand.

    Attributes
    ----------
    line : int
        Index of the line, from 0.
    separator : str
    columns : tuple of Column
    """

    line: int
    separator: str
    columns: tuple[Column, ...]


@dataclass(frozen=True)
class Table:
    """A file of cells: its columns, and its body as text.

    Attributes
    ----------
    path : Path
    columns : tuple of Column
    separator : str
    preamble : str
        The lines above the header.
    body : str
        The lines below it.
    first_line : int
        Line of the file (from 1) where the body begins.
    """

    path: Path
    columns: tuple[Column, ...]
    separator: str
    preamble: str
    body: str
    first_line: int

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    def numbers(self, names: Sequence[str]) -> NDArray[np.float64]:
        """(rows, names) array of the named columns; NaN where a cell is empty or nan."""
        columns = [self._column(name) for name in names]
        body = self._with_points(self.body)
        if not body.strip():
            return np.empty((0, len(columns)))
        try:
            return np.loadtxt(
                _lines(body),
                delimiter=None if self.separator == BLANKS else self.separator,
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
        if '"' not in self.body and self.separator != BLANKS:
            # without quotes the separators count the cells, which is many times faster
            most, longest = len(self.columns) - 1, csv.field_size_limit()
            rows = _lines(self.body)
            if all(row.count(self.separator) <= most and len(row) < longest for row in rows):
                return
        for line, row in self._rows():
            if any(map(str.strip, row[len(self.columns) :])):
                raise InputError(
                    f"{self.path}: line {line} has {len(row)} cells, the header "
                    f"{len(self.columns)}; name every column, and where the comma is decimal "
                    "separate cells by ;"
                )

    def _numbers_by_cell(self, columns: Sequence[int]) -> NDArray[np.float64]:
        values = [
            [self._number(self._cell(row, column, line), column, line) for column in columns]
            for line, row in self._rows()
        ]
        return np.array(values, dtype=np.float64).reshape(-1, len(columns))

    def _with_points(self, text: str) -> str:
        # where the comma does not separate cells it is decimal
        return text if self.separator == "," else text.replace(",", ".")

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        return _rows(self.path, self.body, self.separator, self.first_line)

    def _column(self, name: str) -> int:
        found = [i for i, column in enumerate(self.columns) if column.name == name]
        if not found:
            raise InputError(
                f"{self.path}: has no column {name!r}; found {', '.join(self.header)} "
                "(say what it is called with --columns)"
            )
        if len(found) > 1 and not self._are_equal(found):
            raise InputError(
                f"{self.path}: has {len(found)} columns {name!r} that differ; give each its own "
                "name"
            )
        return found[0]

    def _are_equal(self, columns: Sequence[int]) -> bool:
        """Whether columns of one name hold the same cells: some exports write a column twice."""
        rows = (row for _, row in self._rows())
        return all(len({row[i] if i < len(row) else "" for i in columns}) == 1 for row in rows)

    def _cell(self, row: list[str], column: int, line: int) -> str:
        if column >= len(row):
            raise InputError(
                f"{self.path}: line {line} ends before the column {self.header[column]!r}"
            )
        return row[column].strip()

    def _number(self, cell: str, column: int, line: int) -> float:
        number = self._with_points(cell)
        if number.lower() in _LOST:
            return np.nan
        # float() takes 1_0 for 10, which numpy refuses where all cells are numbers
        if "_" not in number and number.isascii():
            with suppress(ValueError):
                return float(number)
        raise InputError(
            f"{self.path}: line {line}, column {self.header[column]!r}: {reprlib.repr(cell)} is "
            "not a number; a cell is empty where a point is lost"
        )


def read_table(path: Path, wanted: Wanted | None = None) -> Table:
    """Read a table whose cells are separated by commas, semicolons, tabs or blanks.

    Where the comma does not separate it is decimal. A # before the names is allowed, and a row of
    units below them.

    Parameters
    ----------
    path : Path
    wanted : callable, optional
        Whether columns are those of the header; by default it is the first line that is not
        blank. Lines that begin with # are comments where this is given.
    """
    text = text_of(path)
    # the body is not taken apart into lines: that would take several times its memory
    lines = text.split("\n", _LONGEST_PREAMBLE)[:_LONGEST_PREAMBLE]
    header = _first_line(path, lines) if wanted is None else find_header(headers_of(lines), wanted)
    if header is None:
        raise InputError(f"{path}: has no line with the names of the columns; export it anew")
    columns, used = _units_below(header, lines[header.line + 1 :])
    below = header.line + 1 + used
    body = text[sum(len(line) + 1 for line in lines[:below]) :]
    if wanted is not None and _COMMENT.search(body):
        body = _COMMENT.sub("", body)
    table = Table(path, columns, header.separator, "\n".join(lines[: header.line]), body, below + 1)
    table.need_named_cells()
    return table


def headers_of(lines: Sequence[str]) -> Iterator[Header]:
    """Every line that may name columns, by every separator by which it has several cells."""
    for i, line in enumerate(lines[:_LONGEST_PREAMBLE]):
        if _NUMBER.match(line):  # a row of numbers; to tell that early is what makes this fast
            continue
        for separator in (*_SEPARATORS, BLANKS):
            if len(cells := _cells(line.lstrip("# "), separator)) > 1:
                yield Header(i, separator, tuple(map(column, cells)))


def find_header(headers: Iterable[Header], wanted: Wanted) -> Header | None:
    """The first of the lines that name columns whose columns are the wanted ones.

    Parameters
    ----------
    headers : iterable of Header
    wanted : callable
        Whether a sequence of Column is that of the header.
    """
    return next((header for header in headers if wanted(header.columns)), None)


def _first_line(path: Path, lines: Sequence[str]) -> Header:
    start = next((i for i, line in enumerate(lines) if line.strip()), None)
    if start is None:
        raise InputError(f"{path}: is empty; it needs a header and rows")
    if "\0" in lines[start]:
        raise InputError(f"{path}: is not a text file; it must be CSV")
    head = lines[start].lstrip("# ")
    separator = max(_SEPARATORS, key=head.count)
    _, names = next(_rows(path, head, separator, start + 1), (0, []))
    return Header(start, separator, tuple(column(name) for name in names))


def _cells(line: str, separator: str) -> list[str]:
    """The cells of a header; names with one blank in them are kept apart by two or more."""
    if separator == BLANKS:
        if '"' in line:  # names that blanks keep apart have none in them, and need no quotes
            return []
        # a unit belongs to the name before it
        return re.split(r"\s{2,}" if "  " in line.strip() else r"\s+(?!\[)", line.strip())
    if separator not in line:
        return []
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    except csv.Error:
        return []
    # a separator at the end of the line is no further column
    return cells[:-1] if cells and not cells[-1].strip() else cells


def _units_below(header: Header, body: Sequence[str]) -> tuple[tuple[Column, ...], int]:
    """The columns with the units of a row below their names, and how many lines that took."""
    line = next((line for line in body if line.strip()), "")
    cells = [cell.strip() for cell in line.split(header.separator)]
    if (
        header.separator == BLANKS
        or len(cells) > len(header.columns)
        or not any(cells)
        or any(re.search(r"\d", cell) or len(cell) > 10 for cell in cells)
        or all(cell.lower() in _LOST for cell in cells)
    ):
        return header.columns, 0
    units = [*cells, *[""] * (len(header.columns) - len(cells))]
    columns = tuple(
        Column(known.name, known.quantity, known.unit if known.unit is not None else unit or None)
        for known, unit in zip(header.columns, units, strict=True)
    )
    return columns, [*body].index(line) + 1


def _lines(text: str) -> Iterator[str]:
    """The lines of a text, one at a time."""
    start = 0
    while (end := text.find("\n", start)) >= 0:
        yield text[start:end]
        start = end + 1
    if start < len(text):
        yield text[start:]


def _rows(
    path: Path, text: str, separator: str, first_line: int
) -> Iterator[tuple[int, list[str]]]:
    """The rows that are not blank, each with the line of the file on which it begins."""
    if separator == BLANKS:
        for line, cells in enumerate(_lines(text), first_line):
            if cells.strip():
                yield line, cells.split()
        return
    lines = (f"{line}\n" for line in _lines(text))
    rows = csv.reader(lines, delimiter=separator, strict=True)
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
