"""What does a diagnosis say, in plain words? For the terminal, and as blocks of a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bulgefit.dic.noise import Source
from bulgefit.effects.registry import catalogue
from bulgefit.gap.diagnosis import Verdict
from bulgefit.gap.effects import MODULI, SHEAR
from bulgefit.gap.evidence.probability import SURE
from bulgefit.gap.follow_up.separate import STIFFNESS
from bulgefit.gap.residual.locate import Growth
from bulgefit.report._diagnosis_cloth import cloth_lines, secant_rows
from bulgefit.report.numbers import listed, value_text
from bulgefit.report.page.blocks import Block
from bulgefit.report.record import SIGNIFICANT, Record

__all__ = [
    "alarms_of",
    "blocks_of",
    "budget_labels",
    "moduli_rows",
    "names_of",
    "table",
    "verdict_words",
]

_MOST_PARAMETERS, _MOST_CELLS, _MOST_MODES = 9, 6, 5
#: Parameters of a form that are named one by one.
_NAMED = 4
#: Separation (standard errors) from which two explanations need no further measurement.
_APART = 10.0

_GROWTH = {growth.value: growth.words for growth in Growth}
_GAP_COLUMNS = ("dx", "dy", "dz", "e", "e_w", "chi")


def table(record: Record) -> str:
    """The diagnosis to read on a terminal."""
    lines = [line for alarm in alarms_of(record) for line in _wrapped(alarm, "WARNING: ")]
    lines += [f"verdict: {record['verdict']}", *_wrapped(verdict_words(record))]
    for cause in record["causes"]:
        lines += ["", f"{_with_rivals(record, cause)}: {cause['meaning']}"]
        rows = list(_parameters(record, cause))
        width = max(len(name) for name, _ in rows)
        lines += [f"  {name:<{width}}  {text}" for name, text in rows]
        lines += _wrapped(_evidence(cause))
    lines += ["", f"{'gap (mm; chi in noise)':<26}" + "".join(f"{c:>9}" for c in _GAP_COLUMNS)]
    lines += [
        f"{label:<26}" + "".join(f"{gap[c]:>9.4f}" for c in _GAP_COLUMNS)
        for label, gap in _gaps(record)
    ]
    lines += _wrapped(_held_out_test(record))
    lines += ["", f"{'moduli (MPa)':<26}{'moduli alone':<24}with causes"]
    lines += [f"{m:<26}{alone:<24}{final}" for m, alone, final in moduli_rows(record)]
    lines += [
        f"{row[0]:<26}" + "".join(f"{cell:<16}" for cell in row[1:]).rstrip()
        for row in secant_rows(record)
    ]
    parts = {
        "cloth": cloth_lines(record),
        "left": _remainder(record)[:3],
        "next": (*_actions(record), *_advice(record)),
        "note": _notes(record),
    }
    for title, items in parts.items():
        lines.append("")
        for item in items:
            lines += _wrapped(item, f"{title}: ")
    return "\n".join(lines)


def alarms_of(record: Record) -> list[str]:
    """What makes results meaningless; nothing is known of it where an earlier version wrote."""
    return list(record.get("alarms", ()))


def blocks_of(record: Record) -> dict[str, list[Block]]:
    """The words of a page, by what they are about."""
    return {
        "causes": _cause_blocks(record),
        "moduli": [
            Block("table", rows=(("modulus (MPa)", "moduli alone", "with causes"),
                                 *moduli_rows(record)))
        ],
        "gap": _gap_blocks(record),
        "left": [Block("list", tuple(_remainder(record)))],
        "next": [Block("list", (*_actions(record), *_advice(record)))],
        "tried": _tried_blocks(record),
        "notes": [Block("list", tuple(_notes(record)))],
    }  # fmt: skip


def _cause_blocks(record: Record) -> list[Block]:
    causes = record["causes"]
    if not causes:
        return [Block("text", ("No effect that has a name is sure.",))] if _unnamed(record) else []
    rows = [("cause", "parameter", "value ± standard error")]
    for cause in causes:
        label = _with_rivals(record, cause)
        for name, text in _parameters(record, cause):
            rows.append((label, name, text))
            label = ""
    told = tuple(
        f"**{c['effect']}{_whose(record, c)}**: {c['meaning']}. {_evidence(c)}" for c in causes
    )
    return [Block("table", rows=tuple(rows)), Block("list", told)]


def _gap_blocks(record: Record) -> list[Block]:
    head = ("mean absolute deviation (mm)", *_GAP_COLUMNS[:-1], "in noise units")
    rows = [
        (label, *(f"{gap[c]:.4f}" for c in _GAP_COLUMNS[:-1]), f"{gap['chi']:.2f}")
        for label, gap in _gaps(record)
    ]
    kept = _held_out_test(record)
    return [
        Block("text", (_shrinkage(record),)),
        Block("table", rows=(head, *rows)),
        *([Block("text", (kept,))] if kept else []),
    ]


def _tried_blocks(record: Record) -> list[Block]:
    """Candidates that are not in the model, and those that could not be tried."""
    others = sorted(record["others"].items(), key=lambda pair: -pair[1])
    rows = [(_owned(record, group), _chance(p), "weighed and dropped") for group, p in others]
    told = {group.partition("@")[0] for group in (*record["others"], *_taken(record))}
    gone = [effect for effect in record["report"]["candidates"] if effect not in told]
    if gone:
        rows.append((", ".join(gone), "below 0.001 each", "weighed and dropped"))
    rows += [(effect, "", f"not tried: {why}") for effect, why in record["skipped"].items()]
    if not rows:
        return [Block("text", ("Every effect that was tried is in the model.",))]
    return [Block("table", rows=(("effect", "probability", "what became of it"), *rows))]


def _taken(record: Record) -> list[str]:
    """Groups of the final model."""
    return [str(step["taken"]) for step in record["tried"]]


def names_of(record: Record) -> list[str]:
    """Of the tests."""
    return [str(t["name"]) for t in record["report"]["tests"]]


def budget_labels(record: Record) -> list[str]:
    """Rows of the budget: each effect by its form, since several forms are several models."""
    labels = ["moduli alone"]
    for row in record["report"]["budget"][1:]:
        owner = "" if row["specimen"] is None else f" of {names_of(record)[row['specimen']]}"
        labels.append(f"{row['effect']}{owner} ({_form(row['parameters'])})")
    return labels


def _form(parameters: Sequence[str]) -> str:
    if not parameters:
        return "an offset of every point"
    if len(parameters) > _NAMED:
        return f"{parameters[0]} to {parameters[-1]}, {len(parameters)} parameters"
    return ", ".join(parameters)


def _owned(record: Record, group: str) -> str:
    """A group as `effect`, or `effect of test`."""
    effect, _, owner = group.partition("@")
    return f"{effect} of {names_of(record)[int(owner)]}" if owner else effect


def _wrapped(text: str, start: str = "  ") -> list[str]:
    from textwrap import wrap

    return wrap(
        text, 98, initial_indent=start, subsequent_indent=" " * len(start), break_on_hyphens=False
    )


def verdict_words(record: Record) -> str:
    """The verdict in a sentence."""
    causes, verdict = record["causes"], record["verdict"]
    named = listed([_called(record, c) for c in causes])
    if verdict == Verdict.NONE:
        return "The model with its moduli alone is good to the noise; nothing need be added."
    if verdict == Verdict.NAMED:
        return f"{named} {'explains' if len(causes) == 1 else 'explain'} the gap down to the noise."
    if verdict == Verdict.AMBIGUOUS:
        return (
            f"The gap is explained down to the noise by {named}; which of several, this data "
            "cannot tell."
        )
    left = _left(record)
    if verdict == Verdict.PARTIAL:
        sure = listed([_called(record, c) for c in causes if c["probability"] >= SURE])
        return f"{sure} {'is' if len(causes) == 1 else 'are'} sure; beside that, {left}."
    helps = f"; {named} {_helps(causes)} in part" if causes else ""
    return f"No effect that has a name explains the gap: {left}{helps}."


def _unnamed(record: Record) -> bool:
    return record["verdict"] in (Verdict.PARTIAL, Verdict.UNKNOWN)


def _left(record: Record) -> str:
    """What is left, for a verdict."""
    places = listed([_place(f) for f in record["fields"]])
    if places:
        return f"something that has no name sits in {places}"
    if _strong(record):
        return "structure is left"
    return "a pattern is left that is no larger than the noise, but not made by it"


def _strong(record: Record) -> list[tuple[int, dict[str, Any]]]:
    """Cells of what is left that are significant, with the index of their test; strongest first."""
    cells = [
        (index, cell)
        for index, cells in enumerate(record["report"]["cells"]["final"])
        for cell in cells
        if abs(cell["significance"]) > SIGNIFICANT
    ]
    return sorted(cells, key=lambda pair: -abs(pair[1]["significance"]))


def _place(found: Mapping[str, Any]) -> str:
    """Where a field sits, and how large it is."""
    unit = "" if found["unit"] == "1" else f" {found['unit']}"
    return (
        f"the place {found['place']!r} ({found['quantity']}: up to {found['largest']:+.3g}{unit} "
        f"at {_where(found['where'])}, {found['rms']:.2g}{unit} on the whole)"
    )


def _where(where: Mapping[str, float]) -> str:
    if "x_mm" in where:
        return f"({where['x_mm']:.0f}, {where['y_mm']:.0f}) mm"
    if "angle_degree" in where:
        return f"{where['angle_degree']:.0f}° from x"
    if "strain" in where:
        axis = "fill" if where["from_warp_degree"] > 45.0 else "warp"
        return f"{100.0 * where['strain']:.2g} % strain along the {axis}"
    if "time_share" in where:
        return f"{100.0 * where['time_share']:.0f} % of the test's time"
    return f"{where['pressure_bar']:.3g} bar"


def _held_out_test(record: Record) -> str:
    """How the specimen that was kept out is met; nothing where there is none."""
    kept = record.get("holdout")
    if kept is None:
        return ""
    return (
        f"{kept['test']} took no part. With what specimens share from the other tests, and its own "
        f"{len(kept['parameters'])} parameters fitted on {len(kept['fitted_bar'])} of its frames, "
        f"e_w on the {len(kept['judged_bar'])} between them goes from "
        f"{kept['baseline']['e_w']:.4f} to {kept['explained']['e_w']:.4f} mm (noise "
        f"{kept['noise_floor']['e_w']:.4f})."
    )


def _helps(causes: Sequence[Any]) -> str:
    return "helps" if len(causes) == 1 else "help"


def _whose(record: Record, cause: Mapping[str, Any]) -> str:
    """Of which test, where each of several has causes of its own."""
    owner = cause["specimen"]
    return "" if owner is None else f" of {names_of(record)[owner]}"


def _with_rivals(record: Record, cause: Mapping[str, Any]) -> str:
    return " or ".join((cause["effect"], *cause["alternatives"])) + _whose(record, cause)


def _called(record: Record, cause: Mapping[str, Any]) -> str:
    """A cause in a sentence."""
    whose = _whose(record, cause)
    if cause["alternatives"]:
        return f"one of {listed([cause['effect'], *cause['alternatives']], 'or')}{whose}"
    return f"{cause['effect']}{whose} ({cause['meaning']})"


def _parameters(record: Record, cause: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values of a cause."""
    for number, (name, found) in enumerate(cause["parameters"].items()):
        if number == _MOST_PARAMETERS:
            yield f"{len(cause['parameters']) - number} more", "see --json"
            return
        unit = "" if found["unit"] == "1" else f" {found['unit']}"
        yield _owned(record, name), value_text(found["value"], found["stderr"]) + unit


def _evidence(cause: Mapping[str, Any]) -> str:
    parts = [f"Its probability is {_chance(cause['probability'])}.", *_worth(cause)]
    if cause["alternatives"]:
        parts.append(
            f"This data cannot tell it from {listed(cause['alternatives'], 'or')}; it is given "
            "because it is the most probable."
        )
    if cause["at_bound"]:
        parts.append("A parameter sits at the edge of what is plausible: do not take it as it is.")
    if cause["partial"]:
        parts.append("It is a part of the answer only.")
    return " ".join(parts)


def _chance(probability: float) -> str:
    """A probability, without more nines or zeros than a search can know."""
    if probability > 0.999:
        return "over 0.999"
    return "below 0.001" if probability < 0.001 else f"{probability:.3f}"


def _worth(cause: Mapping[str, Any]) -> Iterator[str]:
    """What omitting a cause does to the gap and to the moduli."""
    reduction, share = cause["heldout_reduction"], cause["share_of_gap"]
    if reduction is None or share is None:
        yield (
            "What it takes off is not known: without it the others, as they are, leave no "
            "equilibrium to start a fit from."
        )
        return
    yield (
        f"On data that was not fitted it takes off {_percent(reduction)} of the squared misfit "
        f"that it found, {_percent(share)} of the whole."
        if reduction > 0.0
        else "On data that was not fitted the others would do as well without it."
    )
    biased = [
        f"{m} comes out {'at least ' if m == SHEAR.name and b < 0 and cause['bias_held'] else ''}"
        f"{_percent(abs(b))} too {'high' if b > 0 else 'low'}"
        for m, b in cause["bias_if_omitted"].items()
        if abs(b) >= 0.005
    ]
    if biased:
        yield f"Without it {listed(biased)}."
    else:
        yield "Without it the moduli change by less than 0.5 %."


def _percent(share: float) -> str:
    """A share in per cent, without rounding nearly all up to all."""
    share *= 100.0
    if share > 99.9 and share < 100.0:
        return f"{min(share, 99.99):.2f} %"
    return f"{share:.3g} %"


def _gaps(record: Record) -> list[tuple[str, dict[str, float]]]:
    gap, added = record["gap"], bool(record["tried"])
    rows = [("fitted, moduli alone", gap["baseline"])]
    if added:
        rows.append(("fitted, with causes", gap["explained"]))
    rows.append(("held out, moduli alone", gap["heldout"]["baseline"]))
    if added:
        rows.append(("held out, with causes", gap["heldout"]["explained"]))
    return [*rows, ("noise alone", gap["noise_floor"])]


def moduli_rows(record: Record) -> list[tuple[str, str, str]]:
    """Moduli (MPa) before and after, with their standard errors."""
    fits = [record["parameters"][kind] for kind in ("baseline", "corrected")]
    return [(m.name, *(_modulus(fit[m.name]) for fit in fits)) for m in MODULI]  # type: ignore[misc]


def _modulus(found: Mapping[str, Any]) -> str:
    if found["held"]:
        return f"{found['value']:.3g} at most"
    return value_text(found["value"], found["stderr"])


def _shrinkage(record: Record) -> str:
    gap = record["gap"]
    before, after = (gap["heldout"][k]["e_w"] for k in ("baseline", "explained"))
    floor = gap["noise_floor"]["e_w"]
    if not record["tried"]:
        return f"Nothing was added: e_w is {before:.3g} mm, of which noise makes {floor:.3g} mm."
    return (
        f"On data that was not fitted e_w falls from {before:.3g} to {after:.3g} mm "
        f"({_percent(1 - after / before)} less); noise alone makes {floor:.3g} mm."
        + (" What is left is no larger than the noise." if after <= floor else "")
    )


def _remainder(record: Record) -> list[str]:
    if not record["remainder"]["significant"]:
        return ["Nothing that noise could not have made."]
    several, names = len(names_of(record)) > 1, names_of(record)
    strong = _strong(record)
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
            f"{_percent(told['persistent'])} of the variance, where noise and the model's own "
            f"error stay under {_percent(told['allowed'])}."
        )


def _largest(mode: Mapping[str, Any]) -> float:
    return float(max(abs(a) for a in mode["amplitude_mm"]))


def _cell(cell: Mapping[str, Any], test: str) -> str:
    low, high = cell["band_bar"]
    own = f"{test}, " if test else ""
    return f"{own}{cell['component']} at the {cell['region']}, {low:.3g} to {high:.3g} bar"


def _actions(record: Record) -> list[str]:
    items = [f"{name}: {remedy}." for name, remedy in record["report"]["remedies"].items()]
    if any(noise["source"] != Source.AT_REST for noise in record["noise"]):
        items.append(
            "Film some ten images at rest before inflation: the noise had to be judged from the "
            "field itself."
        )
    for effect in record["skipped"]:
        needs = catalogue()[effect].needs if effect in catalogue() else ()
        items += [
            f"Record the {need} of every frame: without it {effect} cannot be tried."
            for need in needs
        ]
    return items


def _advice(record: Record) -> list[str]:
    if not record["advice"]:
        return ["No two explanations compete; no further measurement is needed to split them."]
    now, *others = record["advice"]
    pair = listed(now["between"])
    useful = [a for a in others if a["separation"] > 1.05 * now["separation"]]
    rivals = any(c["alternatives"] for c in record["causes"])
    if not rivals and now["separation"] >= _APART:
        return [
            f"The two leading explanations, {pair}, lie "
            f"{now['separation']:.0f} standard errors apart with this data: no further measurement "
            "is needed to split them."
        ]
    if not useful:
        return [f"No further measurement that was tried would split {pair}."]
    options = [f"{a['measurement']} ({a['separation']:.0f})" for a in useful[:3]]
    return [
        f"To split {pair}, best first: {'; '.join(options)}. In brackets the "
        f"standard errors that would lie between them; now it is {now['separation']:.0f}."
    ]


def _notes(record: Record) -> list[str]:
    items = list(record["warnings"])
    items += [f"{effect} was not tried: {why}." for effect, why in record["skipped"].items()]
    for noise, mesh in zip(record["noise"], record["report"]["mesh"], strict=True):
        name = noise["test"]
        items.append(
            f"{name}: noise of dx, dy, dz is {_microns(noise['sigma_mm'])} µm (from "
            f"{noise['source']}), correlated over {noise['correlation_length_mm']:.1f} mm: "
            f"{1.0 / noise['effective_points_per_point']:.3g} points count as one."
        )
        if mesh["left_mm"] is not None:
            items.append(
                f"{name}: the mesh's error, {_microns(mesh['taken_off_mm'])} µm, was taken off by "
                f"Richardson's extrapolation; about {_microns(mesh['left_mm'])} µm are left."
            )
    for pair in record["indistinguishable"]:
        if STIFFNESS in pair["effects"]:
            effect = catalogue()[pair["effects"][0]]
            items.append(
                f"{effect.id} and {STIFFNESS} can never be told apart by a bulge test: "
                f"{effect.never_separable}."
            )
    return [*items, *_alike(record)]


def _microns(sizes: Sequence[float]) -> str:
    return ", ".join(f"{1000 * s:.1f}" for s in sizes)


def _alike(record: Record) -> Iterator[str]:
    """What looks like a cause without being in its set."""
    for cause in record["causes"]:
        own = cause["effect"]
        others = {
            (set(pair["effects"]) - {own}).pop(): pair["cosine"]
            for pair in record["indistinguishable"]
            if own in pair["effects"]
        }
        near = [f"{e} ({c:.2f})" for e, c in others.items() if e not in cause["alternatives"]]
        if near:
            yield (
                f"{own} looks much like {listed(near)} in this data (cosine in brackets); the "
                "evidence prefers it still."
            )
