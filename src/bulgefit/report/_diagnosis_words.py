"""What does a diagnosis say, in plain words? For the terminal, and as blocks of a page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bulgefit.dic.noise import Source
from bulgefit.effects.registry import fields
from bulgefit.gap.diagnosis import Cause, Diagnosis, Verdict
from bulgefit.gap.effects import CATALOGUE, MODULI, SHEAR
from bulgefit.gap.evidence.coordinates import effect_of
from bulgefit.gap.evidence.probability import SURE
from bulgefit.gap.explain import FoundField
from bulgefit.gap.follow_up.separate import STIFFNESS
from bulgefit.gap.residual.locate import Growth, azimuthal_modes
from bulgefit.gap.residual.structure import Cell
from bulgefit.report._diagnosis_maps import SIGNIFICANT
from bulgefit.report._diagnosis_parts import data_of

__all__ = ["Block", "page", "table", "value_text"]

_MOST_PARAMETERS, _MOST_CELLS, _MOST_MODES = 9, 6, 5
#: Separation (standard errors) from which two explanations need no further measurement.
_APART = 10.0

_GAP_COLUMNS = ("dx", "dy", "dz", "e", "e_w", "chi")


@dataclass(frozen=True)
class Block:
    """A piece of a page.

    Attributes
    ----------
    kind : {"title", "heading", "text", "list", "table"}
    lines : tuple of str
        The text, the items, or nothing.
    rows : tuple of tuples of str
        Of a table, its header first.
    """

    kind: str
    lines: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


def value_text(value: float, stderr: float) -> str:
    """A value with its standard error, to the two digits that the error carries."""
    if not (math.isfinite(stderr) and stderr > 0.0):
        return f"{value:.4g}"
    if stderr < 1e-6 or abs(value) >= 1e6:
        return f"{value:.4g} ± {stderr:.2g}"
    places = max(0, 1 - math.floor(math.log10(stderr)))
    return f"{value:.{places}f} ± {stderr:.{places}f}"


def table(diagnosis: Diagnosis) -> str:
    """The diagnosis to read on a terminal."""
    lines = [f"verdict: {diagnosis.verdict}", *_wrapped(_verdict(diagnosis))]
    for cause in diagnosis.causes:
        others = "".join(f" or {a}" for a in cause.alternatives)
        lines += ["", f"{cause.effect}{others}: {CATALOGUE[cause.effect].meaning}"]
        rows = list(_parameters(diagnosis, cause))
        width = max(len(name) for name, _ in rows)
        lines += [f"  {name:<{width}}  {text}" for name, text in rows]
        lines += _wrapped(_evidence(cause))
    lines += ["", f"{'gap (mm; chi in noise)':<26}" + "".join(f"{c:>9}" for c in _GAP_COLUMNS)]
    lines += [
        f"{label:<26}" + "".join(f"{gap[c]:>9.4f}" for c in _GAP_COLUMNS)
        for label, gap in _gaps(diagnosis)
    ]
    lines += _wrapped(_held_out_test(diagnosis))
    lines += ["", f"{'moduli (MPa)':<26}{'moduli alone':<24}with causes"]
    lines += [f"{m:<26}{alone:<24}{final}" for m, alone, final in _moduli(diagnosis)]
    parts = {
        "left": _remainder(diagnosis)[:3],
        "next": _advice(diagnosis)[:3],
        "note": _notes(diagnosis),
    }
    for title, items in parts.items():
        lines.append("")
        for item in items:
            lines += _wrapped(item, f"{title}: ")
    return "\n".join(lines)


def page(diagnosis: Diagnosis) -> list[Block]:
    """The summary of one page."""
    names = ", ".join(t.name for t in diagnosis.tests)
    blocks = [
        Block("title", (f"What separates the model from {names}",)),
        Block("text", (f"**Verdict: {diagnosis.verdict}.** {_verdict(diagnosis)}",)),
    ]
    if diagnosis.causes:
        blocks.append(Block("heading", ("Causes",)))
        rows = [("cause", "parameter", "value ± standard error")]
        for cause in diagnosis.causes:
            others = "".join(f" or {a}" for a in cause.alternatives)
            label = f"{cause.effect}{others}"
            for name, text in _parameters(diagnosis, cause):
                rows.append((label, name, text))
                label = ""
        blocks.append(Block("table", rows=tuple(rows)))
        blocks.append(
            Block(
                "list",
                tuple(
                    f"**{c.effect}**: {CATALOGUE[c.effect].meaning}. {_evidence(c)}"
                    for c in diagnosis.causes
                ),
            )
        )
    blocks += [
        Block("heading", ("What it did to the moduli",)),
        Block(
            "table",
            rows=(("modulus (MPa)", "moduli alone", "with causes"), *_moduli(diagnosis)),
        ),
        Block("heading", ("How far the gap shrank",)),
        Block("text", (_shrinkage(diagnosis),)),
        Block(
            "table",
            rows=(
                ("mean absolute deviation (mm)", *_GAP_COLUMNS[:-1], "in noise units"),
                *(
                    (label, *(f"{gap[c]:.4f}" for c in _GAP_COLUMNS[:-1]), f"{gap['chi']:.2f}")
                    for label, gap in _gaps(diagnosis)
                ),
            ),
        ),
        *([Block("text", (_held_out_test(diagnosis),))] if diagnosis.holdout else []),
        Block("heading", ("What stays unexplained",)),
        Block("list", tuple(_remainder(diagnosis))),
        Block("heading", ("What to do next",)),
        Block("list", (*_actions(diagnosis), *_advice(diagnosis))),
        Block("heading", ("Good to know",)),
        Block("list", tuple(_notes(diagnosis))),
    ]
    return blocks


def _wrapped(text: str, start: str = "  ") -> list[str]:
    from textwrap import wrap

    return wrap(
        text, 98, initial_indent=start, subsequent_indent=" " * len(start), break_on_hyphens=False
    )


def _listed(items: Sequence[str], last: str = "and") -> str:
    return f" {last} ".join(filter(None, (", ".join(items[:-1]), items[-1]))) if items else ""


def _verdict(diagnosis: Diagnosis) -> str:
    causes = diagnosis.causes
    named = _listed([_called(c) for c in causes])
    if diagnosis.verdict is Verdict.NONE:
        return "The model with its moduli alone is good to the noise; nothing need be added."
    if diagnosis.verdict is Verdict.NAMED:
        return f"{named} {'explains' if len(causes) == 1 else 'explain'} the gap down to the noise."
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        return (
            f"The gap is explained down to the noise by {named}; which of several, this data "
            "cannot tell."
        )
    places = _listed([_place(f) for f in diagnosis.explanation.fields])
    left = f"something that has no name sits in {places}" if places else "structure is left"
    if diagnosis.verdict is Verdict.PARTIAL:
        sure = _listed([_called(c) for c in causes if c.probability >= SURE])
        return f"{sure} {'is' if len(causes) == 1 else 'are'} sure; beside that, {left}."
    helps = f"; {named} {_helps(causes)} in part" if causes else ""
    return f"No effect that has a name explains the gap: {left}{helps}."


def _place(found: FoundField) -> str:
    """Where a field sits, and how large it is."""
    kind = fields()[effect_of(found.group)]
    largest, where = found.sampled.largest
    unit = "" if kind.unit == "1" else f" {kind.unit}"
    return (
        f"the place {kind.place!r} ({kind.quantity}: up to {largest:+.3g}{unit} at "
        f"{_where(where)}, {found.sampled.rms:.2g}{unit} on the whole)"
    )


def _where(where: dict[str, float]) -> str:
    if "x_mm" in where:
        return f"({where['x_mm']:.0f}, {where['y_mm']:.0f}) mm"
    if "angle_degree" in where:
        return f"{where['angle_degree']:.0f}° from x"
    if "strain" in where:
        axis = "fill" if where["from_warp_degree"] > 45.0 else "warp"
        return f"{100.0 * where['strain']:.2g} % strain along the {axis}"
    return f"{where['pressure_bar']:.3g} bar"


def _held_out_test(diagnosis: Diagnosis) -> str:
    """How the specimen that was kept out is met; nothing where there is none."""
    kept = diagnosis.holdout
    if kept is None:
        return ""
    return (
        f"{kept.test} took no part. With what specimens share from the other tests, and its own "
        f"{len(kept.parameters)} parameters fitted on {len(kept.fitted_bar)} of its frames, e_w "
        f"on the {len(kept.judged_bar)} between them goes from {kept.baseline['e_w']:.4f} to "
        f"{kept.explained['e_w']:.4f} mm (noise {kept.noise_floor['e_w']:.4f})."
    )


def _helps(causes: Sequence[Cause]) -> str:
    return "helps" if len(causes) == 1 else "help"


def _called(cause: Cause) -> str:
    if cause.alternatives:
        return f"one of {_listed([cause.effect, *cause.alternatives], 'or')}"
    return f"{cause.effect} ({CATALOGUE[cause.effect].meaning})"


def _parameters(diagnosis: Diagnosis, cause: Cause) -> Iterator[tuple[str, str]]:
    """Names and values of a cause."""
    for number, (name, found) in enumerate(cause.parameters.items()):
        if number == _MOST_PARAMETERS:
            yield f"{len(cause.parameters) - number} more", "see --json"
            return
        plain, _, owner = name.partition("@")
        label = f"{plain} of {diagnosis.tests[int(owner)].name}" if owner else plain
        unit = "" if found["unit"] == "1" else f" {found['unit']}"
        yield label, value_text(found["value"], found["stderr"]) + unit


def _evidence(cause: Cause) -> str:
    parts = [f"Its probability is {_chance(cause.probability)}.", *_worth(cause)]
    if cause.alternatives:
        parts.append(
            f"This data cannot tell it from {_listed(cause.alternatives, 'or')}; it is given "
            "because it is the most probable."
        )
    if cause.at_bound:
        parts.append("A parameter sits at the edge of what is plausible: do not take it as it is.")
    if cause.partial:
        parts.append("It is a part of the answer only.")
    return " ".join(parts)


def _chance(probability: float) -> str:
    """A probability, without more nines than a search can know."""
    return "over 0.999" if probability > 0.999 else f"{probability:.3f}"


def _worth(cause: Cause) -> Iterator[str]:
    """What omitting a cause does to the gap and to the moduli."""
    if cause.heldout_reduction is None or cause.share_of_gap is None:
        yield (
            "What it takes off is not known: without it the others, as they are, leave no "
            "equilibrium to start a fit from."
        )
        return
    yield (
        f"On data that was not fitted it takes off {_percent(cause.heldout_reduction)} of the "
        f"squared misfit that it found, {_percent(cause.share_of_gap)} of the whole."
        if cause.heldout_reduction > 0.0
        else "On data that was not fitted the others would do as well without it."
    )
    biased = [
        f"{m} comes out {'at least ' if m == SHEAR.name and b < 0 and cause.bias_held else ''}"
        f"{_percent(abs(b))} too {'high' if b > 0 else 'low'}"
        for m, b in cause.bias_if_omitted.items()
        if abs(b) >= 0.005
    ]
    if biased:
        yield f"Without it {_listed(biased)}."
    else:
        yield "Without it the moduli change by less than 0.5 %."


def _percent(share: float) -> str:
    share *= 100.0
    if share > 99.9 and share < 100.0:
        return f"{min(share, 99.99):.2f} %"
    return f"{share:.3g} %"


def _gaps(diagnosis: Diagnosis) -> list[tuple[str, dict[str, float]]]:
    gaps = diagnosis.gaps
    rows = [("fitted, moduli alone", gaps["baseline"])]
    if diagnosis.explanation.groups:
        rows.append(("fitted, with causes", gaps["explained"]))
    rows.append(("held out, moduli alone", gaps["heldout_baseline"]))
    if diagnosis.explanation.groups:
        rows.append(("held out, with causes", gaps["heldout_explained"]))
    return [*rows, ("noise alone", gaps["noise_floor"])]


def _moduli(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    found = diagnosis.explanation
    texts = []
    for fit in (found.baseline, found.final):
        errors = fit.standard_errors()
        texts.append([value_text(fit.values[m], errors[m]) for m in MODULI])
        if fit.held:
            texts[-1][MODULI.index(SHEAR)] = f"{fit.values[SHEAR]:.3g} at most"
    return list(zip((m.name for m in MODULI), *texts, strict=True))


def _shrinkage(diagnosis: Diagnosis) -> str:
    before, after = (diagnosis.gaps[f"heldout_{k}"]["e_w"] for k in ("baseline", "explained"))
    floor = diagnosis.gaps["noise_floor"]["e_w"]
    if not diagnosis.explanation.groups:
        return f"Nothing was added: e_w is {before:.3g} mm, of which noise makes {floor:.3g} mm."
    return (
        f"On data that was not fitted e_w falls from {before:.3g} to {after:.3g} mm "
        f"({_percent(1 - after / before)} less); noise alone makes {floor:.3g} mm."
    )


def _remainder(diagnosis: Diagnosis) -> list[str]:
    rest = diagnosis.explanation.remainder
    if not rest.significant:
        return ["Nothing that noise could not have made."]
    several = len(diagnosis.tests) > 1
    strong = [c for c in rest.cells if abs(c.significance) > SIGNIFICANT]
    # the most significant pressure band of each place; cells come with that first
    places: dict[tuple[str, str, str], Cell] = {}
    for c in strong:
        places.setdefault((c.test, c.component, c.region), c)
    items = [
        f"{_cell(c, several)}: measured - modelled is {c.mean:+.3g} mm on average "
        f"({abs(c.significance):.0f} standard errors)."
        for c in list(places.values())[:_MOST_CELLS]
    ]
    items.append(
        f"In all {len(strong)} of {len(rest.cells)} cells (component, region, pressure band) are "
        f"beyond {SIGNIFICANT:g} standard errors."
    )
    modes = [
        m
        for m in azimuthal_modes(data_of(diagnosis), diagnosis.explanation.final)
        if m.growth is not Growth.NONE
    ]
    modes.sort(key=lambda m: -float(abs(m.amplitude).max()) / m.noise)
    items += [
        f"It looks like {m.component} m = {m.order}, up to {abs(m.amplitude).max():.3g} mm, "
        f"{m.growth.words}{f' ({m.test})' if several else ''}."
        for m in modes[:_MOST_MODES]
    ]
    return items


def _cell(cell: Cell, several: bool) -> str:
    low, high = cell.band
    test = f"{cell.test}, " if several else ""
    return f"{test}{cell.component} at the {cell.region}, {low:.3g} to {high:.3g} bar"


def _actions(diagnosis: Diagnosis) -> list[str]:
    effects = dict.fromkeys(e for c in diagnosis.causes for e in (c.effect, *c.alternatives))
    items = [f"{e}: {CATALOGUE[e].remedy}." for e in effects if e in CATALOGUE]
    for found in diagnosis.explanation.fields:
        kind = fields()[effect_of(found.group)]
        items.append(f"{kind.id}: {kind.remedy}.")
    if any(p.noise.source is not Source.AT_REST for p in diagnosis.prepared):
        items.append(
            "Film some ten images at rest before inflation: the noise had to be judged from the "
            "field itself."
        )
    items += [
        f"Record the {need} of every frame: without it {effect} cannot be tried."
        for effect in diagnosis.skipped
        for need in CATALOGUE[effect].needs
    ]
    return items


def _advice(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.advice:
        return ["No two explanations compete; no further measurement is needed to split them."]
    now, *others = diagnosis.advice
    pair = _listed(now.between)
    useful = [a for a in others if a.separation > 1.05 * now.separation]
    if not any(c.alternatives for c in diagnosis.causes) and now.separation >= _APART:
        return [
            f"The two leading explanations, {pair}, lie "
            f"{now.separation:.0f} standard errors apart with this data: no further measurement "
            "is needed to split them."
        ]
    if not useful:
        return [f"No further measurement that was tried would split {pair}."]
    options = [f"{a.measurement} ({a.separation:.0f})" for a in useful[:3]]
    return [
        f"To split {pair}, best first: {'; '.join(options)}. In brackets the "
        f"standard errors that would lie between them; now it is {now.separation:.0f}."
    ]


def _notes(diagnosis: Diagnosis) -> list[str]:
    items = list(diagnosis.warnings)
    items += [f"{effect} was not tried: {why}." for effect, why in diagnosis.skipped.items()]
    for p in diagnosis.prepared:
        noise, name = p.noise, p.data.specimen.test.name
        sizes = ", ".join(f"{1000 * s:.1f}" for s in noise.sigma)
        items.append(
            f"{name}: noise of dx, dy, dz is {sizes} µm (from {noise.source}), correlated over "
            f"{noise.correlation_length:.1f} mm: {noise.inflation:.3g} points count as one."
        )
        if p.mesh_error is not None:
            sizes = ", ".join(f"{1000 * s:.1f}" for s in p.discretisation)
            left = ", ".join(f"{1000 * s:.1f}" for s in p.mesh_error)
            items.append(
                f"{name}: the mesh's error, {sizes} µm, was taken off by Richardson's "
                f"extrapolation; about {left} µm are left."
            )
    for pair in diagnosis.pairs:
        if STIFFNESS in pair.effects:
            effect = CATALOGUE[pair.effects[0]]
            items.append(
                f"{effect.id} and {STIFFNESS} can never be told apart by a bulge test: "
                f"{effect.never_separable}."
            )
    return [*items, *_alike(diagnosis)]


def _alike(diagnosis: Diagnosis) -> Iterator[str]:
    """What looks like a cause without being in its set."""
    for cause in diagnosis.causes:
        others = {
            (pair.effects[1] if pair.effects[0] == cause.effect else pair.effects[0]): pair.cosine
            for pair in diagnosis.pairs
            if cause.effect in pair.effects
        }
        near = [f"{e} ({c:.2f})" for e, c in others.items() if e not in cause.alternatives]
        if near:
            yield (
                f"{cause.effect} looks much like {_listed(near)} in this data (cosine in "
                "brackets); the evidence prefers it still."
            )
