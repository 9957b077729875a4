"""What does a folder's test.json say of the specimen?"""

from __future__ import annotations

import json
import math
import reprlib
from pathlib import Path
from typing import Any

from bulgefit.dic.formats.encoding import text_of
from bulgefit.errors import InputError

__all__ = ["SPECIMEN", "specimen_of"]

#: The file's name.
SPECIMEN = "test.json"
_KEYS = {
    "name": "text on one line",
    "radius": "a number in mm",
    "thickness": "a number in mm",
    "poisson_ratio": "a number",
    "warp_angle": "a number in degrees",
    "at_rest": "a whole number of frames",
    "columns": 'like {"x": "X_mm"}',
}


def specimen_of(path: Path) -> dict[str, Any]:
    """The keys of a `test.json`; none where there is no such file.

    Raises
    ------
    InputError
        It is no JSON object, has an unknown key, or a value that cannot be.
    """
    if not path.is_file():
        return {}
    try:
        content = json.loads(text_of(path), parse_int=float)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: must be a JSON object with {', '.join(_KEYS)}")
    for key, value in content.items():
        if key not in _KEYS:
            raise InputError(
                f"{path}: unknown key {reprlib.repr(key)}; known are {', '.join(_KEYS)}"
            )
        if key == "columns":
            good = isinstance(value, dict) and all(isinstance(v, str) for v in value.values())
        elif key == "at_rest":
            good = isinstance(value, float) and value.is_integer() and value >= 0.0
        elif key == "name":
            # others cannot be printed, or end the line or a file's name
            good = isinstance(value, str) and value.isprintable()
        else:
            good = isinstance(value, float) and math.isfinite(value)
        if not good:
            raise InputError(
                f"{path}: {key} cannot be {reprlib.repr(value)}; it must be {_KEYS[key]}"
            )
    return content
