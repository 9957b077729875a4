"""What does the name of a column say? A quantity, and often its unit."""

from __future__ import annotations

import re
from dataclasses import dataclass

from bulgefit.dic.units import LENGTH, PRESSURE, TIME, usual

__all__ = ["Column", "column"]

_SQUARE = re.compile(r"(.*?)\s*\[([^\[\]]*)\]")
_ROUND = re.compile(r"(.*?)\s*\(([^()]*)\)")
_SUFFIX = re.compile(r"(.*[^_])_([A-Za-z]+)")
_UNITS = {*LENGTH, *PRESSURE, *TIME, "V", "mV", "N", "kN", "mA"}
# sigma_m and e_s are quantities, so fewer units are believed behind an underscore
_SUFFIXES = {*PRESSURE, "mm", "s", "ms"}


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    name : str
        As the file has it, letter by letter.
    quantity : str
        The name without its unit.
    unit : str or None
        As it is usually written; None where the name states none.
    """

    name: str
    quantity: str
    unit: str | None

    def is_called(self, name: str) -> bool:
        """Whether this is the column `name`, given with or without its unit."""
        return name.strip() in (self.name, self.quantity)


def column(name: str, unit: str | None = None) -> Column:
    """Take a column's name apart; letters keep their case, since X and x are two columns.

    `X [mm]` and `x[mm]` state their unit whatever it is. In `p (bar)` and `p_bar` the end is a
    unit only if it is a known one: names have brackets and underscores of other meanings.

    Parameters
    ----------
    name : str
    unit : str, optional
        What a row of units below the names says.
    """
    name = name.strip().strip('"').strip()
    if found := _SQUARE.fullmatch(name):
        return Column(name, found[1], usual(found[2].strip()))
    for pattern, known in ((_ROUND, _UNITS), (_SUFFIX, _SUFFIXES)):
        found = pattern.fullmatch(name)
        if found and usual(found[2].strip()) in known:
            return Column(name, found[1], usual(found[2].strip()))
    return Column(name, name, None if unit is None else usual(unit))
