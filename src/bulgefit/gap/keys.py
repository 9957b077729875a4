"""Which parameters are freed, whose are they, and what may their values be?

A key names a parameter, its effect, and the specimen whose own it is, where several are judged
together. `OFFSETS` stands for an offset of every measured point: it has no column of derivatives,
since it is taken off exactly (`bulgefit.gap.normal`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from bulgefit.effects.parameter import Key, Parameter
from bulgefit.effects.registry import effect_named
from bulgefit.gap.effects import MODULI, OFFSETS

__all__ = [
    "at_edge",
    "by_value",
    "columns_of",
    "has_offsets",
    "is_shared",
    "names_of",
    "offsets_of_points",
    "parameter_of",
    "specimen_values",
]

#: Least and largest modulus (MPa) of what is woven, in the order of `MODULI`.
_BOUNDS = ((20.0, 3000.0), (20.0, 3000.0), (0.5, 1000.0))
_MODULI = {
    key: Parameter(key.name, "MPa", *bounds, null=None, coordinate="log", origin=0.0)
    for key, bounds in zip(MODULI, _BOUNDS, strict=True)
}


def parameter_of(key: Key) -> Parameter:
    """The parameter of a key."""
    return effect_named(key.effect).parameter(key.parameter) if key.effect else _MODULI[key]


def by_value(name: str, values: Mapping[str, float]) -> float:
    """∂(what the model differentiates by)/∂(a parameter), at the values of a specimen."""
    return parameter_of(Key.of(name)).by_value(values.get(name, 0.0))


def is_shared(key: Key) -> bool:
    """Whether it belongs to the cloth: its specimens share it."""
    return not key.effect or effect_named(key.effect).shared


def offsets_of_points(count: int) -> tuple[Key, ...]:
    """The offsets of so many specimens."""
    return (OFFSETS,) if count == 1 else tuple(OFFSETS._replace(specimen=i) for i in range(count))


def has_offsets(keys: Iterable[Key], index: int) -> bool:
    """Whether the offset of every point of specimen `index` is freed."""
    return any(_is_offsets(key) and key.specimen in (None, index) for key in keys)


def columns_of(keys: Iterable[Key]) -> tuple[Key, ...]:
    """Keys that have derivatives."""
    return tuple(key for key in keys if not _is_offsets(key))


def _is_offsets(key: Key) -> bool:
    return key.effect == OFFSETS.effect


def at_edge(key: Key, value: float) -> bool:
    """Whether a freed parameter sits at the edge of its plausible range."""
    parameter = parameter_of(key)
    if parameter.period is not None:
        return False  # beyond it the same comes again
    near = 1e-3 * (parameter.upper - parameter.lower)
    low = value - parameter.lower < near and not parameter.begins_at_null
    return bool(parameter.upper - value < near or low)


def names_of(keys: Sequence[Key], index: int) -> tuple[list[str], list[int]]:
    """Model parameters of specimen `index` among the keys with derivatives, and their columns."""
    own = [(k.name, c) for c, k in enumerate(columns_of(keys)) if k.specimen in (None, index)]
    return [name for name, _ in own], [column for _, column in own]


def specimen_values(values: Mapping[Key, float], index: int) -> dict[str, float]:
    """Model parameters of one specimen."""
    return {key.name: value for key, value in values.items() if key.specimen in (None, index)}
