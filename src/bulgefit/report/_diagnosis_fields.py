"""Which fields were measured, which modelled, and which part of the gap is each effect's?"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from bulgefit.gap.diagnosis import Diagnosis
from bulgefit.report import _figure
from bulgefit.report._diagnosis_parts import (
    COMPONENTS,
    SIGNED,
    acting_on,
    colour_bar,
    data_of,
    draw_points,
    frames_of,
    limit_of,
    outer_ticks,
    residual_of,
    rms,
    with_causes,
)

__all__ = ["plot_component", "plot_signatures"]

#: Rows of maps; pressures and effects of the signatures.
PRESSURES, SIGNATURE_PRESSURES, MOST_EFFECTS = 4, 2, 4


def plot_component(
    diagnosis: Diagnosis,
    index: int,
    component: int,
    path: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
) -> Any:
    """Maps of one component: measured, modelled, and residuals before and after, by pressure."""
    from matplotlib.figure import Figure

    data, found = data_of(diagnosis)[index], diagnosis.explanation
    frames, name = frames_of(data, PRESSURES), COMPONENTS[component]
    measured = np.where(data.used, data.specimen.measured, np.nan)[frames, :, component]
    modelled = found.final.predictions[index].displacement[frames, :, component]
    labels = {"moduli alone": found.baseline}
    if found.groups:
        labels[with_causes(diagnosis, index, 1)] = found.final
    residuals = [residual_of(data, f, index)[frames, :, component] for f in labels.values()]

    columns = [measured, modelled, *residuals]
    figure = Figure(
        figsize=(2.7 * len(columns) + 0.9, 2.6 * len(frames) + 1.9), layout="constrained"
    )
    panels = figure.subplots(len(frames), len(columns), squeeze=False)
    spans = [_span(component, measured, modelled)] * 2
    spans += [(-limit_of(r), limit_of(r), SIGNED) for r in residuals]
    titles = ["measured", "modelled,\n" + with_causes(diagnosis, index, 1)]
    titles += [f"measured - modelled,\n{label}" for label in labels]
    drawn = []
    for column, (values, span, title) in enumerate(zip(columns, spans, titles, strict=True)):
        for row, panel in enumerate(panels[:, column]):
            last = draw_points(panel, data, values[row], *span)
            text = rms(values[row]) if column >= 2 else ""
            head = title + "\n" if row == 0 else ""
            panel.set_title(head + text, fontsize=_figure.FONT - (column >= 2 and row > 0))
        drawn.append(last)
    outer_ticks(panels, data.specimen.test.semi_axes)
    for panel, frame in zip(panels[:, 0], frames, strict=True):
        bar = 10.0 * data.specimen.recorded[frame]
        panel.set_ylabel(f"{bar:.3g} bar\ny (mm)", fontsize=_figure.FONT)
    colour_bar(
        figure, drawn[0], panels[:, :2].flat, f"{name} (mm)",
        "both" if component < 2 else "neither", shrink=0.5, location="bottom", aspect=30,
    )  # fmt: skip
    for column in range(2, len(columns)):
        colour_bar(
            figure, drawn[column], panels[:, column], "residual (mm)", ticks=3, shrink=0.9,
            location="bottom", aspect=20,
        )  # fmt: skip
    figure.suptitle(
        f"{data.specimen.test.name}: {name}; measured and modelled have the same colours, each "
        "residual its own",
        fontsize=_figure.FONT + 2,
    )
    return _figure.finished(figure, path, force)


def _span(component: int, *fields: np.ndarray) -> tuple[float, float, str]:
    if component < 2:
        limit = limit_of(*fields)
        return -limit, limit, SIGNED
    values = np.concatenate([f[np.isfinite(f)] for f in fields])
    return float(values.min()), float(values.max()), "cividis"


def plot_signatures(
    diagnosis: Diagnosis,
    index: int,
    path: str | os.PathLike[str] | None = None,
    *,
    force: bool = False,
) -> Any:
    """Maps of what each leading effect of a test adds to its model, beside the residual it found.

    None where there is none.
    """
    from matplotlib.figure import Figure

    # another specimen's effect moves this one's model by what it does to the moduli alone
    steps = [s for s in diagnosis.explanation.steps if acting_on(s.groups, index)][:MOST_EFFECTS]
    if not steps:
        return None
    data = data_of(diagnosis)[index]
    frames = frames_of(data, SIGNATURE_PRESSURES)
    width = 3 * len(frames)
    figure = Figure(figsize=(2.35 * width + 1.2, 7.6 * len(steps) + 0.5), layout="constrained")
    blocks = figure.subfigures(len(steps), 1, hspace=0.03, squeeze=False)
    for block, step in zip(blocks[:, 0], steps, strict=True):
        name = " + ".join(acting_on(step.groups, index))
        block.suptitle(name, fontsize=_figure.FONT + 2, fontweight="bold")
        panels = block.subplots(3, width)
        before = residual_of(data, step.before, index)[frames]
        after = residual_of(data, step.after, index)[frames]
        adds = (
            step.after.predictions[index].displacement - step.before.predictions[index].displacement
        )[frames]
        for component, row in enumerate(panels):
            fields = [f[..., component] for f in (before, adds, after)]
            limit = limit_of(fields[0], fields[1])
            for k, frame in enumerate(frames):
                bar = f"{10.0 * data.specimen.recorded[frame]:.3g} bar"
                titles = ("residual before", f"what {name} adds", "what is left")
                for place, (title, field) in enumerate(zip(titles, fields, strict=True)):
                    panel = row[3 * k + place]
                    drawn = draw_points(panel, data, field[k], -limit, limit, SIGNED)
                    head = f"{title},\n{bar}\n" if component == 0 else ""
                    panel.set_title(head + rms(field[k]), fontsize=_figure.FONT - 1)
            colour_bar(block, drawn, row, f"{COMPONENTS[component]} (mm)", pad=0.01, aspect=15)
        outer_ticks(panels, data.specimen.test.semi_axes)
    return _figure.finished(figure, path, force)
