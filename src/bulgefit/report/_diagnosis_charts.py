"""Which effects are alike, and what does each take off the gap?"""

from __future__ import annotations

import os
from typing import Any

from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.gap.follow_up.separate import ALIKE, cosine_matrix
from bulgefit.report import _figure
from bulgefit.report.record import Record
from bulgefit.report.words.names import budget_labels, names_of

__all__ = ["plot_budget", "plot_cosines"]

_BLUE, _ORANGE, _GREEN, _VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"


def plot_cosines(
    diagnosis: Diagnosis, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """The largest cosine between the signatures of each two effects; None for fewer than two."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    names, cosine = cosine_matrix(diagnosis.explanation.known)
    count = len(names)
    if count < 2:
        return None
    side = 0.55 * max(count, 6) + 2.6
    figure = Figure(figsize=(side + 0.8, side), layout="constrained")
    panel = figure.subplots()
    drawn = panel.imshow(cosine, cmap="cividis", vmin=0.0, vmax=1.0)
    for i in range(count):
        for j in range(count):
            shown = f"{cosine[i, j]:.2f}"
            panel.text(
                j, i, shown, ha="center", va="center",
                fontsize=_figure.FONT - 2, color="black" if cosine[i, j] > 0.55 else "white",
            )  # fmt: skip
            if i != j and float(shown) >= ALIKE:  # as it reads
                corner = (j - 0.46, i - 0.46)
                panel.add_patch(
                    Rectangle(corner, 0.92, 0.92, fill=False, edgecolor=_VERMILION, linewidth=2.0)
                )
    panel.set_xticks(range(count), names, rotation=45, ha="right", rotation_mode="anchor")
    panel.set_yticks(range(count), names)
    panel.tick_params(labelsize=_figure.FONT - 1, length=0)
    named = {group.effect for group in diagnosis.explanation.groups}
    for labels in (panel.get_xticklabels(), panel.get_yticklabels()):
        for label in labels:
            if label.get_text() in named:
                label.set_fontweight("bold")
    colour_bar = figure.colorbar(drawn, ax=panel, shrink=0.7, pad=0.02)
    colour_bar.set_label("cosine, moduli projected out", fontsize=_figure.FONT)
    panel.set_title(
        f"How alike are the effects in this data?\nFramed: {ALIKE:g} and more; bold: in the model",
        fontsize=_figure.FONT + 1,
    )
    return _figure.finished(figure, path, force)


def plot_budget(
    record: Record, path: str | os.PathLike[str] | None = None, *, force: bool = False
) -> Any:
    """The budget as a waterfall: from the moduli alone over each effect down to the noise."""
    from matplotlib.figure import Figure

    told = record["report"]
    floor, mesh = record["gap"]["noise_floor"]["e_w"], told["mesh_error_mm"]
    labels = budget_labels(record)
    rows = {
        title: list(zip(labels, (row[key] for row in told["budget"]), strict=True))
        for title, key in (("fitted", "fitted_mm"), ("held-out", "heldout_mm"))
    }
    count = len(labels) + 3 + (mesh is not None)
    figure = Figure(figsize=(13, 0.5 * count + 1.7), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True, sharex=True)
    for panel, (title, found) in zip(panels, rows.items(), strict=True):
        _draw_budget(panel, found, floor, mesh)
        panel.set_title(f"{title} data", fontsize=_figure.FONT + 1)
    figure.suptitle(
        f"{', '.join(names_of(record))}: budget of the gap",
        fontsize=_figure.FONT + 2,
    )
    return _figure.finished(figure, path, force)


def _draw_budget(
    panel: Any, found: list[tuple[str, float]], floor: float, mesh: float | None
) -> None:
    (first, start), *effects = found
    left = effects[-1][1] if effects else start
    bars = [(first, 0.0, start, _BLUE, f"{start:.4f}")]
    at = start
    for name, value in effects:
        low, high = sorted((value, at))
        colour = _GREEN if value <= at else _VERMILION
        change = round(value - at, 4) + 0.0  # not -0.0
        bars.append((name, low, high, colour, f"{change:+.4f}"))
        at = value
    bars.append(("remaining", 0.0, left, _BLUE, f"{left:.4f}"))
    bars.append(("of which noise", 0.0, min(floor, left), "0.6", f"floor {floor:.4f}"))
    beyond = max(left - floor, 0.0)
    bars.append(("unexplained", min(floor, left), left, _ORANGE, f"{beyond:.4f}"))
    if mesh is not None:
        bars.append(("mesh error, taken off", 0.0, mesh, "0.8", f"{mesh:.4f}"))
    reach = max(high for _, _, high, _, _ in bars)
    for row, (_, low, high, colour, text) in enumerate(bars):
        panel.barh(row, high - low, left=low, color=colour, height=0.62)
        panel.text(
            high + 0.012 * reach, row, text, va="center", fontsize=_figure.FONT,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )  # fmt: skip
    for row, level in enumerate([start, *(value for _, value in effects)]):
        panel.plot([level, level], [row + 0.31, row + 0.69], color="0.5", linewidth=0.8)
    panel.axvline(floor, color="0.4", linewidth=1.0, linestyle=":")
    panel.set_yticks(range(len(bars)), [name for name, *_ in bars])
    # from the top down, without the margins of a twentieth, which many bars make wide
    panel.set_ylim(len(bars) - 0.4, -0.6)
    panel.set_xlim(0.0, 1.2 * reach)
    panel.set_xlabel("e_w (mm); dotted: noise floor", fontsize=_figure.FONT)
    panel.tick_params(labelsize=_figure.FONT)
    panel.spines[["top", "right"]].set_visible(False)
