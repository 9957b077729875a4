"""What else must be said: alarms, noise, the mesh, and what looks alike?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bulgefit.effects.registry import catalogue
from bulgefit.gap.follow_up.separate import STIFFNESS
from bulgefit.report.numbers import listed
from bulgefit.report.record import Record

__all__ = ["alarms_of", "note_items"]


def alarms_of(record: Record) -> list[str]:
    """What makes results meaningless; nothing is known of it where an earlier version wrote."""
    return list(record.get("alarms", ()))


def note_items(record: Record) -> list[str]:
    """Warnings, what was not tried, noise and mesh of each test, and what looks alike."""
    items = list(record["warnings"])
    items += [f"{name} was held at {value:g}." for name, value in record.get("held", {}).items()]
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
    return [*items, *dict.fromkeys(_alike(record))]  # an effect of several tests is told once


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
