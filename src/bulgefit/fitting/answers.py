"""How do an evaluation and a cross-validation read? Their JSON, which knows its tables."""

from __future__ import annotations

from typing import Any

from bulgefit.dic.frames import Rows, Tabled
from bulgefit.fitting.objective import LIKELIHOOD, OBJECTIVES
from bulgefit.fitting.result import unit_of
from bulgefit.shown import Drawn, with_unit

__all__ = ["CrossValidation", "Evaluation"]

#: Of a test, and what they are called.
_PARTS = {"dx": "r_dx", "dy": "r_dy", "dz": "r_dz", **{name: name for name in OBJECTIVES}}


class Evaluation(Drawn, Tabled, dict[str, Any]):
    """Objectives of given parameters, as JSON types; see `bulgefit.evaluate`.

    As a table: a row a test, its mean absolute deviations and objectives in mm.
    """

    def to_dict(self) -> dict[str, Any]:
        """The same without its tables."""
        return dict(self)

    def _rows(self) -> Rows:
        tests = self["tests"]
        table = {shown: [test[key] for test in tests] for key, shown in _PARTS.items()}
        return Rows("test", table, [test["name"] for test in tests], dict.fromkeys(table, "mm"))

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """The table to read."""
        each = self.each()
        names = max(28, *(len(name) + 1 for name, _ in each))
        lines = ["mm".ljust(names) + "".join(f"{shown:>10}" for shown in _PARTS.values())]
        for name, row in each:
            cells = "".join(_cell(row.get(key), ".4f", 10) for key in _PARTS)
            lines.append(name.ljust(names) + cells)
        return "\n".join([*lines, f"weight of dz in e_w: {self['weight']:.4f}"])

    def each(self) -> list[tuple[str, dict[str, Any]]]:
        """Deviations and objectives (mm) of the tests by name, and of several their mean."""
        rows = [(test["name"], test) for test in self["tests"]]
        return [*rows, ("mean over tests", self)] if len(rows) > 1 else rows


class CrossValidation(Drawn, Tabled, dict[str, Any]):
    """Folds of a cross-validation, as JSON types; see `bulgefit.crossval`.

    As a table: a row a fold, named by the test left out, with its parameters (MPa, and as `effects`
    has them), `training` (the fit's objective) and the objectives of the test left out (mm).
    """

    def to_dict(self) -> dict[str, Any]:
        """The same without its tables."""
        return dict(self)

    def _rows(self) -> Rows:
        names = [fold["left_out"] for fold in self["folds"]]
        return Rows("left_out", self._columns(), names, self._units())

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """The table to read; what ended at a bound has a star, and is said below."""
        columns, units = self._columns(), self._units()
        heads = [with_unit(name, units[name]) for name in columns]
        widths = [max(10, len(head) + 2) for head in heads]
        names = max(28, *(len(fold["left_out"]) + 1 for fold in self["folds"]))
        shown = (f"{head:>{width}}" for head, width in zip(heads, widths, strict=True))
        lines = ["left out".ljust(names) + "".join(shown)]
        for fold, row in zip(self["folds"], zip(*columns.values(), strict=True), strict=True):
            cells = "".join(
                _cell(number, ".4g", width, "*" if name in fold["at_bound"] else "")
                for name, number, width in zip(columns, row, widths, strict=True)
            )
            lines.append(fold["left_out"].ljust(names) + cells)
        lines += self._at_bounds()
        mean, spread = self["mean"], self["standard_deviation"]
        lines.append(
            f"{self['judged_by']} left out: "
            + ("not measured" if mean is None else f"mean {mean:.4g} mm")
            + ("" if spread is None else f", standard deviation {spread:.4g} mm")
        )
        return "\n".join(lines)

    def _at_bounds(self) -> list[str]:
        """Which parameters ended at a bound, and in which folds."""
        folds: dict[str, list[str]] = {}
        for fold in self["folds"]:
            for name in fold["at_bound"]:
                folds.setdefault(name, []).append(fold["left_out"])
        return [
            f"* {name} AT BOUND without {', '.join(left_out)}: no result; "
            f"widen --bounds {name.partition('@')[0]}=..."  # folds number tests anew
            for name, left_out in folds.items()
        ]

    def _units(self) -> dict[str, str]:
        """Of the table's columns."""
        return {
            **{name: unit_of(name) for name in self["folds"][0]["parameters"]},
            "training": "1" if self["objective"] == LIKELIHOOD else "mm",
            **dict.fromkeys(OBJECTIVES, "mm"),
        }

    def _columns(self) -> dict[str, list[float | None]]:
        """Of the table, in the order of the folds."""
        folds = self["folds"]
        return {
            **{n: [fold["parameters"][n] for fold in folds] for n in folds[0]["parameters"]},
            "training": [fold["training"]["value"] for fold in folds],
            **{n: [fold["left_out_objectives"][n] for fold in folds] for n in OBJECTIVES},
        }


def _cell(value: float | None, digits: str, width: int, mark: str = "") -> str:
    return f"{('-' if value is None else format(value, digits)) + mark:>{width}}"
