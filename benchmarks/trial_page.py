"""How do the results of a blind trial read? As Markdown, with a line for each wrong answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.trial.table import report

__all__ = ["section"]


def section(
    title: str, words: str, scores: Mapping[str, Any], tests: Sequence[Mapping[str, Any]]
) -> str:
    """Title, words on the tests, their figures, and which of them are not right."""
    parts = [f"## {title}", words, f"```\n{report(scores)}\n```"]
    if wrong := [test for test in tests if not test["right"]]:
        parts += ["Not right:", "\n".join(_line(test) for test in wrong)]
    return "\n\n".join(parts)


def _line(test: Mapping[str, Any]) -> str:
    causes = " + ".join("/".join(cause) for cause in test["causes"])
    size = test["signature_mm"]
    worth = "" if size is None else f"({size:.3f} mm) "
    return (
        f"- {test['file']}: {' + '.join(test['truth']) or 'none'} {worth}"
        f"answered {test['verdict']} {causes}".rstrip()
    )
