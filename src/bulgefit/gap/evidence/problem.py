"""What is weighed: groups of coordinates under Gaussian priors, and the misfit near a point."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, betaln

from bulgefit.effects.parameter import Owned

__all__ = ["Columns", "Group", "Layout", "Linearised", "Model", "Problem", "freeze"]

Floats = NDArray[np.float64]
Columns = NDArray[np.intp]

#: Groups that are free, each in one of its forms: pairs of id and form.
Model = frozenset[tuple[Owned, int]]


def freeze(forms: Mapping[Owned, int]) -> Model:
    """A model from each group's form."""
    return frozenset(forms.items())


@dataclass(frozen=True, eq=False)
class Group:
    """Coordinates that are freed together: an effect's or a field's.

    Attributes
    ----------
    id : Owned
        Whose: an effect, and of which specimen.
    place : str
        Of the five places; "" for what every model has.
    null : (k,) array
        Where the group is absent: the mean of its Gaussian prior.
    width : (k,) array
        The prior's standard deviation.
    lower : (k,) array
        Below it a coordinate has no meaning (a slip, a squared window); -inf where it has.
    forms : tuple of tuple of int
        Coordinates of each form that the group may take; the last contains all others. Default: all
        coordinates.
    always : bool
        In every model, as the moduli are.
    governor : tuple of int
        Of each coordinate the one of the group at whose null it means nothing, itself where there
        is none. Default: none has any.
    period : tuple of float
        What values of a coordinate may differ by and be the same; infinite where each is another.
        Default: of all. Before any data each value within a period is as likely: the prior has its
        middle where the coordinate stands, and its width makes it as dense there.
    hidden_by : tuple of Owned
        Groups that do what this one does but for its second order: beside them it takes nothing off
        the misfit at its null.
    """

    id: Owned
    place: str
    null: Floats
    width: Floats
    lower: Floats
    forms: tuple[tuple[int, ...], ...] = ()
    always: bool = False
    governor: tuple[int, ...] = ()
    period: tuple[float, ...] = ()
    hidden_by: tuple[Owned, ...] = ()

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """The forms, also where none were named."""
        return self.forms or (tuple(range(len(self.null))),)

    def scaled(self, factor: float) -> Group:
        """The same with another prior width."""
        return replace(self, width=factor * self.width) if factor != 1.0 else self

    def below(self, form: int) -> list[int]:
        """The largest forms that a form contains: those that no other one stands between."""
        parts = [set(shape) for shape in self.shapes]
        inside = [k for k, part in enumerate(parts) if part < parts[form]]
        return [k for k in inside if not any(parts[k] < parts[other] for other in inside)]

    def above(self, form: int | None) -> list[int]:
        """Every form that contains one; all of them where there is none."""
        parts = [set(shape) for shape in self.shapes]
        own = set() if form is None else parts[form]
        return [k for k, part in enumerate(parts) if part > own]

    def common(self, one: int, other: int) -> int | None:
        """The largest form that two contain; None where no form is that small."""
        both = set(self.shapes[one]) & set(self.shapes[other])
        inside = [k for k, shape in enumerate(self.shapes) if both.issuperset(shape)]
        return max(inside, key=lambda k: len(self.shapes[k]), default=None)


@dataclass(frozen=True, eq=False)
class Linearised:
    """The misfit near a point: |r - J (y - x)|² for y near x, which is -2 ln of the likelihood.

    Attributes
    ----------
    x : (n,) array
        The point, by all coordinates.
    columns : (p,) int array
        Coordinates with derivatives; the others are as in `x`.
    square : float
        rᵀr, r measured minus modelled.
    gradient : (p,) array
        Jᵀr.
    hessian : (p, p) array
        JᵀJ.
    near : object
        What a neighbouring point is sooner found from; the problem's own.
    rows : object
        The derivatives and residuals themselves, for the same elsewhere (`Problem.again`); the
        problem's own. None where they were let go.
    """

    x: Floats
    columns: Columns
    square: float
    gradient: Floats
    hessian: Floats
    near: Any = None
    rows: Any = None

    def light(self) -> Linearised:
        """Without the derivatives themselves, to be kept."""
        return replace(self, rows=None)

    def of(self, columns: Columns) -> Linearised:
        """By some of the coordinates alone."""
        index = np.searchsorted(self.columns, columns)
        return Linearised(
            self.x,
            columns,
            self.square,
            self.gradient[index],
            self.hessian[np.ix_(index, index)],
            self.near,
        )


class Problem(Protocol):
    """Something whose effects are to be weighed.

    Attributes
    ----------
    groups : sequence of Group
    noise : float
        What noise alone leaves of the misfit: as many as there are values, where it is independent.
    tempered : float
        By which the noise's variance was raised beyond what it is.
    """

    @property
    def groups(self) -> Sequence[Group]: ...

    @property
    def noise(self) -> float: ...

    @property
    def tempered(self) -> float: ...

    def linearise(self, x: Floats, columns: Columns, near: Any = None) -> Linearised:
        """The misfit near x by some coordinates, in ascending order.

        Raises
        ------
        SolveError
            Nothing balances there.
        """
        ...

    def along(self, x: Floats, column: int, near: Any = None) -> tuple[float, float]:
        """Jᵀr and JᵀJ near x by one coordinate.

        Raises
        ------
        SolveError
            Nothing balances there.
        """
        ...

    def afresh(self) -> Self:
        """The same, remembering nothing of earlier solves: to the same bits in any process."""
        ...

    def remembering(self) -> AbstractContextManager[None]:
        """A block in which points that differ in what means nothing there cost one solve."""
        ...

    def lighter(self, near: Any) -> Any:
        """`near` without what only makes a neighbour's solve sooner, where many are kept."""
        ...

    def rounded(self, near: Any) -> Any:
        """`near` to the digits that a neighbour's solve begins from, where much is kept."""
        ...

    def again(self, here: Linearised, x: Floats) -> Linearised:
        """The misfit at x by the derivatives `here`, which cost much more than the misfit.

        Raises
        ------
        SolveError
            Nothing balances there, or not near `here`.
        """
        ...

    def kept_from(self, brink: Any, here: Linearised) -> Floats | None:
        """∂ ln(what keeps a shape from the mode in which a step lost it)/∂(coordinate), (p,).

        None where the shape `here` has lost it as well. Brinks are the problem's own, as its errors
        tell them.
        """
        ...


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each group's coordinates stand among all of them.

    Attributes
    ----------
    groups : dict of id to Group
    null, width, lower : (n,) array
    governor : (n,) int array
        As a group's, among all coordinates.
    period : (n,) array
    """

    groups: dict[Owned, Group]
    null: Floats = field(init=False)
    width: Floats = field(init=False)
    lower: Floats = field(init=False)
    governor: Columns = field(init=False)
    period: Floats = field(init=False)
    _first: dict[Owned, int] = field(init=False)
    _of_count: Floats = field(init=False)

    def __post_init__(self) -> None:
        count, first, governors = 0, {}, list[Columns]()
        for name, group in self.groups.items():
            first[name] = count
            governors.append(count + np.array(group.governor or range(len(group.null)), np.intp))
            count += len(group.null)
        object.__setattr__(self, "_first", first)
        for of in ("null", "width", "lower"):
            parts = [getattr(group, of) for group in self.groups.values()]
            object.__setattr__(self, of, np.concatenate(parts).astype(np.float64))
        object.__setattr__(self, "governor", np.concatenate(governors))
        periods = [g.period or np.full(len(g.null), np.inf) for g in self.groups.values()]
        object.__setattr__(self, "period", np.concatenate(periods).astype(np.float64))
        free = sum(not g.always for g in self.groups.values())
        object.__setattr__(self, "_of_count", _of_count(free))

    @classmethod
    def of(cls, groups: Iterable[Group]) -> Layout:
        """Of groups in their order."""
        return cls({group.id: group for group in groups})

    def scaled(self, factors: Mapping[Owned, float]) -> Layout:
        """The same with the prior widths of some groups times a factor."""
        groups = (g.scaled(factors.get(name, 1.0)) for name, g in self.groups.items())
        return Layout.of(groups)

    def columns(self, model: Model) -> Columns:
        """Coordinates of a model, ascending; those of every model among them."""
        forms = {
            **{g.id: len(g.shapes) - 1 for g in self.groups.values() if g.always},
            **dict(model),
        }
        parts = [self.own(name, form) for name, form in forms.items()]
        return np.sort(np.concatenate([np.empty(0, np.intp), *parts]))

    def own(self, name: Owned, form: int) -> Columns:
        """Coordinates of one group in a form, ascending."""
        return self._first[name] + np.array(sorted(self.groups[name].shapes[form]), dtype=np.intp)

    def away(self, columns: Columns, at: Floats) -> Floats:
        """Distances (k,), in widths, of coordinates at `at` (k,) from the middle of their prior."""
        away = (at - self.null[columns]) / self.width[columns]
        return np.where(np.isfinite(self.period[columns]), 0.0, away)

    def believed(self, model: Model) -> float:
        """-2 ln of a model's probability before any data (`_of_count`).

        Forms of a group share the group's.
        """
        forms = sum(np.log(len(self.groups[name].shapes)) for name, _ in sorted(model))
        return float(self._of_count[len(model)] + 2.0 * forms)

    def without(self, gone: Columns, kept: Columns, x: Floats) -> Floats:
        """Where coordinates are that a model lacks: at their null, or where they mean nothing.

        What is governed by one that is gone is of no effect there, but its derivative at x is not.

        Parameters
        ----------
        gone, kept : int array
        x : (n,) array
        """
        idle = ~np.isin(self.governor[gone], kept) & (self.governor[gone] != gone)
        return np.where(idle, x[gone], self.null[gone])

    def turning(self, names: Iterable[tuple[Owned, int]]) -> Iterator[tuple[Owned, int]]:
        """Periodic coordinates of groups in some forms, each with the group that has it."""
        for name, form in sorted(names):
            for index in self.groups[name].shapes[form]:
                if np.isfinite(self.period[self._first[name] + index]):
                    yield name, self._first[name] + index

    def sides(self, x: Floats, at: int, eighths: Iterable[int]) -> Iterator[Floats]:
        """Points (n,): x where a coordinate is so many eighths of its period away."""
        for turn in eighths:
            other, turned = np.array(x), x[at] + 0.125 * turn * self.period[at]
            other[at] = turned - self.period[at] * np.round(turned / self.period[at])
            yield other

    @property
    def free(self) -> tuple[Owned, ...]:
        """Groups that are not in every model."""
        return tuple(g.id for g in self.groups.values() if not g.always)

    def whole(self, names: Iterable[Owned] | None = None) -> Model:
        """Groups in their largest form; all that are not in every model, unless named."""
        chosen = self.free if names is None else set(names).intersection(self.free)
        return freeze({name: len(self.groups[name].shapes) - 1 for name in chosen})

    def common(self, one: Model, other: Model) -> Model:
        """What two models both contain."""
        forms = dict(other)
        shared = {n: self.groups[n].common(f, forms[n]) for n, f in one if n in forms}
        return freeze({name: form for name, form in shared.items() if form is not None})

    def hidden(self, model: Model) -> Iterator[tuple[Owned, Owned]]:
        """Groups that a model lacks and one of its own hides, each with that one."""
        forms = dict(sorted(model))
        for name, group in self.groups.items():
            if name not in forms:
                yield from ((name, other) for other in group.hidden_by if other in forms)

    def part(self, name: Owned) -> slice:
        """Where a group's coordinates stand."""
        return slice(self._first[name], self._first[name] + len(self.groups[name].null))


def _of_count(free: int) -> Floats:
    """-2 ln of the probability of one model of 0, 1, ..., `free` groups, before any data.

    Each group is there with the same probability w, and nothing is known of w but that no group is
    likelier there than not: the integral of 2 w^k (1 - w)^(m - k) over 0 < w < 1/2. With models
    alike probable w would be 1/2, half of all groups expected, and of forty that are not there a
    few would look likely by chance (Scott and Berger, 2010, "Bayes and empirical-Bayes multiplicity
    adjustment in the variable-selection problem").
    """
    k = np.arange(free + 1.0)
    whole = betaln(k + 1.0, free - k + 1.0) + np.log(betainc(k + 1.0, free - k + 1.0, 0.5))
    return np.asarray(-2.0 * (np.log(2.0) + whole), dtype=np.float64)
