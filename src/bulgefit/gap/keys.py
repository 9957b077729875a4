"""What is a freed parameter called, whose is it, and what may its value be?

A key is a model parameter's name; where several specimens are judged together, `name@i` is
specimen i's own. `FIELD` stands for an offset of every measured point: it has no column of
derivatives, since it is taken off exactly (`bulgefit.gap.normal`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from bulgefit.effects.registry import acting
from bulgefit.gap.data import Data
from bulgefit.gap.effects import CATALOGUE, FIELD, MODULI

__all__ = [
    "at_edge",
    "bounds_of",
    "chain_factor",
    "columns_of",
    "effect_of",
    "group_keys",
    "has_field",
    "is_field",
    "names_of",
    "null_of",
    "own_key",
    "specimen_values",
    "start_of",
]

_MODULUS_BOUNDS = {"E1": (20.0, 3000.0), "E2": (20.0, 3000.0), "G12": (0.5, 1000.0)}


def own_key(name: str, index: int, several: bool) -> str:
    """The regression's name of a model parameter of specimen `index`."""
    effect = name.partition(".")[0]
    shared = name in MODULI or acting()[effect].shared
    return f"{name}@{index}" if several and not shared else name


def group_keys(names: Iterable[str], count: int) -> tuple[str, ...]:
    """Keys of a group of model parameters over `count` specimens."""
    keys: dict[str, None] = {}
    for name in names:
        for index in range(count):
            keys[own_key(name, index, count > 1)] = None
    return tuple(keys)


def effect_of(key: str) -> str:
    """Effect that a freed key belongs to, "" for a modulus."""
    name = key.partition("@")[0].partition(".")[0]
    return name if name in CATALOGUE else ""


def is_field(key: str) -> bool:
    """Whether a key is the offset of every point."""
    return key.partition("@")[0] == FIELD


def has_field(keys: Iterable[str], index: int) -> bool:
    """Whether the offset of every point of specimen `index` is freed."""
    return any(k == FIELD or k == f"{FIELD}@{index}" for k in keys)


def columns_of(keys: Iterable[str]) -> tuple[str, ...]:
    """Keys that have derivatives."""
    return tuple(k for k in keys if not is_field(k))


def bounds_of(key: str) -> tuple[float, float]:
    """Plausible range of a freed parameter."""
    name = key.partition("@")[0]
    if name in _MODULUS_BOUNDS:
        return _MODULUS_BOUNDS[name]
    effect, _, parameter = name.partition(".")
    found = acting()[effect].parameter(parameter)
    return found.lower, found.upper


def at_edge(key: str, value: float) -> bool:
    """Whether a freed parameter sits at the edge of its plausible range.

    A range that begins at zero begins at the null (but that of nu12), which is no edge.
    """
    low, high = bounds_of(key)
    near = 1e-3 * (high - low)
    begins_at_null = low == 0.0 and key.partition("@")[0] != "poisson_ratio.nu12"
    return bool(high - value < near or (value - low < near and not begins_at_null))


def start_of(key: str, data: Sequence[Data]) -> float:
    """Where a fit of a freed parameter starts."""
    name, _, owner = key.partition("@")
    if is_field(key):
        return 1.0
    if name == "poisson_ratio.nu12":
        return data[int(owner) if owner else 0].specimen.test.poisson_ratio
    effect, _, parameter = name.partition(".")
    found = acting()[effect].parameter(parameter)
    return found.start if found.start is not None else null_of(key, data)


def null_of(key: str, data: Sequence[Data]) -> float:
    """The value at which a parameter's effect is absent."""
    name, _, owner = key.partition("@")
    effect, _, parameter = name.partition(".")
    null = acting()[effect].parameter(parameter).null if effect in acting() else 0.0
    if null is None:
        null = data[int(owner) if owner else 0].specimen.nulls()[name]
    return null


def names_of(keys: Sequence[str], index: int, several: bool) -> tuple[list[str], list[int]]:
    """Model parameters of specimen `index` among the keys with derivatives, and their columns."""
    names, places = [], []
    for place, key in enumerate(columns_of(keys)):
        name, _, owner = key.partition("@")
        if not owner or int(owner) == index:
            names.append(name)
            places.append(place)
    return names, places


def specimen_values(values: Mapping[str, float], index: int) -> dict[str, float]:
    """Model parameters of one specimen."""
    out = {}
    for key, value in values.items():
        name, _, owner = key.partition("@")
        if (not owner or int(owner) == index) and not is_field(key):
            out[name] = value
    return out


def chain_factor(key: str, values: Mapping[str, float]) -> float:
    """∂(what the model differentiates by)/∂(the parameter): the window enters as its square."""
    if key.startswith("dic_smoothing.window"):
        return 2.0 * max(values.get("dic_smoothing.window", 0.0), 0.5)
    return 1.0
