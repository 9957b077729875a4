"""How do results reach pandas and xarray? Where these are installed, as extras."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.errors import InputError

__all__ = ["dataframe", "labelled"]


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
