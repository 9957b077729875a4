"""How does a trial read? Its JSON, which knows its tables."""

from __future__ import annotations

from typing import Any

from bulgefit.dic.frames import Rows, Tabled
from bulgefit.shown import Drawn
from bulgefit.trial.table import report

__all__ = ["TrialAnswer"]

#: Of a test, in the order of the table; what a test does not have is None.
_COLUMNS = ("truth", "verdict", "causes", "right", "place_right", "law_right", "struck", "error")


class TrialAnswer(Drawn, Tabled, dict[str, Any]):
    """Scores and tests of a blind trial, as JSON types; see `bulgefit.run_trial`.

    As a table: a row a test, or family, with its truth, the answer, and whether that is right.
    `causes` are lists of what is named, each with its alternatives.
    """

    def to_dict(self) -> dict[str, Any]:
        """The same without its tables."""
        return dict(self)

    def _rows(self) -> Rows:
        tests = self["tests"]
        table = {name: [test.get(name) for test in tests] for name in _COLUMNS}
        return Rows("file", table, [test["file"] for test in tests])

    def __repr__(self) -> str:
        return self.report().partition("\n\n")[0]

    def report(self) -> str:
        """The table to read."""
        return report(self["scores"])
