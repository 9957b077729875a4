"""Which coordinates does a diagnosis step in: of which parameter, from what null, how wide?

Groups of several specimens are each specimen's own, but for what belongs to the cloth, and on one
rig to that. What specimens scatter by is one group of all of them, in every model. What is known
already is not stepped in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.effects.base import Effect
from bulgefit.effects.parameter import Key, Owned, Parameter
from bulgefit.effects.registry import fields, scatter
from bulgefit.gap.evidence.problem import Group

__all__ = ["MATERIAL", "Coordinate", "Coordinates", "is_field", "with_fields"]

Floats = NDArray[np.float64]

#: Group of the moduli, which every model has.
MATERIAL = Owned("moduli")
#: Centres (MPa) of the moduli's priors, coated fabrics', each a decade wide: they hold for what is
#: woven, and say next to nothing beside data.
_MODULI = {"E1": 300.0, "E2": 300.0, "G12": 20.0}
_DECADE = math.log(10.0)


@dataclass(frozen=True)
class Coordinate:
    """One coordinate.

    Attributes
    ----------
    key : Key
    parameter : Parameter
    null, width, lower : float
        Of the coordinate, not of the value.
    """

    key: Key
    parameter: Parameter
    null: float
    width: float
    lower: float

    def value(self, x: float) -> float:
        """The parameter's value at a coordinate."""
        return self.parameter.from_coordinate(x)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """All coordinates of a diagnosis, group by group.

    Attributes
    ----------
    groups : tuple of Group
    every : tuple of Coordinate
        In the groups' order.
    known : mapping of name to float
        Parameters that are no coordinates, and not at their null.
    """

    groups: tuple[Group, ...]
    every: tuple[Coordinate, ...]
    known: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        effects: Iterable[Effect],
        nulls: Sequence[Mapping[str, float]],
        priors: Mapping[str, tuple[float, float]] | None = None,
        *,
        same_rig: bool = False,
        known: Mapping[str, float] | None = None,
    ) -> Coordinates:
        """Of moduli, effects and fields over as many specimens as there are `nulls`.

        Parameters
        ----------
        effects : iterable of Effect
        nulls : sequence of mapping
            By specimen: of parameters whose null is the test's own.
        priors : mapping of modulus to (MPa, MPa), optional
            Centre and standard deviation that are better known.
        same_rig : bool
            Whether clamp and cameras are the same for all specimens.
        known : mapping of name to float, optional
            The moduli (MPa), and other parameters that are known as well.
        """
        effects, groups, every = list(effects), [], list[Coordinate]()

        def add(name: Owned, place: str, own: list[Coordinate], **more: object) -> None:
            null, width, lower = np.array([[c.null, c.width, c.lower] for c in own]).T
            keys = [c.key for c in own]
            governor = tuple(
                keys.index(c.key._replace(parameter=c.parameter.governor or c.key.parameter))
                for c in own
            )
            period = tuple(c.parameter.period or math.inf for c in own)
            groups.append(
                Group(name, place, null, width, lower, governor=governor, period=period, **more)  # type: ignore[arg-type]
            )
            every.extend(own)

        if known is None:
            add(MATERIAL, "", _moduli(priors or {}), always=True)
        several = len(nulls) > 1
        for effect in effects:
            if effect.scatters:
                every_one = [
                    _coordinate(effect, p, index, null)
                    for index, null in enumerate(nulls)
                    for p in effect.parameters
                ]
                add(Owned(effect.id), effect.place, every_one, always=True)
                continue
            # a field is called in where something is left, which what it is hidden by leaves not
            hiding = [other for other in effects if effect.is_hidden_by(other)]
            hiding = [] if effect.id in fields() else hiding
            common = effect.shared or not several or (same_rig and effect.of_rig)
            for index in [None] if common else range(len(nulls)):
                own = [_coordinate(effect, p, index, nulls[index or 0]) for p in _stepped(effect)]
                add(
                    Owned(effect.id, index),
                    effect.place,
                    own,
                    forms=_forms(effect),
                    hidden_by=tuple(Owned(other.id, index) for other in hiding),
                )
        return cls(tuple(groups), tuple(every), dict(known or {}))

    def scaled(self, factors: Mapping[Owned, float]) -> Coordinates:
        """The same with the prior widths of some groups times a factor."""
        groups = tuple(g.scaled(factors.get(g.id, 1.0)) for g in self.groups)
        widths = np.concatenate([g.width for g in groups])
        every = (replace(c, width=float(w)) for c, w in zip(self.every, widths, strict=True))
        return replace(self, groups=groups, every=tuple(every))

    def values(self, x: Floats, index: int) -> dict[str, float]:
        """Parameters of one specimen by their names; those at their null are left out."""
        own = {
            c.key.name: c.value(at)
            for c, at in zip(self.every, x, strict=True)
            if c.key.specimen in (None, index) and (at != c.null or not c.key.effect)
        }
        return {**self.known, **own}

    def of_specimen(self, columns: Iterable[int], index: int) -> list[int]:
        """Those of the columns that a specimen has."""
        return [c for c in columns if self.every[c].key.specimen in (None, index)]


def is_field(group: Owned) -> bool:
    """Whether a group is a field, not an effect with a name."""
    return group.effect in fields()


def with_fields(
    effects: Iterable[Effect], tests: Sequence[BulgeTest], *, several: bool
) -> list[Effect]:
    """Effects that data may tell from others, and the fields that the tests have what they need of.

    Beside several specimens of a cloth also what these scatter by.
    """
    usable = [e for e in effects if not e.never_separable]
    usable += [
        f
        for f in fields().values()
        if f.parameters
        and (several or not f.of_several)
        and all(getattr(t, need) is not None for t in tests for need in f.needs)
    ]
    return [*usable, *scatter().values()] if several else usable


def _moduli(priors: Mapping[str, tuple[float, float]]) -> list[Coordinate]:
    own = []
    for name, centre in _MODULI.items():
        parameter = Parameter(name, "MPa", 0.0, math.inf, null=None, coordinate="log")
        middle, spread = priors.get(name, (centre, centre * _DECADE))
        own.append(
            Coordinate(Key.of(name), parameter, math.log(middle), spread / middle, -math.inf)
        )
    return own


def _stepped(effect: Effect) -> list[Parameter]:
    """Parameters of the largest form."""
    names = {Key.of(name).parameter for name in effect.groups()[-1]}
    return [p for p in effect.parameters if p.name in names]


def _forms(effect: Effect) -> tuple[tuple[int, ...], ...]:
    order = [f"{effect.id}.{p.name}" for p in _stepped(effect)]
    return tuple(tuple(sorted(order.index(n) for n in form)) for form in effect.groups())


def _coordinate(
    effect: Effect, p: Parameter, index: int | None, nulls: Mapping[str, float]
) -> Coordinate:
    key = Key(effect.id, p.name, index)
    value = nulls[key.name] if p.null is None else p.null
    null = p.to_coordinate(value)
    width = {
        "linear": p.prior,
        "log": p.prior / (p.from_origin(value) or 1.0),
        "square": p.prior**2,
    }[p.coordinate]
    lower = null if p.begins_at_null else -math.inf
    return Coordinate(key, p, null, width, lower)
