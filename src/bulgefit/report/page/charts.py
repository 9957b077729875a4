"""Where do the marks of a page's pictures stand? Geometry for the templates, which draw it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bulgefit.gap.residual.structure import RINGS, SECTORS
from bulgefit.report.numbers import INTERVAL
from bulgefit.report.record import SIGNIFICANT, Record
from bulgefit.report.words.names import mode_label

__all__ = ["budget_bars", "curves", "disc_wedges", "discs", "spans", "ticks"]

#: Standard errors at which the steps of colour end, on either side.
STEPS = (SIGNIFICANT, 10.0, 30.0, 100.0)


def budget_bars(record: Record, kind: str, labels: Sequence[str]) -> dict[str, Any]:
    """The gap from the moduli alone over each effect down to the noise, as bars.

    Parameters
    ----------
    record : mapping
    kind : {"fitted_mm", "heldout_mm"}
    labels : sequence of str
        Of each row of the budget.
    """
    rows = record["report"]["budget"]
    floor, mesh = record["gap"]["noise_floor"]["e_w"], record["report"]["mesh_error_mm"]
    values = [row[kind] for row in rows]
    bars = [_bar(labels[0], 0.0, values[0], "whole", f"{values[0]:.4f}")]
    for label, before, after in zip(labels[1:], values, values[1:], strict=False):
        low, high = sorted((before, after))
        change = round(after - before, 4) + 0.0  # not -0.0
        bars.append(_bar(label, low, high, "gain" if after <= before else "loss", f"{change:+.4f}"))
    left = values[-1]
    bars.append(_bar("what is left", 0.0, left, "whole", f"{left:.4f}"))
    bars.append(_bar("noise alone", 0.0, floor, "noise", f"{floor:.4f}"))
    bars.append(
        _bar("left beyond the noise", min(floor, left), left, "loss", f"{max(left - floor, 0):.4f}")
    )
    if mesh is not None:
        bars.append(_bar("mesh error, taken off", 0.0, mesh, "noise", f"{mesh:.4f}"))
    reach = max(bar["to"] for bar in bars)
    for bar in bars:
        bar["left"], bar["width"] = (
            100 * v / reach for v in (bar["from"], bar["to"] - bar["from"])
        )
    return {"bars": bars, "mark": 100 * floor / reach, "unit": "e_w (mm)"}


def _bar(label: str, low: float, high: float, kind: str, text: str) -> dict[str, Any]:
    return {"label": label, "from": low, "to": high, "kind": kind, "text": text}


def disc_wedges() -> list[dict[str, Any]]:
    """The regions of a specimen on a disc of radius 50: name, outline, and where its number goes.

    x runs to the right and y upwards, as on the specimen.
    """
    out = []
    for low, high, ring in RINGS:
        high = min(high, 1.0)
        if ring == "apex":
            r = 50 * high
            path = f"M{r:.2f} 0A{r:.2f} {r:.2f} 0 1 0 {-r:.2f} 0A{r:.2f} {r:.2f} 0 1 0 {r:.2f} 0Z"
            out.append({"region": ring, "path": path, "x": 0.0, "y": 0.0})
            continue
        for sector in range(SECTORS):
            middle = 2 * np.pi * sector / SECTORS
            ends = (middle - np.pi / SECTORS, middle + np.pi / SECTORS)
            (a, b), (c, d) = ([(50 * r * np.cos(t), -50 * r * np.sin(t)) for t in ends]
                              for r in (low, high))  # fmt: skip
            path = (
                f"M{_at(a)}L{_at(c)}A{50 * high:.2f} {50 * high:.2f} 0 0 0 {_at(d)}"
                f"L{_at(b)}A{50 * low:.2f} {50 * low:.2f} 0 0 1 {_at(a)}Z"
            )
            reach = 25 * (low + high)
            out.append(
                {
                    "region": f"{ring} {360 * sector // SECTORS}°",
                    "path": path,
                    "x": round(float(reach * np.cos(middle)), 2),
                    "y": round(float(-reach * np.sin(middle)), 2),
                }
            )
    return out


def _at(point: tuple[float, float]) -> str:
    return f"{point[0]:.2f} {point[1]:.2f}"


def discs(
    cells: Sequence[Mapping[str, Any]], semi_axes: Sequence[float] = (1.0, 1.0)
) -> dict[str, Any]:
    """Discs of one test, as its clamp is: rows by component, columns by pressure band.

    Colour is by standard errors from zero, in steps, so that what noise makes stays neutral; what
    has no points is hatched.
    """
    bands = sorted({tuple(c["band_bar"]) for c in cells})
    rows = []
    for component in ("dx", "dy", "dz"):
        ours = [c for c in cells if c["component"] == component]
        for band in bands:
            inside = {c["region"]: c for c in ours if tuple(c["band_bar"]) == band}
            rows.append(
                {
                    "title": f"{component}, {band[0]:.3g} to {band[1]:.3g} bar",
                    "share": f"{100 * sum(c['share'] for c in inside.values()):.1f} % of the gap",
                    "regions": {region: _wedge(c) for region, c in inside.items()},
                }
            )
    return {
        "discs": rows,
        "bands": len(bands),
        "steps": [f"{s:g}" for s in STEPS],
        "stretch": [axis / max(semi_axes) for axis in semi_axes],
    }


def _wedge(cell: Mapping[str, Any]) -> dict[str, str]:
    sign = "p" if cell["significance"] > 0 else "n"
    level = sum(abs(cell["significance"]) >= step for step in STEPS)
    text = f"{abs(cell['significance']):.0f}" if level else ""
    told = f"{cell['region']}: {cell['mean_mm']:+.3g} mm, {cell['significance']:+.1f} errors"
    return {"class": f"{sign}{level}" if level else "z", "text": text, "told": told}


#: Of a chart of curves, in the units of its drawing.
_WIDTH, _HEIGHT = 300.0, 170.0


def curves(modes: Sequence[Mapping[str, Any]], component: str) -> dict[str, Any]:
    """Amplitudes of azimuthal modes against pressure; points are joined, not fitted."""
    ours = [m for m in modes if m["component"] == component]
    bars = np.concatenate([m["pressure_bar"] for m in ours])
    sizes = np.concatenate([m["amplitude_mm"] for m in ours])
    noise = SIGNIFICANT * ours[0]["noise_mm"]
    low, high = min(sizes.min(), -noise), max(sizes.max(), noise)
    top = float(bars.max())

    def x(bar: float) -> float:
        return _WIDTH * bar / top

    def y(size: float) -> float:
        return float(_HEIGHT * (high - size) / (high - low))

    ticks_y = ticks(low, high)
    return {
        "title": component,
        "width": _WIDTH,
        "height": _HEIGHT,
        "lines": [
            {
                "label": mode_label(m["order"], m["growth"]),
                "points": [
                    f"{x(b):.1f},{y(a):.1f}"
                    for b, a in zip(m["pressure_bar"], m["amplitude_mm"], strict=True)
                ],
                "quiet": m["growth"] == "within noise",
            }
            for m in ours
        ],
        "noise": {"top": y(noise), "height": y(-noise) - y(noise)},
        "ticks_x": [{"at": x(t), "text": f"{t:g}"} for t in ticks(0.0, top)],
        "ticks_y": [{"at": y(t), "text": f"{t:g}"} for t in ticks_y],
    }


def ticks(low: float, high: float) -> list[float]:
    """Three to six round numbers of a range."""
    step = 10.0 ** np.floor(np.log10((high - low) / 2.0))
    step *= next(m for m in (5.0, 2.0, 1.0) if (high - low) / (m * step) >= 2.0)
    first, last = int(np.ceil(low / step)), int(np.floor(high / step))
    return [round(float(k * step), 12) + 0.0 for k in range(first, last + 1)]


def spans(rows: Sequence[tuple[str, str, float, float | None]]) -> dict[str, Any]:
    """Values with their 95 % intervals on one line each, to be compared.

    Parameters
    ----------
    rows : sequence of (label, text, value, standard error or None)
    """
    ends = [(value, INTERVAL * (error or 0.0)) for _, _, value, error in rows]
    low, high = min(v - e for v, e in ends), max(v + e for v, e in ends)
    margin = 0.08 * (high - low) or 0.01 * abs(high) or 1.0
    low, high = low - margin, high + margin
    return {
        "rows": [
            {
                "label": label,
                "text": text,
                "at": 100 * (value - low) / (high - low),
                "left": 100 * (value - reach - low) / (high - low),
                "width": 100 * 2 * reach / (high - low),
            }
            for (label, text, _, _), (value, reach) in zip(rows, ends, strict=True)
        ],
        "from": f"{low:.4g}",
        "to": f"{high:.4g}",
    }
