"""The page of a fit: which parameters to use, within how much, and how good the fit is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from bulgefit.report.numbers import listed, value_text
from bulgefit.report.page.blocks import Answer, Block, Page, Value
from bulgefit.shown import after_value, plain

__all__ = ["page_of_fit"]

Result = Mapping[str, Any]

#: Warning that what is left is no noise: of no value it is sure then that its interval holds it.
_LACKS = "model_lacks"
#: Warnings that are about one parameter, or about how sure a value is; all others say that the test
#: or the fit cannot be used as it is.
_OF_PARAMETERS = (
    "at_bound", "inseparable", "undetermined", "starts_disagree", "mesh_error_unknown",
    "mesh_remainder_unknown", "mesh_error_large", "stated_unknown", "apex_hole", "prior_conflict",
    _LACKS,
)  # fmt: skip
#: Correlation from which a change of one parameter is made up for by half its error in another:
#: sqrt(1 - 0.87²) = 0.5.
_TOGETHER = 0.87


def page_of_fit(result: Result) -> Page:
    """The page of a fit's JSON."""
    names = listed([str(t["name"]) for t in result["sources"]])
    blocks = [
        Block("heading", ("The parameters",)),
        Block("table", rows=_parameter_rows(result)),
        *_of_effects(result),
        Block("heading", ("How good the fit is",)),
        Block("list", tuple(_quality(result))),
        Block("table", rows=_test_rows(result)),
        Block("fields"),
        *_more(result),
        Block("heading", ("How it was searched",)),
        Block("list", tuple(_search(result))),
        Block("table", rows=_start_rows(result)),
    ]
    return Page(f"Material parameters of {names}", "fit", _answer(result), tuple(blocks))


def _of_effects(result: Result) -> list[Block]:
    """How well effects' parameters are found; the answer says it of the material's."""
    words = result["quality"]["identifiability"].items()
    told = tuple(text for name, text in words if "." in name)
    return [Block("list", told)] if told else []


def _free(result: Result) -> dict[str, Any]:
    return {name: p for name, p in result["parameters"].items() if p["free"]}


def _answer(result: Result) -> Answer:
    warnings = result["quality"]["warnings"]
    stop = [w["text"] for w in warnings if w["code"] not in _OF_PARAMETERS]
    values = tuple(_value(name, p, result) for name, p in _free(result).items() if "." not in name)
    usable = [v for v in values if v.use != "no"]
    rest = [v.name for v in values if v.use == "no"]
    notes = [*stop, *(w["text"] for w in warnings if w["code"] in _OF_PARAMETERS)]
    if stop:
        return Answer("Do not use these values: the test or the fit has a fault.", "bad",
                      values, tuple(notes))  # fmt: skip
    how, within = "use", "95 %"
    if any(w["code"] == _LACKS for w in warnings):
        how, within = "use only with care", "95 %, if the model lacked nothing"
        values = tuple(replace(v, use="care") if v.use == "use" else v for v in values)
    use = f"{how} {listed([f'{v.name} = {v.text}' for v in usable])} ({within})" if usable else ""
    dont = f"do not use {listed(rest)}" if rest else ""
    headline = "; ".join(filter(None, (use, dont)))
    tone = "good" if usable and not rest and not notes else "care" if usable else "bad"
    return Answer(f"{headline[0].upper()}{headline[1:]}.", tone, values, tuple(notes))


def _value(name: str, found: Mapping[str, Any], result: Result) -> Value:
    unit = after_value(found["unit"])
    text = f"{found['value']:.4g}{unit}"
    if found["at_bound"]:
        return Value(
            name, text, "no", f"sits at its bound {found['lower']:g} to {found['upper']:g}"
        )
    words = result["quality"]["identifiability"].get(name, "")
    ends = found["interval95"]
    if ends is None:
        return Value(name, text, "no", "not determined")
    text = _within(found["value"], *ends) + unit
    if "hardly" in words or "cannot" in words:
        return Value(name, text, "no", words)
    return Value(name, text, "care" if "roughly" in words else "use", words)


def _within(value: float, low: float, high: float) -> str:
    """A value with its interval: as ± where that is even, else with both ends."""
    down, up = value - low, high - value
    if min(down, up) > 0.0 and max(down, up) <= 1.1 * min(down, up):
        return value_text(value, 0.5 * (down + up))
    return f"{value:.4g} ({low:.4g} to {high:.4g})"


def _parameter_rows(result: Result) -> tuple[tuple[str, ...], ...]:
    rows = [("parameter", "value", "standard error", "95 % interval", "how")]
    for name, p in result["parameters"].items():
        if not p["free"]:
            rows.append((name, f"{p['value']:.6g}{after_value(p['unit'])}", "", "", "held"))
            continue
        ends = p["interval95"]
        rows.append(
            (
                name,
                f"{p['value']:.6g}{after_value(p['unit'])}",
                "" if p["stderr"] is None else f"{p['stderr']:.3g}",
                "" if ends is None else f"{ends[0]:.6g} to {ends[1]:.6g}",
                "at its bound: no result" if p["at_bound"] else "fitted",
            )
        )
    return tuple(rows)


def _quality(result: Result) -> list[str]:
    quality = result["quality"]
    lines = []
    if quality["misfit_over_noise"] is not None:
        lines.append(f"The misfit is {quality['misfit_over_noise']:.3g} times the noise.")
    explained = plain(100 * quality["explained_share"], 4)
    lines.append(
        f"{explained} % of the measured displacement is explained, against a model that does not "
        "deform."
    )
    if quality["structured_share"] is not None:
        lines.append(
            f"{plain(100 * quality['structured_share'], 3)} % of the square misfit is no noise."
        )
    for key, what in (("noise_mm", "Noise"), ("mesh_error_mm", "Left of the mesh's error:")):
        if quality[key] is not None:
            sizes = ", ".join(plain(1000 * s, 2) for s in quality[key])
            lines.append(f"{what} {'of dx, dy, dz: ' if key == 'noise_mm' else ''}{sizes} µm.")
    lines += [
        f"{listed(pair['parameters'])} go together (correlation {pair['correlation']:.2f})."
        for pair in result["correlations"]
        if abs(pair["correlation"]) > _TOGETHER
    ]
    beyond = result["stability"]["frames_beyond"]
    if beyond:
        lines.append(
            f"The model is stable up to {result['stability']['stable_up_to_bar']:.3g} bar, "
            f"not in {beyond} frames: judge the fit without them (--max-pressure)."
        )
    return lines


def _test_rows(result: Result) -> tuple[tuple[str, ...], ...]:
    heads = ("dx", "dy", "dz", "e", "e_w", "e_z")
    rows: list[tuple[str, ...]] = [("mean absolute deviation (mm)", *heads)]
    for test in result["tests"]:
        cells = ("–" if test[h] is None else f"{test[h]:.4f}" for h in heads)
        rows.append((str(test["name"]), *cells))
    return tuple(rows)


def _more(result: Result) -> list[Block]:
    """What --bootstrap and --cross-table found."""
    blocks = []
    if "bootstrap" in result:
        found = result["bootstrap"]
        head = (
            f"{100 * found['level']:g} % interval of {found['replicates']} refits to drawn frames"
        )
        rows = [("parameter", head)]
        for name, p in found["parameters"].items():
            low, high = p["interval"]
            rows.append((name, f"{low:.6g} to {high:.6g}{after_value(p['unit'])}"))
        blocks += [Block("heading", ("By bootstrap",)), Block("table", rows=tuple(rows))]
    if "cross_table" in result:
        table = result["cross_table"]
        heads = list(next(iter(table.values())))
        rows = [("objective (mm) under", *heads)]
        rows += [
            (name, *("–" if v is None else f"{v:.4f}" for v in row.values()))
            for name, row in table.items()
        ]
        blocks += [
            Block("heading", ("Each objective's optimum",)),
            Block("table", rows=tuple(rows)),
        ]
    return blocks


def _search(result: Result) -> list[str]:
    settings, objective = result["settings"], result["objective"]
    starts = result["starts"]
    converged = sum(s["converged"] for s in starts)
    unit = after_value(objective["unit"])
    return [
        f"{objective['name']} = {objective['value']:.6g}{unit}, law {settings['law']}, "
        f"{settings['method']}.",
        f"{len(starts)} starts, {converged} converged, "
        f"{result['quality']['agreeing_starts']} at this optimum; {result['evaluations']} forward "
        f"paths, {result['failures']} failed; {result['seconds']:.1f} s.",
    ]


def _start_rows(result: Result) -> tuple[tuple[str, ...], ...]:
    names = list(result["starts"][0]["parameters"])
    rows = [("start", *names, result["objective"]["name"], "why it stopped")]
    for number, start in enumerate(result["starts"], 1):
        value = start["objective"]
        rows.append(
            (
                str(number),
                *(f"{start['parameters'][n]:.5g}" for n in names),
                "failed" if value is None else f"{value:.5g}",
                str(start["reason"]),
            )
        )
    return tuple(rows)
