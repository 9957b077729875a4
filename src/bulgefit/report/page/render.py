"""How does a page become one file of HTML? Templates of this room, with all that is shown inside.

Text is escaped by the templates' engine, and the page's own policy forbids its reader any request.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from bulgefit.report.page.blocks import Page, unfolded
from bulgefit.report.page.charts import disc_wedges

__all__ = ["rendered"]


def rendered(page: Page, fields: Mapping[str, Any], origin: Sequence[tuple[str, str]]) -> str:
    """The page as HTML.

    Parameters
    ----------
    page : Page
        Blocks before the block "fields" stand above the maps, others below.
    fields : mapping
        `tests` as `bulgefit.report.page.fields.packed` gives them, `notes`.
    origin : sequence of (str, str)
        How it was made.
    """
    kinds = {block.kind for block in unfolded(page.blocks)}
    at = next(i for i, block in enumerate(page.blocks) if block.kind == "fields")
    return str(
        _template().render(
            page=page,
            before=page.blocks[:at],
            after=page.blocks[at + 1 :],
            fields=fields,
            origin=origin,
            wedges=disc_wedges() if "discs" in kinds else [],
            style=_own("style.css"),
            script=_own("fields.js"),
            folds=_own("folds.js") if "fold" in kinds else "",
        )
    )


@cache
def _own(name: str) -> str:
    """A file of the templates that is put into the page as it is."""
    from markupsafe import Markup

    return Markup(files(__package__).joinpath("templates", name).read_text(encoding="utf-8"))


@cache
def _template() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(__package__, "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("page.html.j2")
