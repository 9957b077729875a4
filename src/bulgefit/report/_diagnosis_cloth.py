"""What does a diagnosis say of the cloth: its law, how its specimens differ, how high it stood?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bulgefit.gap.effects import SHEAR
from bulgefit.report.numbers import listed, value_text
from bulgefit.report.page.blocks import Block
from bulgefit.report.page.law_chart import law_chart
from bulgefit.report.record import Record

__all__ = ["AT_REST", "cloth_blocks", "cloth_lines", "is_bent", "secant_rows", "stiffness_of"]

#: The modulus of each axis.
_AXES = {"E1": "warp", "E2": "fill"}
#: Of a bent law.
AT_REST = (
    "Stress is not proportional to strain: E1 and E2 by themselves are slopes at rest; use the "
    "law, or its secant moduli at the strains of use."
)


def is_bent(record: Record) -> bool:
    """Whether the stiffness along warp and fill changes with strain."""
    return "secant" in record["parameters"]["corrected"]


def stiffness_of(record: Record) -> dict[str, Mapping[str, Any]]:
    """What is to be used, MPa: moduli, of a bent law the secants at the largest strains reached.

    Where none of the strains was reached at which secants are told, it is that at the least.
    """
    moduli = record["parameters"]["corrected"]
    if not is_bent(record):
        return {name: moduli[name] for name in (*_AXES, SHEAR.name)}
    out = {}
    secant, reached = moduli["secant"], record["law"]["reached"]
    for modulus, axis in _AXES.items():
        at = max(sum(s <= reached[axis] for s in secant["strain"]) - 1, 0)
        out[f"{modulus} at {100 * secant['strain'][at]:g} % strain"] = {
            "value": secant[modulus]["value"][at],
            "stderr": secant[modulus]["stderr"][at],
            "held": False,
        }
    return {**out, SHEAR.name: moduli[SHEAR.name]}


def cloth_lines(record: Record) -> list[str]:
    """Sentences for a terminal."""
    lines = [_reached(record)]
    if record["scatter"]:
        lines.append(_scatter(record))
        lines += [_specimen(own) for own in record["specimens"]]
    return [*lines, *_heights(record)]


def cloth_blocks(record: Record) -> list[Block]:
    """The part of a page."""
    caption = (
        "Force under tension along warp or fill alone against the logarithmic strain, with its "
        "95 % band. The circle is the largest strain that was reached; dashed beyond it."
    )
    blocks = [
        Block("heading", ("The law of the cloth",)),
        Block("text", (_reached(record),)),
        Block("law", (caption,), picture=law_chart(record["law"])),
    ]
    if secants := secant_rows(record):
        blocks.append(Block("table", rows=tuple(secants)))
    if record["scatter"]:
        blocks += _specimen_blocks(record)
    return [*blocks, *_height_blocks(record)]


def secant_rows(record: Record) -> list[tuple[str, ...]]:
    """Secant moduli (MPa) by strain, a header first; none where they do not change with it."""
    if not is_bent(record):
        return []
    secant = record["parameters"]["corrected"]["secant"]
    strains = secant["strain"]
    rows = [("secant modulus (MPa)", *(f"at {100 * s:g} %" for s in strains))]
    for modulus, axis in _AXES.items():
        found, reached = secant[modulus], record["law"]["reached"][axis]
        cells = zip(strains, found["value"], found["stderr"], strict=True)
        rows.append((modulus, *(_secant(v, e, s <= reached) for s, v, e in cells)))
    return rows


def _secant(value: float, stderr: float, reached: bool) -> str:
    text = value_text(value, stderr)
    return text if reached else f"({text})"


def _reached(record: Record) -> str:
    reached = record["law"]["reached"]
    ends = listed([f"{100 * reached[a]:.2g} % along {a}" for a in _AXES.values()])
    if not is_bent(record):
        return f"The model's stress is proportional to the strain, of which {ends} were reached."
    return (
        f"{AT_REST} Strains of {ends} were reached; beyond them (in brackets) the law is what its "
        "form makes of it."
    )


def _percent(scatter: Mapping[str, Any], modulus: str) -> str:
    return f"{value_text(100 * scatter[modulus], 100 * scatter['stderr'][modulus])} %"


def _scatter(record: Record) -> str:
    spread = listed([f"{m} by {_percent(record['scatter'], m)}" for m in _AXES])
    return f"From specimen to specimen the cloth scatters in {spread} (standard deviation)."


def _specimen(own: Mapping[str, Any]) -> str:
    factors = listed([f"{m} is {_factor(own, m)} times the cloth's" for m in _AXES])
    effects = f"; of its own: {listed(own['effects'])}" if own["effects"] else ""
    return f"{own['test']}: {factors}{effects}."


def _factor(own: Mapping[str, Any], modulus: str) -> str:
    return value_text(own["factors"][modulus]["value"], own["factors"][modulus]["stderr"])


def _specimen_blocks(record: Record) -> list[Block]:
    scatter = [
        ("modulus", "standard deviation over specimens"),
        *((m, _percent(record["scatter"], m)) for m in _AXES),
    ]
    rows = [("specimen", *(f"{m} over the cloth's" for m in _AXES), "effects of its own")]
    rows += [
        (own["test"], *(_factor(own, m) for m in _AXES), listed(own["effects"]) or "none")
        for own in record["specimens"]
    ]
    told = (
        "The moduli are those of the mean specimen: factors multiply to 1. A few specimens tell "
        "the scatter roughly; where they tell little it is what coated fabrics have, 5 to 10 %."
    )
    return [
        Block("heading", ("How specimens of the cloth differ",)),
        Block("table", rows=tuple(scatter)),
        Block("table", rows=tuple(rows)),
        Block("text", (told,)),
    ]


def _heights(record: Record) -> Iterator[str]:
    for implied in record["implied_reference"]:
        if implied["stderr"] is not None:
            yield (
                f"{implied['test']}: before inflation its centre stood "
                f"{value_text(implied['apex_mm'], implied['stderr'])} mm over the plane of its "
                f"points, as the model has it ({implied['rms_mm']:.2g} mm rms of all)."
            )


def _height_blocks(record: Record) -> list[Block]:
    known = [i for i in record["implied_reference"] if i["stderr"] is not None]
    if not known:
        return []
    rows = [("test", "centre (mm)", "rms of all points (mm)")]
    rows += [
        (i["test"], value_text(i["apex_mm"], i["stderr"]), f"{i['rms_mm']:.2g}") for i in known
    ]
    told = (
        "How high the cloth stood before inflation over the plane through its points, as the "
        "model has it: compare it with z of the reference image where that was kept."
    )
    return [
        Block("heading", ("The shape before inflation",)),
        Block("text", (told,)),
        Block("table", rows=tuple(rows)),
    ]
