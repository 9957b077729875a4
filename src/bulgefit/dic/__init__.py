"""What was measured, and how well? Its names are loaded when they are first used."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bulgefit.dic.bulge_test import Block, BulgeTest
    from bulgefit.dic.inspect import TestInfo, describe
    from bulgefit.dic.readers import READERS, Recording, read_test, reader
    from bulgefit.dic.writers import write_test

__all__ = [
    "READERS",
    "Block",
    "BulgeTest",
    "Recording",
    "TestInfo",
    "describe",
    "read_test",
    "reader",
    "write_test",
]

#: Where each name lives.
_HOMES = {
    "READERS": "readers",
    "Block": "bulge_test",
    "BulgeTest": "bulge_test",
    "Recording": "readers",
    "TestInfo": "inspect",
    "describe": "inspect",
    "read_test": "readers",
    "reader": "readers",
    "write_test": "writers",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = found
    return found
