"""How does a page look as Markdown? Its words and tables, and pictures that stand beside it."""

from __future__ import annotations

from collections.abc import Sequence

from bulgefit.report.page.blocks import Block, Page, unfolded

__all__ = ["as_markdown"]


def as_markdown(page: Page, pictures: Sequence[tuple[str, str]]) -> str:
    """The page as Markdown.

    Parameters
    ----------
    page : Page
        Of which the pictures are left out that only the HTML draws.
    pictures : sequence of (file name, caption)
    """
    answer = page.answer
    parts = [f"# {page.title}", f"**{answer.headline}**"]
    if answer.notes:
        parts.append("\n".join(f"- {note}" for note in answer.notes))
    parts += filter(None, map(_text, _with_words(page.blocks)))
    parts.append("## Pictures")
    parts += [f"{caption}\n\n![{caption}]({name})" for name, caption in pictures]
    return "\n\n".join(parts) + "\n"


def _with_words(blocks: Sequence[Block]) -> list[Block]:
    """Blocks without pictures, and without headings that only pictures follow."""
    kept = [b for b in unfolded(blocks) if b.kind in ("heading", "text", "list", "table", "fold")]
    after = [*kept[1:], Block("heading")]
    return [b for b, n in zip(kept, after, strict=True) if (b.kind, n.kind) != ("heading",) * 2]


def _text(block: Block) -> str:
    if block.kind == "heading":
        return f"## {block.lines[0]}"
    if block.kind == "text":
        return block.lines[0]
    if block.kind == "fold":
        return f"**{block.lines[0]}**: {block.lines[1]}."
    if block.kind == "list":
        return "\n".join(f"- {line}" for line in block.lines)
    head, *rows = block.rows
    lines = [head, tuple("---" for _ in head), *rows]
    cells = [[c.replace("|", "\\|") for c in line] for line in lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)
