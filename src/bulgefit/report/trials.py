"""How good is the diagnosis? Shares of a blind trial, each with its 95 % interval."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.report import _figure
from bulgefit.report.profiles import MARKERS
from bulgefit.trial.table import shares_in_words

__all__ = ["plot_reliability", "plot_shares", "plot_sizes"]

Share = Mapping[str, Any]


def plot_shares(
    result: Mapping[str, Any], path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw what was found, and what was said wrongly, with Wilson's 95 % intervals.

    Parameters
    ----------
    result : mapping
        What `bulgefit.run_trial` gives.
    path, force
        As of `bulgefit.plot`, as is what is raised.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where nothing was to be found.
    """
    told = shares_in_words(result["scores"])
    if not told:
        return None
    rows = [(words.strip(), share, int(not good)) for share, words, good in told]
    figure, panels = _figure.panels(path, force, (9.5, 1.4 + 0.4 * len(rows)), 1, 1)
    _draw(panels[0, 0], rows, "share (%): the more the better (round), the less (square)")
    return _figure.finished(figure, path, force)


def plot_sizes(
    result: Mapping[str, Any], path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw which share of causes was found, by what they change over the noise.

    None where a trial has no single test with causes; else as `plot_shares`.
    """
    bands = result["scores"]["causes"]["by_size"]
    if not bands:
        return None
    rows = [(f"{_span(band)} times the noise", band, 0) for band in bands]
    figure, panels = _figure.panels(path, force, (8.0, 1.4 + 0.4 * len(rows)), 1, 1)
    _draw(panels[0, 0], rows, "causes found (%), by what nothing else imitates")
    return _figure.finished(figure, path, force)


def plot_reliability(
    result: Mapping[str, Any], path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """Draw how often what was stated with a probability is true; on the line it is as stated.

    None where nothing was stated; else as `plot_shares`.
    """
    told = {what: of["bins"] for what, of in result["scores"]["reliability"].items() if of["bins"]}
    if not told:
        return None
    figure, panels = _figure.panels(path, force, (5.5, 5.0), 1, 1)
    panel = panels[0, 0]
    panel.plot([0.0, 100.0], [0.0, 100.0], color="0.6", linewidth=1.0)
    for (what, bins), (colour, marker) in zip(told.items(), MARKERS, strict=False):
        for number, found in enumerate(bins):
            at, (low, high) = 100.0 * found["stated"], found["wilson"]
            panel.plot([at, at], [100.0 * low, 100.0 * high], color=colour)
            panel.plot(
                at, 100.0 * found["share"], marker, color=colour, label=None if number else what
            )
    panel.legend(fontsize=_figure.FONT)
    _figure.label(panel, "stated probability (%)", "of these true (%)")
    return _figure.finished(figure, path, force)


def _draw(panel: Any, rows: Sequence[tuple[str, Share, int]], title: str) -> None:
    """A row a share (what it is, the share, which marker), its number of tests at the right."""
    for row, (_, share, kind) in enumerate(rows):
        colour, marker = MARKERS[kind]
        panel.plot([100.0 * end for end in share["wilson"]], [row, row], color=colour)
        panel.plot(100.0 * share["share"], row, marker, color=colour)
        panel.text(
            1.02, row, f"{share['hits']} of {share['of']}", fontsize=_figure.FONT, va="center",
            transform=panel.get_yaxis_transform(),
        )  # fmt: skip
    _figure.label(panel, title, "")
    panel.set_yticks(range(len(rows)), [words for words, *_ in rows])
    panel.set_ylim(len(rows) - 0.5, -0.5)
    panel.set_xlim(-2.0, 102.0)


def _span(band: Mapping[str, Any]) -> str:
    low = f"{band['from']:g}"
    return f"{low} and more" if band["to"] is None else f"{low} to {band['to']:g}"
