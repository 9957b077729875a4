"""bulgefit formats: which files are read, and what does one look like?"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from bulgefit.cli import _common

if TYPE_CHECKING:
    from bulgefit.dic.registry import Reader

__all__ = ["HELP", "add_arguments", "run"]

HELP = "list the files that are read as bulge tests, with an example line of each"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "List the formats of bulge tests: what writes them, an example line, how a lost point is\n"
        "marked, and whether positions are those before inflation (reference) or at the frame\n"
        "(current). A format is seen from the files; --format of the other verbs names it."
    )
    parser.epilog = "examples:\n  bulgefit formats\n  bulgefit formats --json -"
    _common.add_json_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """List the readers, those of other packages too."""
    from bulgefit.dic.readers import READERS, load_plugins

    _common.check_outputs(args, [])
    for line in load_plugins():
        _common.progress(args, line)
    readers = [READERS[name] for name in sorted(READERS)]
    payload = {"formats": [_plain(reader) for reader in readers]}
    _common.deliver(args, payload, "\n".join(_shown(reader) for reader in readers))
    return 0


def _plain(reader: Reader) -> dict[str, object]:
    return {
        "name": reader.name,
        "written_by": reader.looks_like,
        "example": reader.example,
        "lost": reader.lost,
        "positions": reader.positions,
        "options": list(reader.options),
    }


def _shown(reader: Reader) -> str:
    lines = [f"{reader.name:<14} {reader.looks_like}"]
    if reader.example:
        lines.append(f"{'':<14} {reader.example}")
    lines.append(f"{'':<14} lost: {reader.lost}; positions: {reader.positions}")
    return "\n".join(lines)
