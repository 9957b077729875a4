"""The page of a diagnosis: what to use, where the gap lies, which cause, how far it shrank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bulgefit.gap.causes import Verdict
from bulgefit.gap.effects import MODULI, SHEAR
from bulgefit.report._diagnosis_cloth import AT_REST, cloth_blocks, is_bent, stiffness_of
from bulgefit.report._diagnosis_unnamed import unnamed_blocks
from bulgefit.report.numbers import CARE, INTERVAL, USE, listed, value_text
from bulgefit.report.page import charts
from bulgefit.report.page.blocks import Answer, Block, Page, Value
from bulgefit.report.record import SIGNIFICANT, Record
from bulgefit.report.words.blocks import blocks_of
from bulgefit.report.words.causes import is_undecided
from bulgefit.report.words.names import budget_labels, names_of, percent_text
from bulgefit.report.words.notes import alarms_of
from bulgefit.report.words.verdict import verdict_words

__all__ = ["page_of_diagnosis"]

_NAMES = [modulus.name for modulus in MODULI]


def page_of_diagnosis(record: Record) -> Page:
    """The page of a diagnosis's record."""
    told = blocks_of(record)
    names = names_of(record)
    blocks = [
        Block("heading", ("Which cause",)),
        *told["causes"],
        *unnamed_blocks(record),
        Block("heading", ("What it did to the moduli",)),
        *told["moduli"],
        *_moduli_spans(record),
        *cloth_blocks(record),
        Block("heading", ("How far the gap shrank",)),
        *told["gap"],
        *_budget(record),
        Block("fields"),
        Block("heading", ("Where the gap lies",)),
        *_where(record),
        Block("heading", ("What stays unexplained",)),
        *told["left"],
        Block("heading", ("What to do next",)),
        *told["next"],
        Block("heading", ("What was tried and dropped",)),
        *told["tried"],
        Block("heading", ("Good to know",)),
        *told["notes"],
    ]
    title = f"What separates the model from {listed(names)}"
    return Page(title, "diagnose", _answer(record), tuple(blocks))


def _answer(record: Record) -> Answer:
    values = tuple(_value(name, found) for name, found in stiffness_of(record).items())
    usable = [v for v in values if v.use != "no"]
    rest = [v.name for v in values if v.use == "no"]
    use = f"Use {listed([f'{v.name} = {v.text}' for v in usable])} (95 %)" if usable else ""
    dont = f"do not use {listed(rest)}" if rest else ""
    headline = "; ".join(filter(None, (use, dont)))
    clear = record["verdict"] in (Verdict.NONE, Verdict.NAMED)
    tone = "good" if clear and not rest and not alarms_of(record) else "care"
    notes = [
        *alarms_of(record),
        f"**Verdict: {record['verdict']}.** {verdict_words(record)}",
    ]
    if record["verdict"] in (Verdict.PARTIAL, Verdict.UNKNOWN):
        notes.append(
            "What has no name may shift the moduli by more than these limits: take them as those "
            "of this model, not of the fabric."
        )
    elif record["verdict"] == Verdict.AMBIGUOUS:
        notes += _open(record["causes"])
    notes += [AT_REST] if is_bent(record) else _shifts(record)
    return Answer(
        headline[0].upper() + headline[1:] + ".", tone if usable else "bad", values, tuple(notes)
    )


def _open(causes: Sequence[Mapping[str, Any]]) -> list[str]:
    """What causes that the data leave open mean for the moduli."""
    notes = []
    if any(c["alternatives"] for c in causes):
        notes.append("Which of the causes acts decides the moduli, too: split them first (below).")
    if any(map(is_undecided, causes)):
        notes.append(
            "Whether a cause is there decides the moduli, too: what they would be without it is "
            "told with it (below)."
        )
    return notes


def _value(name: str, found: Any) -> Value:
    value, error = found["value"], found["stderr"]
    if found["held"]:
        return Value(name, f"{value:.3g} MPa at most", "no", "an upper limit, and no value")
    text = f"{value_text(value, INTERVAL * error)} MPa"
    share = error / value
    if share <= USE:
        return Value(name, text, "use")
    if share <= CARE:
        return Value(name, text, "care", f"found roughly: standard error {percent_text(share)}")
    return Value(
        name, text, "no", f"this data hardly shows it: standard error {percent_text(share)}"
    )


def _shifts(record: Record) -> list[str]:
    """By how much a plain fit would have missed."""
    before, after = (record["parameters"][k] for k in ("baseline", "corrected"))
    off = {m: before[m]["value"] / after[m]["value"] - 1 for m in _NAMES if not before[m]["held"]}
    shifts = [
        f"{m} by {'-' if share < 0 else '+'}{percent_text(abs(share))}"
        for m, share in off.items()
        if abs(share) >= 0.005
    ]
    return [f"A fit of the moduli alone is off: {listed(shifts)}."] if shifts else []


def _moduli_spans(record: Record) -> list[Block]:
    if not record["tried"]:
        return []
    blocks = []
    # of a bent law the slope at rest is not to be compared with a stiffness of the whole
    for m in _NAMES if not is_bent(record) else (SHEAR.name,):
        fits = [(label, record["parameters"][k][m]) for label, k in
                (("moduli alone", "baseline"), ("with causes", "corrected"))]  # fmt: skip
        rows = [
            (f"{m}, {label}", value_text(f["value"], f["stderr"]), f["value"], f["stderr"])
            for label, f in fits
            if not f["held"]
        ]
        if len(rows) == 2:
            blocks.append(Block("spans", picture=charts.spans(rows)))
    if blocks:
        first = "MPa; the bar is the 95 % interval, each modulus on a scale of its own."
        if is_bent(record):
            first += (
                " E1 and E2 with causes are slopes at rest, and moduli alone fit the whole: see "
                "the law of the cloth."
            )
        blocks[0] = Block("spans", (first,), picture=blocks[0].picture)
    return blocks


def _budget(record: Record) -> list[Block]:
    """What each effect takes off, by its form: several forms of an effect are several models."""
    labels = budget_labels(record)
    kinds = (("heldout_mm", "on data that was not fitted"), ("fitted_mm", "on the fitted data"))
    held_out, fitted = (
        Block(
            "bars",
            (f"**The budget {what}**: e_w in mm from the moduli alone, over each effect by its "
             "form, down to what is left. Dashed: noise alone.",),
            picture=charts.budget_bars(record, kind, labels),
        )
        for kind, what in kinds
    )  # fmt: skip
    gap = record["gap"]
    told = f"e_w from {gap['baseline']['e_w']:.3g} to {gap['explained']['e_w']:.3g} mm"
    return [held_out, Block("fold", ("the same on the fitted data", told), inside=(fitted,))]


def _where(record: Record) -> list[Block]:
    """Discs and modes; of several tests each in a fold of its own, which says how much it holds."""
    kinds = {"baseline": "moduli alone"}
    if record["tried"]:
        kinds["final"] = "with causes"
    names = names_of(record)
    if len(names) == 1:
        return _where_of(record, 0, kinds)
    folds = []
    for index, name in enumerate(names):
        cells = {label: record["report"]["cells"][kind][index] for kind, label in kinds.items()}
        counts = [f"{label} {sum(map(_is_strong, each))}" for label, each in cells.items()]
        told = f"of {len(cells['moduli alone'])} means beyond {SIGNIFICANT:g} standard errors: "
        inside = tuple(_where_of(record, index, kinds))
        folds.append(Block("fold", (name, told + ", ".join(counts)), inside=inside))
    return folds


def _where_of(record: Record, index: int, kinds: Mapping[str, str]) -> list[Block]:
    """Discs and modes of one test, before and after."""
    told = record["report"]
    # a circle where an earlier version wrote
    rim = told["tests"][index].get("semi_axes_mm", (1.0, 1.0))
    blocks = [_discs(told["cells"][kind][index], label, rim) for kind, label in kinds.items()]
    for kind, label in kinds.items():
        caption = (
            f"**Azimuthal modes, {label}**: amplitude in mm of cos/sin(m·angle) of what is left, "
            "between 0.3 and 0.9 of the radius. Grey: within three standard errors of zero; "
            "dotted: noise."
        )
        modes = told["modes"][kind][index]
        drawn = [charts.curves(modes, component) for component in ("radial", "hoop", "dz")]
        blocks.append(Block("curves", (caption,), picture={"charts": drawn}))
    return blocks


def _is_strong(cell: Mapping[str, Any]) -> bool:
    return bool(abs(cell["significance"]) > SIGNIFICANT)


def _discs(cells: list[dict[str, Any]], label: str, semi_axes: Sequence[float]) -> Block:
    """Where what is left lies, or that no region has anything."""
    if not any(map(_is_strong, cells)):
        return Block(
            "text",
            (f"**{label.capitalize()}**: none of {len(cells)} means (component, region, band of "
             f"pressure) is beyond {SIGNIFICANT:g} standard errors.",),
        )  # fmt: skip
    caption = (
        f"**{label.capitalize()}**: mean of measured − modelled over each region and band of "
        f"pressure, coloured by its distance from zero in standard errors; numbers from "
        f"{SIGNIFICANT:g} on. x to the right, y upwards. Point at a region for its mean in mm."
    )
    return Block("discs", (caption,), picture=charts.discs(cells, semi_axes))
