"""Which effects are there? Every file of this room, and those that installed packages bring.

A package of your own adds one by an entry point of the group `bulgefit.effects` whose object is
an `Effect` (or a class of one).
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cache
from importlib.metadata import entry_points
from typing import TypeVar

import bulgefit.effects as room
import bulgefit.effects.fields as fields_room
from bulgefit.effects.base import PLACES, Effect
from bulgefit.effects.fields.base import Field
from bulgefit.effects.parameter import Key, Parameter
from bulgefit.errors import InputError

__all__ = [
    "GROUP",
    "acting",
    "acts_through",
    "catalogue",
    "chosen_effects",
    "effect_named",
    "fields",
    "own_values",
    "parameter_named",
    "scatter",
]

#: Group of entry points by which other packages add effects.
GROUP = "bulgefit.effects"

Kind = TypeVar("Kind", bound=Effect)

_NO_EFFECTS = ("base", "fields", "further", "parameter", "places", "registry")
_NO_FIELDS = ("base", "edge_waves")


@cache
def catalogue() -> dict[str, Effect]:
    """Every effect that may be a cause, by its id, in the order in which they act.

    By place, then by `order` and id.
    """
    return {name: effect for name, effect in _room().items() if not effect.scatters}


@cache
def scatter() -> dict[str, Effect]:
    """What specimens of one cloth have about its mean, by its id."""
    return {name: effect for name, effect in _room().items() if effect.scatters}


@cache
def _room() -> dict[str, Effect]:
    """Every effect by its id.

    Raises
    ------
    InputError
        An installed package's effect that cannot be used.
    """
    own = (name for _, name, _ in pkgutil.iter_modules(room.__path__) if name not in _NO_EFFECTS)
    found = {name: importlib.import_module(f"{room.__name__}.{name}").EFFECT for name in own}
    for point in entry_points(group=GROUP):
        effect = _brought(point.name, point.load)
        if effect.id in found:
            raise InputError(f"effect {effect.id} of {point.value}: there is one of that name")
        found[effect.id] = effect
    return _in_order(found.values())


@cache
def fields() -> dict[str, Field]:
    """The generic field of every place by its id, in the order in which they act."""
    found = (
        importlib.import_module(f"{fields_room.__name__}.{name}").EFFECT
        for _, name, _ in pkgutil.iter_modules(fields_room.__path__)
        if name not in _NO_FIELDS
    )
    return _in_order(found)


@cache
def acting() -> dict[str, Effect]:
    """Effects and fields by id, in the order in which they act."""
    return _in_order([*_room().values(), *fields().values()])


def _in_order(found: Iterable[Kind]) -> dict[str, Kind]:
    rank = {place: k for k, place in enumerate(PLACES)}
    return {e.id: e for e in sorted(found, key=lambda e: (rank[e.place], e.order, e.id))}


def _brought(name: str, load: object) -> Effect:
    """What an entry point brings."""
    try:
        found = load()  # type: ignore[operator]
        effect = found() if isinstance(found, type) else found
    except Exception as error:
        raise InputError(
            f"effect {name} of an installed package cannot be loaded ({type(error).__name__}: "
            f"{error}); mend or remove that package"
        ) from error
    if not isinstance(effect, Effect) or effect.place not in PLACES or not effect.id:
        raise InputError(
            f"effect {name} of an installed package is no bulgefit.effects.base.Effect with an id "
            f"and a place ({', '.join(PLACES)})"
        )
    return effect


def effect_named(name: str) -> Effect:
    """An effect or a field by its id; InputError names those that are near."""
    return _known(name, acting())


def _known(name: str, known: Mapping[str, Effect]) -> Effect:
    if name not in known:
        near = get_close_matches(name, known, n=3)
        raise InputError(
            f"effect {name!r} is unknown; "
            + (f"did you mean {' or '.join(near)}?" if near else f"choose from {', '.join(known)}")
        )
    return known[name]


def parameter_named(name: str) -> Parameter:
    """An effect's parameter by `effect.parameter`; InputError names those there are."""
    key = Key.of(name)
    if not key.effect:
        raise InputError(f"{name!r} is no parameter of an effect; write effect.parameter")
    effect = effect_named(key.effect)
    try:
        return effect.parameter(key.parameter)
    except KeyError:
        known = [p.name for p in effect.parameters]
        near = get_close_matches(key.parameter, known, n=3) or known
        raise InputError(
            f"{effect.id} has no parameter {key.parameter!r}; choose from {', '.join(near)}"
        ) from None


def acts_through(name: str, *hooks: str) -> bool:
    """Whether a parameter (`effect.parameter`) is of an effect that has any of these hooks."""
    return "." in name and effect_named(name.partition(".")[0]).uses(*hooks)


def chosen_effects(names: Iterable[str] | None) -> list[Effect]:
    """Effects by id (default: all), in the catalogue's order; InputError for unknown ones.

    Names in one string stand apart by commas.
    """
    if names is None:
        return list(catalogue().values())
    if isinstance(names, str):
        names = [name.strip() for name in names.split(",")]
    if not isinstance(names, Iterable):
        raise InputError(f"effects: give names, such as clamp_slip, not {names!r}")
    names = list(names)
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"effects: {name!r} is no name; give some such as clamp_slip")
    wanted = {_known(name, catalogue()).id for name in names}
    return [effect for effect in catalogue().values() if effect.id in wanted]


def own_values(
    effect: Effect, values: Mapping[str, float], nulls: Mapping[str, float]
) -> dict[str, float]:
    """Values of an effect's parameters by their own names, nulls where none are given."""
    own = {}
    for name, whole, null in _spelt(effect):
        value = values.get(whole)
        if value is None:
            value = nulls.get(whole, null)
        own[name] = 0.0 if value is None else value
    return own


@cache
def _spelt(effect: Effect) -> tuple[tuple[str, str, float | None], ...]:
    """An effect's parameters by their own and their whole names, with their nulls."""
    pairs = zip(effect.parameters, effect.names, strict=True)
    return tuple((parameter.name, whole, parameter.null) for parameter, whole in pairs)
