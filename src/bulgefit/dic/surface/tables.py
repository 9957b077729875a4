"""What do tables of a measurement hold? Columns by name, with their units, a row a value."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bulgefit.dic.surface.local import Surface
    from bulgefit.dic.surface.measured import Measured
    from bulgefit.dic.surface.rings import Rings

__all__ = ["Table", "tables_of", "values_of"]

Table = dict[str, NDArray[np.float64]]

_UNITS = {"strain": "1", "curvature": "1_per_mm", "tension": "N_per_mm", "stress": "MPa"}


def tables_of(measured: Measured) -> dict[str, Table]:
    """Tables apex, rings, fields and (where it is known) rim; a column is called what_unit."""
    frames = len(measured.pressure)
    found = {
        "apex": _frame_columns(measured, 1) | _values(measured.apex, ("xx", "yy", "xy")),
        "rings": _frame_columns(measured, len(measured.rings.radius))
        | {"radius_mm": np.tile(measured.rings.radius, frames)}
        | _values(measured.rings, ("meridian", "hoop")),
        "fields": _frame_columns(measured, len(measured.surface.points))
        | {
            f"{axis}_mm": np.tile(along, frames)
            for axis, along in zip("xy", measured.surface.points.T, strict=True)
        }
        | _values(measured.surface, ("xx", "yy", "xy")),
    }
    if measured.rim_rotation is not None and measured.rim_shift is not None:
        found["rim"] = _frame_columns(measured, 1)
        for name, values in (
            ("rotation_{}_degree", np.rad2deg(measured.rim_rotation)),
            ("shift_{}_mm", measured.rim_shift),
        ):
            for axis, column in zip("xyz", values.T, strict=True):
                found["rim"][name.format(axis)] = column
    return found


def values_of(table: Table) -> dict[str, str]:
    """Columns of a table that hold what was measured there, with their units."""
    return {
        name: unit.replace("_per_", "/")
        for name in table
        for kind, unit in _UNITS.items()
        if name.startswith(kind)
    }


def _frame_columns(measured: Measured, each: int) -> Table:
    frames = np.arange(len(measured.pressure), dtype=np.float64)
    return {
        "frame": np.repeat(frames, each),
        "pressure_bar": np.repeat(10.0 * measured.pressure, each),
    }


def _values(found: Surface | Rings, parts: tuple[str, ...]) -> Table:
    columns: Table = {}
    for kind, unit in _UNITS.items():
        for noise in ("", "_noise"):
            values = getattr(found, kind + noise)
            if values.ndim == 2:  # one number a place
                columns[f"{kind}{noise}_{unit}"] = values.ravel()
                continue
            for part, column in zip(parts, np.moveaxis(values, -1, 0), strict=True):
                columns[f"{kind}_{part}{noise}_{unit}"] = column.ravel()
    return columns
