"""Which names may an option be given? For a shell that completes them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import Any

__all__ = ["offer_values"]

Names = Iterable[str]


def offer_values(parser: argparse.ArgumentParser, verb: str) -> None:
    """Let what completes a verb's line offer the names that its options take.

    They are looked up when a shell asks for them; options that take files and numbers are not told.
    """
    for action in parser._actions:
        for option in action.option_strings:
            known = _NAMES.get((verb, option)) or _NAMES.get(("", option))
            if known is not None:
                action.completer = known  # type: ignore[attr-defined]


def _one(names: Callable[[], Names]) -> Callable[..., list[str]]:
    """One of the names."""

    def offered(**_: Any) -> list[str]:
        return list(names())

    return offered


def _several(names: Callable[[], Names]) -> Callable[..., list[str]]:
    """Names with commas between them; none is offered twice."""

    def offered(prefix: str, **_: Any) -> list[str]:
        before = prefix.rpartition(",")[0]
        start = f"{before}," if before else ""
        return [f"{start}{name}" for name in names() if name not in before.split(",")]

    return offered


def _equated(names: Callable[[], Names]) -> Callable[..., list[str]]:
    """`NAME=`, of which there may be several with commas between them."""
    whole = _several(names)

    def offered(prefix: str, **_: Any) -> list[str]:
        return [f"{name}=" for name in whole(prefix)]

    return offered


def _objectives() -> Names:
    from bulgefit.fitting.objective import LIKELIHOOD, OBJECTIVES

    return (*OBJECTIVES, LIKELIHOOD)


def _averages() -> Names:
    from bulgefit.fitting.objective import AVERAGES

    return AVERAGES


def _materials() -> Names:
    from bulgefit.model.parameters import MATERIALS

    return MATERIALS


def _methods() -> Names:
    from bulgefit.fitting.minimise import METHODS

    return METHODS


def _evaluations() -> Names:
    from bulgefit.model.observation import METHODS

    return METHODS


def _interpolations() -> Names:
    from bulgefit.model.setup import INTERPOLATIONS

    return INTERPOLATIONS


def _laws() -> Names:
    from bulgefit.fem.laws.registry import LAWS

    return LAWS


def _solvers() -> Names:
    from bulgefit.fem.linear import SOLVERS

    return SOLVERS


def _effects() -> Names:
    from bulgefit.effects.registry import catalogue

    return catalogue()


def _parameters() -> Names:
    from bulgefit.effects.registry import catalogue

    return [name for effect in catalogue().values() for name in effect.names]


def _fitted() -> Names:
    return ["E1", "E2", "G12", "nu12", *_parameters()]


def _kinds() -> Names:
    from bulgefit.trial.plan import KNOWN_KINDS

    return KNOWN_KINDS


def _fields() -> Names:
    from bulgefit.report.cloud import FIELDS, RESIDUALS

    return (*FIELDS, *RESIDUALS)


def _formats() -> Names:
    from bulgefit.dic.readers import READERS, load_plugins

    load_plugins()
    return READERS


def _positions() -> Names:
    from bulgefit.dic.formats.positions import POSITIONS

    return POSITIONS


def _lengths() -> Names:
    from bulgefit.dic.units import LENGTH

    return LENGTH


def _pressures() -> Names:
    from bulgefit.dic.units import PRESSURE

    return PRESSURE


#: By verb ("" for every one that has the option) and option.
_NAMES: dict[tuple[str, str], Callable[..., list[str]]] = {
    ("", "--objective"): _one(_objectives),
    ("", "--average"): _one(_averages),
    ("", "--material"): _one(_materials),
    ("", "--method"): _one(_methods),
    ("", "--evaluation"): _one(_evaluations),
    ("", "--interpolation"): _one(_interpolations),
    ("", "--law"): _one(_laws),
    ("", "--linear-solver"): _one(_solvers),
    ("", "--with"): _several(_effects),
    ("", "--hold"): _equated(_parameters),
    ("", "--prior"): _equated(_fitted),
    ("", "--bounds"): _equated(_fitted),
    ("diagnose", "--effects"): _several(_effects),
    ("trial", "--effects"): _several(_kinds),
    ("", "--field"): _one(_fields),
    ("", "--format"): _one(_formats),
    ("", "--positions"): _one(_positions),
    ("", "--length-unit"): _one(_lengths),
    ("", "--pressure-unit"): _one(_pressures),
}
