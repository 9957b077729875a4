"""What is in a MATLAB file up to v7? Numbers, cells and structs; the rest is passed over.

The layout is MathWorks' "MAT-File Format" (level 5). scipy reads it too, but ends the process on
some damaged files.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

__all__ = ["names_of", "values_of"]

_HEADER = 128
_NUMBERS = dict(
    zip(
        (1, 2, 3, 4, 5, 6, 7, 9, 12, 13),
        ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8"),
        strict=True,
    )
)
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _NUMERIC = 1, 2, range(6, 16)
# Bytes from which the name of a variable is seen.
_NAME = 1024
# Cells within cells; results of DIC have two.
_DEEPEST = 16


@dataclass
class _Bytes:
    """The elements of a part of a file, one after the other."""

    data: memoryview
    order: str
    at: int = 0

    def element(self) -> tuple[int, memoryview]:
        """Type and content of the next element.

        Raises
        ------
        ValueError
            There is not as much as it says.
        """
        if self.at + 8 > len(self.data):
            raise ValueError("ends within an element")
        kind, size = struct.unpack_from(f"{self.order}II", self.data, self.at)
        if kind >> 16:  # so small that it stands within the tag
            kind, size, start, self.at = kind & 0xFFFF, kind >> 16, self.at + 4, self.at + 8
        else:
            start = self.at + 8
            self.at = start + size + (-size % 8)
        if start + size > len(self.data):
            raise ValueError("ends within an element")
        return kind, self.data[start : start + size]

    def numbers(self) -> np.ndarray[Any, Any]:
        """The next element, of numbers."""
        kind, content = self.element()
        if kind not in _NUMBERS:
            raise ValueError(f"holds an element of type {kind} where numbers should be")
        return np.frombuffer(content, dtype=np.dtype(f"{self.order}{_NUMBERS[kind]}"))

    def text(self) -> str:
        """The next element, of letters."""
        return bytes(self.element()[1]).decode("latin-1").rstrip("\0")


def names_of(file: IO[bytes]) -> list[str]:
    """Names of the variables.

    Raises
    ------
    ValueError
        The file is damaged.
    """
    found = []
    for kind, size, order in _variables(file):
        data = file.read(min(size, _NAME))
        if kind == _COMPRESSED:
            data = _unpacked(data, _NAME)
        if kind in (_MATRIX, _COMPRESSED):
            inside = _Bytes(memoryview(data), order, 8 if kind == _COMPRESSED else 0)
            inside.element()  # its flags
            inside.element()  # its shape
            found.append(inside.text())
    return found


def values_of(file: IO[bytes], names: list[str], largest: int) -> dict[str, Any]:
    """The named variables: arrays, lists of the elements of cells, dicts of single structs.

    Parameters
    ----------
    file : binary file
    names : list of str
    largest : int
        Bytes that a variable may unpack to.

    Raises
    ------
    ValueError
        The file is damaged, or a variable is larger.
    """
    known = names_of(file)
    values = {}
    for name, (kind, size, order) in zip(known, _variables(file), strict=True):
        if name in names:
            data = file.read(size)
            if kind == _COMPRESSED:
                data = _unpacked(data, largest)
            inside = _Bytes(memoryview(data), order)
            if kind == _COMPRESSED:
                inside = _Bytes(inside.element()[1], order)
            values[name] = _value(inside, 0)
    return values


def _variables(file: IO[bytes]) -> Iterator[tuple[int, int, str]]:
    """Type, size and byte order of each variable, the file standing at its content."""
    file.seek(0)
    head = file.read(_HEADER)
    if len(head) < _HEADER or head[126:128] not in (b"IM", b"MI"):
        raise ValueError("has no header of MATLAB's")
    order = "<" if head[126:128] == b"IM" else ">"
    at = _HEADER
    while len(tag := file.read(8)) == 8:
        kind, size = struct.unpack(f"{order}II", tag)
        if kind not in (_MATRIX, _COMPRESSED):
            raise ValueError(f"holds an element of type {kind} where a variable should be")
        yield kind, size, order
        at += 8 + size
        file.seek(at)
    if tag:
        raise ValueError("ends within an element")


def _unpacked(data: bytes, largest: int) -> bytes:
    try:
        found = zlib.decompressobj().decompress(data, largest + 1)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if len(found) > largest > _NAME:
        raise ValueError("is larger than its file can hold")
    return found


def _value(inside: _Bytes, depth: int) -> Any:
    """The value of a matrix whose content begins here; None for text, sparse and other kinds."""
    if depth > _DEEPEST:
        raise ValueError("holds cells within cells without end")
    if not len(inside.data):  # an empty cell
        return np.empty((0, 0))
    flags, shape = inside.numbers(), tuple(inside.numbers().tolist())
    inside.text()
    kind = int(flags[0]) & 0xFF if len(flags) else 0
    count = math.prod(shape)
    if any(n < 0 for n in shape) or count > len(inside.data):
        raise ValueError("has a shape that its file cannot hold")
    if kind in _NUMERIC:
        array = inside.numbers()
        if len(array) != count:
            raise ValueError("has another number of elements than its shape")
        return array.reshape(shape, order="F")
    if kind == _CELL:
        return [_member(inside, depth) for _ in range(count)]
    if kind == _STRUCT and count == 1:
        width = max(int(inside.numbers()[:1].sum()), 1)
        names = bytes(inside.element()[1])
        keys = [names[i : i + width].split(b"\0")[0] for i in range(0, len(names), width)]
        return {key.decode("latin-1"): _member(inside, depth) for key in keys}
    return None


def _member(inside: _Bytes, depth: int) -> Any:
    kind, content = inside.element()
    if kind != _MATRIX:
        raise ValueError(f"holds an element of type {kind} where a matrix should be")
    return _value(_Bytes(content, inside.order), depth + 1)
