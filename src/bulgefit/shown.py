"""How does a result show itself, in a notebook and by a picture that is made floors above it?

Figures are drawn in `report`, which knows every result; a result knows no figure. So the package's
roof says who draws, and a result passes itself on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

__all__ = ["Drawn", "after_value", "drawn_by", "number_of", "plain", "some_of", "with_unit"]

#: Who draws results; the roof hangs it here.
_drawer: list[Callable[..., Any]] = []


def drawn_by(drawer: Callable[..., Any]) -> None:
    """Let results be drawn by `drawer(result, kind, **how)`."""
    _drawer[:] = [drawer]


def plain(value: float, digits: int) -> str:
    """A number to so many digits, and large ones without a power of ten: 100, not 1e+02."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text


def number_of(count: int, what: str) -> str:
    """A number of things, in the singular where it is one."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def some_of(names: Sequence[str], most: int = 5) -> str:
    """The first of many names, and how many there are beside them."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def after_value(unit: str) -> str:
    """A unit as it stands after a value: nothing where it is "1", that of a pure number."""
    return "" if unit == "1" else f" {unit}"


def with_unit(name: str, unit: str) -> str:
    """What heads a column or an axis: the name, and its unit in brackets unless that is "1"."""
    return name if unit == "1" else f"{name} ({unit})"


class Drawn:
    """What a notebook shows as it shows on a terminal, and what has figures."""

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def plot(self, kind: str | None = None, **how: Any) -> Any:
        """Draw one of the figures that this result has.

        Parameters
        ----------
        kind : str, optional
            Which; `bulgefit.plot` tells the kinds of each result and which is the first.
        **how
            As `bulgefit.plot` takes it, such as `path`.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        InputError
            It has no such figure, or the file cannot be written.
        """
        (drawer,) = _drawer
        return drawer(self, kind, **how)
