"""How does a trial read? Its JSON, which knows its tables."""

from __future__ import annotations

from typing import Any

from bulgefit.dic.frames import dataframe
from bulgefit.shown import Drawn
from bulgefit.trial.table import report

__all__ = ["TrialAnswer"]

#: Of a test, in the order of the table; what a test does not have is None.
_COLUMNS = ("truth", "verdict", "causes", "right", "place_right", "law_right", "struck", "error")


class TrialAnswer(Drawn, dict[str, Any]):
    """Scores and tests of a blind trial, as JSON types; see `bulgefit.run_trial`."""

    def to_dict(self) -> dict[str, Any]:
        """The same without its tables."""
        return dict(self)

    def to_dataframe(self) -> Any:
        """A row a test, or family: its truth, the answer, whether that is right.

        `causes` are lists of what is named, each with its alternatives. Needs `bulgefit[pandas]`.
        """
        tests = self["tests"]
        table = {name: [test.get(name) for test in tests] for name in _COLUMNS}
        return dataframe(table, index=[test["file"] for test in tests])

    def __repr__(self) -> str:
        return self.report().partition("\n\n")[0]

    def report(self) -> str:
        """The table to read."""
        return report(self["scores"])
