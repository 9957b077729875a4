"""How is the JSON of another run read?"""

from __future__ import annotations

import json
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any

from bulgefit.errors import InputError

__all__ = ["NEWEST", "json_of", "value_of"]

#: The last layout of results that is known (docs/json.md).
NEWEST = 2


def json_of(path: str | Path, *, option: str = "", of: str = "bulgefit") -> dict[str, Any]:
    """The object that a file of JSON holds.

    Parameters
    ----------
    path : path
    option, of : str
        What names the file, and what has written it, for messages.

    Raises
    ------
    InputError
        It cannot be read, is no JSON of bulgefit, or of a later layout than is known.
    """
    where = f"{option} {path}".strip()
    try:
        # an editor may have put a byte order mark before it
        content = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{where}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:
        told = f" ({error})" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{where}: no JSON of {of}{told}") from error
    if not isinstance(content, dict):
        raise InputError(f"{where}: no JSON of {of} (it holds no object)")
    layout = content.get("format", NEWEST)
    if not isinstance(layout, int) or layout > NEWEST:
        raise InputError(
            f"{where}: its layout (format) is {layout!r}, and this bulgefit knows those up to "
            f"{NEWEST}; read it with the one that wrote it (run.versions.bulgefit)"
        )
    return content


def value_of(found: Any, key: str, unit: str, where: str) -> float:
    """The number of {"value": number, "unit": unit}.

    Parameters
    ----------
    found : object
        What stands there.
    key, where : str
        Where it stands, and the file, for messages.
    unit : str
        In which it is needed; what states none is taken to be in it.

    Raises
    ------
    InputError
        There is no number, or it is in another unit.
    """
    value = found.get("value") if isinstance(found, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, Real):
        shown = f"{key}.value is {value!r}" if isinstance(found, Mapping) else f"{key} is {found!r}"
        raise InputError(f"{where}: {shown}; a number is needed" + (f", {unit}" * (unit != "1")))
    stated = found.get("unit", unit)
    if stated != unit:
        raise InputError(f"{where}: {key} is in {stated!r}; give it in {unit!r}")
    return float(value)
