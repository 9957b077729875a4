"""How do results reach pandas and xarray? Where these are installed, as extras."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError

__all__ = ["Rows", "Tabled", "dataframe", "labelled"]


@dataclass(frozen=True)
class Rows:
    """A table, a row a thing of one kind.

    Attributes
    ----------
    each : str
        What a row is, such as "parameter".
    columns : mapping of name to values
        None where a row has no value.
    index : sequence of str, optional
        Names of the rows; by default they are counted.
    units : mapping of name to unit
        Of the columns that have one.
    """

    each: str
    columns: Mapping[str, Sequence[Any] | NDArray[Any]]
    index: Sequence[str] | None = None
    units: Mapping[str, str] = field(default_factory=dict)


class Tabled(ABC):
    """A result that is a table."""

    @abstractmethod
    def _rows(self) -> Rows:
        """The table."""

    def to_dataframe(self) -> Any:
        """The table as a pandas.DataFrame; needs `bulgefit[pandas]`."""
        told = self._rows()
        return dataframe(told.columns, told.index)

    def to_xarray(self) -> Any:
        """The table as an xarray.Dataset; needs `bulgefit[xarray]`.

        A variable a column, by what a row is; lengths, moduli and so on have `units`. What a row
        does not have is NaN, or an empty text. Both ends of an interval are along `end`, and lists
        of words are texts.
        """
        told = self._rows()
        variables = {}
        for name, values in told.columns.items():
            array = _plain(values)
            unit = {"units": told.units[name]} if name in told.units else {}
            variables[name] = ((told.each, "end")[: array.ndim], array, unit)
        coords = {} if told.index is None else {told.each: list(told.index)}
        return _extra("xarray").Dataset(variables, coords=coords)


def dataframe(columns: Mapping[str, Any], index: Sequence[str] | None = None) -> Any:
    """A pandas.DataFrame; InputError where pandas is not installed."""
    return _extra("pandas").DataFrame(dict(columns), index=index)


def labelled(
    values: Any, dims: Sequence[str], coords: Mapping[str, Any], *, name: str, unit: str
) -> Any:
    """An xarray.DataArray with its unit; InputError where xarray is not installed."""
    return _extra("xarray").DataArray(
        values, dims=dims, coords=dict(coords), name=name, attrs={"units": unit}
    )


def _extra(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(
            f'{name} is not installed; pip install "bulgefit[{name}]" brings it'
        ) from None


def _plain(values: Sequence[Any] | NDArray[Any]) -> NDArray[Any]:
    """Values of a column as numbers, (rows, 2) of intervals, or texts: what a file can hold."""
    known = [value for value in values if value is not None]
    if all(isinstance(value, Real | np.bool_) for value in known):
        return np.array([np.nan if value is None else value for value in values])
    if all(_is_interval(value) for value in known):
        return np.array([(np.nan, np.nan) if value is None else value for value in values])
    return np.array([_text(value) for value in values])


def _is_interval(value: Any) -> bool:
    return len(value) == 2 and all(isinstance(end, Real) for end in value)


def _text(value: Any) -> str:
    """Words joined, those of a set within by "or"."""
    if isinstance(value, str) or value is None:
        return value or ""
    return ", ".join(" or ".join(v) if not isinstance(v, str) else v for v in value)
