"""How much do specimens differ? The parameters of several fits, and their spread over the fits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy.stats import chi2

from bulgefit.dic.frames import Rows, Tabled
from bulgefit.errors import InputError, needed
from bulgefit.fitting.result import FitResult
from bulgefit.shown import Drawn, plain

__all__ = ["SCATTERED", "Batch", "Spread", "batch_of", "spread_of"]

#: Probability below which what the standard errors say of the scatter is not believed.
SCATTERED = 0.05

_FIT = "what bulgefit.fit gives"


@dataclass(frozen=True)
class Spread:
    """A parameter over several specimens.

    Attributes
    ----------
    unit : str
    count : int
        Specimens that count: a value at a bound, or one that is not determined, is none.
    mean : float or None
        Each specimen counts alike; None without any.
    standard_deviation, error_of_mean : float or None
        Over specimens; None of one.
    scatter : float or None
        Standard deviation beyond the standard errors: the root of the variance over specimens less
        the mean squared error, 0 where that is negative (Hedges and Olkin, 1985, "Statistical
        methods for meta-analysis", section 9.C).
    chi_square : float or None
        Of the values about their weighted mean, by their standard errors, with count - 1 degrees of
        freedom (Cochran, 1954, Biometrics 10, 101).
    probability : float or None
        Of a larger chi_square, did the specimens not differ.
    """

    unit: str
    count: int
    mean: float | None = None
    standard_deviation: float | None = None
    error_of_mean: float | None = None
    scatter: float | None = None
    chi_square: float | None = None
    probability: float | None = None


def spread_of(values: Sequence[float], errors: Sequence[float], unit: str) -> Spread:
    """The spread of a parameter.

    Parameters
    ----------
    values, errors : (specimens,) sequences
        With their standard errors, in the unit.
    unit : str
    """
    count = len(values)
    if count == 0:
        return Spread(unit, 0)
    value, error = np.array(values), np.array(errors)
    mean = float(value.mean())
    if count == 1:
        return Spread(unit, 1, mean)
    variance = float(value.var(ddof=1))
    weight = error**-2.0
    about = value - (weight @ value) / weight.sum()
    square = float(weight @ about**2)
    return Spread(
        unit,
        count,
        mean,
        float(np.sqrt(variance)),
        float(np.sqrt(variance / count)),
        float(np.sqrt(max(variance - float((error**2).mean()), 0.0))),
        square,
        float(chi2.sf(square, count - 1)),
    )


@dataclass(frozen=True, eq=False)
class Batch(Drawn, Tabled):
    """Specimens that were fitted one by one.

    As a table: a row a specimen, each parameter with its standard error (`E1_stderr`); NaN where a
    specimen does not tell it.

    Attributes
    ----------
    fits : tuple of FitResult
        Of one test each, with the same parameters.
    spreads : dict of name to Spread
        Of the free parameters.
    unfitted : dict of name to str
        Why specimens could not be fitted.
    """

    fits: tuple[FitResult, ...]
    spreads: dict[str, Spread]
    unfitted: dict[str, str] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """What the fitted specimens are called."""
        return [fit.sources[0]["name"] for fit in self.fits]

    def to_dict(self) -> dict[str, Any]:
        """As JSON types."""
        return {
            "specimens": [
                {"name": n, **f.to_dict()} for n, f in zip(self.names, self.fits, strict=True)
            ],
            "not_fitted": [{"name": n, "reason": why} for n, why in self.unfitted.items()],
            "spread": {name: asdict(spread) for name, spread in self.spreads.items()},
        }

    def rows(self) -> list[list[str]]:
        """A table of text cells, numbers in full: a head, a row a specimen, then the spread.

        The last column says why a specimen could not be fitted.
        """
        head = ["specimen"]
        for name, spread in self.spreads.items():
            unit = "" if spread.unit == "1" else f"_{spread.unit}"
            head += [f"{name}{unit}", f"{name}_stderr{unit}"]
        rows = [[*head, "not_fitted"]]
        for name, fit in zip(self.names, self.fits, strict=True):
            row = [name]
            for parameter in self.spreads:
                found = _found(fit, parameter)
                row += ["", ""] if found is None else [repr(number) for number in found]
            rows.append([*row, ""])
        for name, why in self.unfitted.items():
            rows.append([name, *[""] * (len(head) - 1), why])
        for of in ("mean", "standard_deviation", "scatter"):
            numbers = [getattr(spread, of) for spread in self.spreads.values()]
            cells = [["" if number is None else repr(number), ""] for number in numbers]
            rows.append([of, *(cell for pair in cells for cell in pair), ""])
        return rows

    def _rows(self) -> Rows:
        table: dict[str, tuple[float, ...]] = {}
        units: dict[str, str] = {}
        for name, spread in self.spreads.items():
            found = [_found(fit, name) or (np.nan, np.nan) for fit in self.fits]
            columns = (name, f"{name}_stderr")
            table |= dict(zip(columns, zip(*found, strict=True), strict=True))
            units |= dict.fromkeys(columns, spread.unit)
        return Rows("specimen", table, self.names, units)

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """The table to read."""
        names = list(self.spreads)
        width = max(20, *(len(name) for name in (*self.names, *self.unfitted))) + 2
        units = [f"{n} ({s.unit})" if s.unit != "1" else n for n, s in self.spreads.items()]
        widths = [max(24, len(unit) + 2) for unit in units]
        lines = [_line("specimen", width, units, widths)]
        for specimen, fit in zip(self.names, self.fits, strict=True):
            cells = [_cell(_found(fit, name)) for name in names]
            lines.append(_line(specimen, width, cells, widths))
        without = ["not fitted"] * len(names)
        lines += [_line(specimen, width, without, widths) for specimen in self.unfitted]
        for words, of in (
            ("mean", "mean"),
            ("standard deviation", "standard_deviation"),
            ("beyond the errors", "scatter"),
        ):
            numbers = [getattr(spread, of) for spread in self.spreads.values()]
            cells = ["-" if number is None else f"{number:.5g}" for number in numbers]
            lines.append(_line(words, width, cells, widths))
        return "\n".join([*lines, *self._verdicts()])

    def _verdicts(self) -> list[str]:
        """What could not be fitted, or looks wrong, and what the scatter says of each parameter."""
        out = [f"{name}: not fitted: {why}" for name, why in self.unfitted.items()]
        for specimen, fit in zip(self.names, self.fits, strict=True):
            said = (warned.text.removeprefix(f"{specimen}: ") for warned in fit.quality.warnings)
            out += [f"WARNING: {specimen}: {text}" for text in said]
        for name, spread in self.spreads.items():
            if spread.count < len(self.fits):
                left_out = len(self.fits) - spread.count
                out.append(f"{name}: {left_out} of {len(self.fits)} specimens do not tell it")
            if spread.probability is None or not spread.mean:
                continue
            if spread.probability < SCATTERED:
                share = 100.0 * (spread.scatter or 0.0) / abs(spread.mean)
                out.append(
                    f"{name}: the specimens differ by more than their standard errors (chi² "
                    f"{spread.chi_square:.3g} of {spread.count - 1}, probability "
                    f"{spread.probability:.2g}); {plain(share, 2)} % of the mean beyond them"
                )
            else:
                out.append(f"{name}: the specimens differ by no more than their standard errors")
        return out


def batch_of(fits: Sequence[FitResult], unfitted: Mapping[str, str] | None = None) -> Batch:
    """The spread over fits of one specimen each.

    Parameters
    ----------
    fits : sequence of FitResult
    unfitted : mapping of name to str, optional
        Specimens that could not be fitted, and why.

    Raises
    ------
    InputError
        No fits, or fits of different parameters.
    """
    fits = [needed(fit, FitResult, _FIT) for fit in needed(fits, Iterable, f"a list of {_FIT}")]
    if not fits:
        raise InputError("a batch needs a fit")
    free = {p.name: p.unit for p in fits[0].free}
    for fit in fits:
        if {p.name: p.unit for p in fit.free} != free:
            raise InputError("a batch: its fits have different free parameters")
    spreads = {}
    for name, unit in free.items():
        found = [pair for fit in fits if (pair := _found(fit, name)) is not None]
        spreads[name] = spread_of([v for v, _ in found], [e for _, e in found], unit)
    return Batch(tuple(fits), spreads, dict(unfitted or {}))


def _found(fit: FitResult, name: str) -> tuple[float, float] | None:
    """Value and standard error; None at a bound, or where nothing tells it."""
    error = fit.uncertainty.stderr[name]
    if error is None:
        return None
    return float({**fit.material.values, **fit.effects}[name]), float(error)


def _line(first: str, width: int, cells: Sequence[str], widths: Sequence[int]) -> str:
    """A row of a table, the first cell to the left."""
    rest = (f"{cell:>{wide}}" for cell, wide in zip(cells, widths, strict=True))
    return first.ljust(width) + "".join(rest)


def _cell(found: tuple[float, float] | None) -> str:
    return "not determined" if found is None else f"{found[0]:.5g} ± {found[1]:.2g}"
