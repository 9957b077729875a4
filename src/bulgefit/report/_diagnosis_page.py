"""How does a page of blocks look as Markdown and as HTML?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bulgefit.report._diagnosis_words import Block

__all__ = ["as_html", "as_markdown"]


def as_markdown(blocks: Sequence[Block], pictures: Sequence[tuple[str, str]]) -> str:
    """The page as Markdown.

    Parameters
    ----------
    blocks : sequence of Block
    pictures : sequence of (file name, caption)
    """
    parts: list[str] = []
    for block in blocks:
        if block.kind == "title":
            parts.append(f"# {block.lines[0]}")
        elif block.kind == "heading":
            parts.append(f"## {block.lines[0]}")
        elif block.kind == "text":
            parts.append(block.lines[0])
        elif block.kind == "list":
            parts.append("\n".join(f"- {line}" for line in block.lines))
        else:
            head, *rows = block.rows
            lines = [head, tuple("---" for _ in head), *rows]
            cells = [[c.replace("|", "\\|") for c in line] for line in lines]
            parts.append("\n".join(f"| {' | '.join(line)} |" for line in cells))
    parts.append("## Pictures")
    parts += [f"{caption}\n\n![{caption}]({name})" for name, caption in pictures]
    return "\n\n".join(parts) + "\n"


_STYLE = """\
body { font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; max-width: 60rem;
  margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 1.6rem; }
table { border-collapse: collapse; margin: 0.6rem 0; }
th, td { text-align: left; padding: 0.2rem 0.9rem 0.2rem 0; border-bottom: 1px solid #ccc;
  font-variant-numeric: tabular-nums; vertical-align: top; }
img { max-width: 100%; border: 1px solid #ddd; }
figure { margin: 1.2rem 0; } figcaption { margin-bottom: 0.3rem; }
"""


def as_html(blocks: Sequence[Block], pictures: Sequence[tuple[str, str, bytes]]) -> str:
    """The page as one HTML file that holds its pictures.

    Parameters
    ----------
    blocks : sequence of Block
    pictures : sequence of (file name, caption, PNG)
    """
    from base64 import b64encode
    from html import escape

    title = escape(blocks[0].lines[0])
    parts = [
        "<!DOCTYPE html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        f"<style>\n{_STYLE}</style></head><body>",
    ]
    tags = {"title": "h1", "heading": "h2", "text": "p"}
    for block in blocks:
        if block.kind in tags:
            tag = tags[block.kind]
            parts.append(f"<{tag}>{_marked(block.lines[0])}</{tag}>")
        elif block.kind == "list":
            items = "\n".join(f"<li>{_marked(line)}</li>" for line in block.lines)
            parts.append(f"<ul>\n{items}\n</ul>")
        else:
            head, *rows = block.rows
            parts.append("<table>" + _row(head, "th"))
            parts += [_row(row, "td") for row in rows]
            parts.append("</table>")
    parts.append("<h2>Pictures</h2>")
    for name, caption, content in pictures:
        source = f"data:image/png;base64,{b64encode(content).decode()}"
        parts.append(
            f"<figure><figcaption>{escape(caption)} ({escape(name)})</figcaption>\n"
            f'<img alt="{escape(caption)}" src="{source}"></figure>'
        )
    return "\n".join([*parts, "</body></html>", ""])


def _row(cells: Sequence[str], tag: str) -> str:
    from html import escape

    return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _marked(text: str) -> str:
    """Escaped text with **bold** as in Markdown."""
    from html import escape

    pieces: list[Any] = escape(text).split("**")
    return "".join(f"<b>{p}</b>" if i % 2 else p for i, p in enumerate(pieces))
