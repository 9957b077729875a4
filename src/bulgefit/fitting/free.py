"""What does a fit free, within which bounds, and what does it hold?"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.parameter import Key, Parameter
from bulgefit.effects.registry import effect_named, parameter_named
from bulgefit.errors import InputError
from bulgefit.model.description import require_needs

__all__ = [
    "AT_BOUND",
    "at_end",
    "bounded",
    "freed",
    "held_values",
    "key_among",
    "stated_ratio",
    "turns",
    "within",
]

#: Part of the range between the bounds within which a parameter counts as at its bound.
AT_BOUND = 1e-3


def held_values(given: Mapping[str, float], ours: set[str], count: int) -> dict[Key, float]:
    """What is held, by key, of what was given by name.

    Parameters
    ----------
    given : mapping
    ours : set of str
        Names of the material's parameters.
    count : int
        Of tests.

    Raises
    ------
    InputError
        A name is unknown, or a value means nothing.
    """
    out = {}
    for name, value in given.items():
        if not np.isfinite(value):
            raise InputError(f"hold: {name} must be finite, got {value:g}")
        key = key_among(name, count, "hold")
        if key.effect:
            parameter_named(key.name).require(value, f"hold: {name}")
        elif name not in ours:
            raise InputError(f"hold: {name!r} is no parameter ({', '.join(sorted(ours))})")
        out[key] = float(value)
    return out


def freed(names: Iterable[str], tests: Sequence[BulgeTest]) -> list[Key]:
    """Keys of the effects that are freed, in their most flexible form.

    Raises
    ------
    InputError
        An effect is unknown, cannot be fitted, or needs what a test has not.
    """
    found: dict[Key, None] = {}
    count = len(tests)
    for name in names:
        if "." in name:
            parameter_named(name)
            wanted: tuple[str, ...] = (name,)
        else:
            wanted = effect_named(name).groups()[-1]
        effect = effect_named(name.partition(".")[0])
        if not effect.parameters:
            raise InputError(
                f"{effect.id} cannot be fitted: it has a value at every point, which a diagnosis "
                "looks for"
            )
        for test in tests:
            require_needs(effect, test)
        if effect.never_separable:
            raise InputError(
                f"{effect.id} cannot be fitted: {effect.never_separable}; hold it at a value"
            )
        for one in wanted:
            for i in range(count):
                found[Key.of(one, None if effect.shared or count == 1 else i)] = None
    return list(found)


def bounded(key: Key, bounds: Mapping[Key, tuple[float, float]]) -> Parameter:
    """An effect's parameter under its key's name, within given bounds or its plausible range.

    Raises
    ------
    InputError
        The bounds are none.
    """
    parameter = parameter_named(key.name)
    of_all = bounds.get(key._replace(specimen=None), (parameter.lower, parameter.upper))
    low, high = bounds.get(key, of_all)
    if parameter.period is not None and (low, high) == (parameter.lower, parameter.upper):
        # a descent goes on past where values begin anew
        low, high = low - 0.5 * parameter.period, high + 0.5 * parameter.period
    if not (np.isfinite(low) and np.isfinite(high)) or low >= high:
        raise InputError(
            f"bounds of {key} must be finite and ascend, got {low:g}:{high:g}; an effect is held "
            "by --hold"
        )
    parameter.require(low, f"bounds of {key}")
    return replace(parameter, name=str(key), lower=low, upper=high)


def key_among(name: str, count: int, where: str) -> Key:
    """The key of a name that may say of which test among several it is.

    Raises
    ------
    InputError
        There is no such test.
    """
    key = Key.read(name)
    if key.specimen is not None and count == 1:
        raise InputError(f"{where}: {name} is of one among several tests; write {key.name}")
    if key.specimen is not None and key.specimen >= count:
        raise InputError(f"{where}: {name}: there are {count} tests, @0 to @{count - 1}")
    return key


def stated_ratio(tests: Sequence[BulgeTest]) -> float:
    """Poisson's ratio that the tests state.

    Raises
    ------
    InputError
        They state different ones.
    """
    ratios = sorted({test.poisson_ratio for test in tests})
    if len(ratios) > 1:
        raise InputError(
            f"the tests state different Poisson ratios ({', '.join(f'{r:g}' for r in ratios)}); "
            "say which one holds for all (--nu12, or --nu of an isotropic material)"
        )
    return float(ratios[0])


def at_end(parameter: Parameter, value: float) -> bool:
    """Whether a value sits at a bound, which is no result.

    Where the range begins at the null, that end is no bound: the effect is absent there.
    """
    low, high, at = (parameter.to_coordinate(v) for v in (parameter.lower, parameter.upper, value))
    near = AT_BOUND * (high - low)
    return bool(high - at <= near or (at - low <= near and not parameter.begins_at_null))


def turns(parameter: Parameter) -> bool:
    """Whether a parameter may take all values of its period."""
    return parameter.period is not None and parameter.upper - parameter.lower > parameter.period


def within(parameter: Parameter, value: float) -> float:
    """A value, as that of its period that is nearest to none."""
    if not turns(parameter):
        return value
    assert parameter.period is not None
    return math.remainder(value, parameter.period)
