"""What is left, and where, in words?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bulgefit.gap.residual.locate import Growth
from bulgefit.report.record import SIGNIFICANT, Record
from bulgefit.report.words.names import names_of, percent_text

__all__ = ["remainder_items", "strong_cells"]

_MOST_CELLS, _MOST_MODES = 6, 5
_GROWTH = {growth.value: growth.words for growth in Growth}


def strong_cells(record: Record) -> list[tuple[int, dict[str, Any]]]:
    """Cells of what is left that are significant, with the index of their test; strongest first."""
    cells = [
        (index, cell)
        for index, cells in enumerate(record["report"]["cells"]["final"])
        for cell in cells
        if abs(cell["significance"]) > SIGNIFICANT
    ]
    return sorted(cells, key=lambda pair: -abs(pair[1]["significance"]))


def remainder_items(record: Record) -> list[str]:
    """What is left, place by place, and what it looks like."""
    if not record["remainder"]["significant"]:
        return ["Nothing that noise could not have made."]
    several, names = len(names_of(record)) > 1, names_of(record)
    strong = strong_cells(record)
    # the most significant pressure band of each place
    places: dict[tuple[int, str, str], dict[str, Any]] = {}
    for index, c in strong:
        places.setdefault((index, c["component"], c["region"]), c)
    items = [
        f"{_cell(c, names[index] if several else '')}: measured - modelled is "
        f"{c['mean_mm']:+.3g} mm on average ({abs(c['significance']):.0f} standard errors)."
        for (index, *_), c in list(places.items())[:_MOST_CELLS]
    ]
    count = sum(len(cells) for cells in record["report"]["cells"]["final"])
    if strong:
        items.append(
            f"In all {len(strong)} of {count} cells (component, region, pressure band) are beyond "
            f"{SIGNIFICANT:g} standard errors."
        )
    items += _pattern(record, bool(strong), count)
    for index, modes in enumerate(record["report"]["modes"]["final"]):
        loud = [m for m in modes if m["growth"] != Growth.NONE]
        loud.sort(key=lambda m: -_largest(m) / m["noise_mm"])
        items += [
            f"It looks like {m['component']} m = {m['order']}, up to {_largest(m):.3g} mm, "
            f"{_GROWTH[m['growth']]}{f' ({names[index]})' if several else ''}."
            for m in loud[: max(1, _MOST_MODES // len(names))]
        ]
    return items


def _pattern(record: Record, strong: bool, count: int) -> Iterator[str]:
    """Why it is structure, where no single cell shows it."""
    told = record["report"]["structure"]
    if not strong:
        yield (
            f"None of {count} cells (component, region, pressure band) is beyond {SIGNIFICANT:g} "
            "standard errors by itself: in size it is noise."
        )
    if told["statistic"] > told["threshold"] and not strong:
        yield (
            "But all cells together are further from zero than noise takes them (sum of squares "
            f"{told['statistic']:.0f}; noise stays under {told['threshold']:.0f})."
        )
    if told["persistent"] > told["allowed"]:
        yield (
            "The same pattern stands in neighbouring frames, which noise does not: it makes "
            f"{percent_text(told['persistent'])} of the variance, where noise and the model's own "
            f"error stay under {percent_text(told['allowed'])}."
        )


def _largest(mode: Mapping[str, Any]) -> float:
    return float(max(abs(a) for a in mode["amplitude_mm"]))


def _cell(cell: Mapping[str, Any], test: str) -> str:
    low, high = cell["band_bar"]
    own = f"{test}, " if test else ""
    return f"{own}{cell['component']} at the {cell['region']}, {low:.3g} to {high:.3g} bar"
