"""How the kernels are compiled: at their first call, once per machine.

numba keeps what it has compiled in `__pycache__` beside the source, or in the user's cache folder
where that cannot be written. It drops a compiled function when the function's own file changes,
but not when a file changes whose functions or constants went into it; here both are watched.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

__all__ = ["compiled"]

#: What goes into compiled functions of other files.
_SHARED = ("jit.py", "geometry.py", "laws.py", "kernels.py")

_SOURCES = hashlib.sha256(
    b"".join((Path(__file__).parent / name).read_bytes() for name in _SHARED)
).hexdigest()

#: Division by zero gives an infinity, as in numpy. Sums may be reordered and fused for speed;
#: NaN and infinity keep their meaning, since collapsed cells are told by them. The interpreter is
#: released, so that several searches run in threads of one process.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
}


def compiled(function: Callable[..., Any]) -> Any:
    """Compile `function` when it is first called; cached where a folder can be written."""
    try:
        dispatcher = njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # numba's word for no folder to cache in
        return njit(**_OPTIONS)(function)
    cache = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    if cache is not None:
        cache._source_stamp = (cache._source_stamp, _SOURCES)
    return dispatcher
