"""What commands make of a page: sections between marks. All beside them is written by hand."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["marked", "put"]


def marked(name: str, text: str) -> str:
    """A section between its marks, which no page shows."""
    return f"<!-- {name} -->\n{text.strip()}\n<!-- end of {name} -->\n"


def put(section: str, page: Path) -> None:
    """Write a section that is `marked` in the place of an earlier one, or at the end of a page."""
    first, *_, last = section.splitlines()
    old = re.compile(re.escape(first) + ".*?" + re.escape(last) + "\n", re.DOTALL)
    before = page.read_text(encoding="utf-8") if page.exists() else ""
    text, count = old.subn(lambda _: section, before)
    if not count:
        text = f"{before.rstrip()}\n\n{section}".lstrip()
    page.write_text(text, encoding="utf-8")
