"""In which encoding is a text file? Its bytes tell; DIC systems use at least five."""

from __future__ import annotations

import codecs
from pathlib import Path

from bulgefit.errors import InputError

__all__ = ["decode", "text_of"]

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def decode(data: bytes, *, cut: bool = False) -> str:
    """Text of bytes in UTF-8, UTF-16, cp1252 or latin-1, with or without a mark of order.

    Parameters
    ----------
    data : bytes
    cut : bool
        Whether these are the first bytes of a longer file, which may end within a letter.
    """
    for mark, name in _MARKS:
        if data.startswith(mark):
            return data[len(mark) :].decode(name, errors="replace")
    if order := _utf16_without_mark(data):
        return data.decode(order, errors="replace")
    try:
        decoder = codecs.getincrementaldecoder("utf-8")()
        return decoder.decode(data, final=not cut)
    except UnicodeDecodeError:
        pass
    try:
        return data.decode("cp1252")
    except UnicodeDecodeError:  # five bytes mean nothing there; latin-1 knows all 256
        return data.decode("latin-1")


def text_of(path: Path) -> str:
    """The text of one file, whatever its encoding, with line ends of one kind.

    Raises
    ------
    InputError
        The system does not let it be read; the message names this file, which may be one of many.
    """
    try:
        text = decode(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _utf16_without_mark(data: bytes) -> str | None:
    """The byte order of text whose letters are all ASCII in two bytes, of which one is zero."""
    start = data[:512]
    start = start[: len(start) // 2 * 2]
    if not start:
        return None
    first, second = start[::2], start[1::2]
    if 0 not in first and second.count(0) == len(second):
        return "utf-16-le"
    if 0 not in second and first.count(0) == len(first):
        return "utf-16-be"
    return None
