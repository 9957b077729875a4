"""What is a page made of? An answer, and blocks below it; how they look is the templates' part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Answer", "Block", "Page", "Value", "unfolded"]


@dataclass(frozen=True)
class Block:
    """A piece of a page.

    Attributes
    ----------
    kind : {"heading", "text", "list", "table", "fold", "fields", or a picture's}
        Pictures are "bars", "spans", "discs", "curves", "unnamed" and "law".
    lines : tuple of str
        The text with **bold** parts, the items, the caption of a picture, or of a fold its name
        and what it holds in a few words; "fields" is where the maps stand.
    rows : tuple of tuples of str
        Of a table, its header first.
    picture : mapping
        Of a picture, what its template draws.
    inside : tuple of Block
        Of a fold, which its reader opens; paper has all of it.
    """

    kind: str
    lines: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    picture: Mapping[str, Any] = field(default_factory=dict)
    inside: tuple[Block, ...] = ()


def unfolded(blocks: Iterable[Block]) -> Iterator[Block]:
    """Blocks in their order, each fold before what is inside it."""
    for block in blocks:
        yield block
        yield from unfolded(block.inside)


@dataclass(frozen=True)
class Value:
    """A parameter to be used, or not.

    Attributes
    ----------
    name, text : str
        The text holds value, error and unit.
    use : {"use", "care", "no"}
    why : str
        In a few words.
    """

    name: str
    text: str
    use: str
    why: str = ""


@dataclass(frozen=True)
class Answer:
    """What stands first.

    Attributes
    ----------
    headline : str
    tone : {"good", "care", "bad"}
    values : tuple of Value
    notes : tuple of str
        What must be known before the headline is used.
    """

    headline: str
    tone: str
    values: tuple[Value, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Page:
    """A page whose maps are added where the measured fields are at hand.

    Attributes
    ----------
    title, verb : str
    answer : Answer
    blocks : tuple of Block
    """

    title: str
    verb: str
    answer: Answer
    blocks: tuple[Block, ...]
