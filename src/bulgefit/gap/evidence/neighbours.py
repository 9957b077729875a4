"""Which models are one change away from one? Drops, growths, additions, swaps, other forms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.problem import Layout, Model, freeze

__all__ = ["larger", "neighbours", "smaller", "swapped"]


def smaller(layout: Layout, model: Model) -> Iterator[Model]:
    """One group less, or one in a next smaller form."""
    forms = dict(sorted(model))  # as in every process, whatever its hashes are
    for name, form in forms.items():
        yield freeze({k: f for k, f in forms.items() if k != name})
        for less in layout.groups[name].below(form):
            yield freeze({**forms, name: less})


def larger(layout: Layout, names: Iterable[Owned], model: Model) -> Iterator[Model]:
    """One group of those named more, in any form, or one in a larger form."""
    forms = dict(model)
    for name in names:
        for form in layout.groups[name].above(forms.get(name)):
            yield freeze({**forms, name: form})


def swapped(layout: Layout, names: tuple[Owned, ...], model: Model) -> Iterator[Model]:
    """One group in the place of another, or one larger with another one smaller."""
    for rest in smaller(layout, model):
        gone = set(dict(model)) - set(dict(rest))
        yield from (m for m in larger(layout, names, rest) if not gone & set(dict(m)))


def _otherwise(layout: Layout, model: Model) -> Iterator[Model]:
    """One group in any other form."""
    forms = dict(sorted(model))
    for name, form in forms.items():
        for other in range(len(layout.groups[name].shapes)):
            if other != form:
                yield freeze({**forms, name: other})


def neighbours(layout: Layout, names: tuple[Owned, ...], model: Model) -> Iterable[Model]:
    """Every model one drop, growth, addition, swap or change of a form away."""
    one = smaller(layout, model), larger(layout, names, model), _otherwise(layout, model)
    found = dict.fromkeys(chain(*one, swapped(layout, names, model)))
    found.pop(model, None)
    return found
