"""How the kernels are compiled: at their first call, once per machine.

numba keeps what it has compiled in `__pycache__` beside the source, or in the user's cache folder
where that cannot be written. It drops a compiled function when the function's own file changes,
but not when a file changes whose functions or constants went into it; here both are watched. That
touches private parts of numba's cache, for which pyproject.toml bounds its version.
"""

from __future__ import annotations

import gc
import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import event
from numba.core.runtime import rtsys

__all__ = ["compiled", "inlined", "merged"]

#: What goes into compiled functions of other files.
_SHARED = (
    "jit.py",
    "geometry.py",
    "laws/*.py",
    "relaxation.py",
    "lanes.py",
    "cells.py",
    "kernels.py",
)

_SOURCES = hashlib.sha256(
    b"".join(
        path.read_bytes()
        for pattern in _SHARED
        for path in sorted(Path(__file__).parent.glob(pattern))
    )
).hexdigest()

#: Division by zero gives an infinity, as in numpy. Sums may be reordered and fused for speed;
#: NaN and infinity keep their meaning, since collapsed cells are told by them. The interpreter is
#: released, so that several searches run in threads of one process. Nothing calls a kernel from C.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "no_cfunc_wrapper": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
}


def compiled(function: Callable[..., Any]) -> Any:
    """Compile `function` when it is first called; cached where a folder can be written."""
    try:
        dispatcher = njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # numba's word for no folder to cache in
        dispatcher = njit(**_OPTIONS)(function)
    kept = getattr(dispatcher, "_cache", None)
    file = getattr(kept, "_cache_file", None)
    if kept is not None:
        load = kept.load_overload
        if file is not None:
            file._source_stamp = (file._source_stamp, _SOURCES)
            load = _as_kept(kept)
        kept.load_overload = _announced(load)
    return dispatcher


def _as_kept(kept: Any) -> Callable[..., Any]:
    """Load what is compiled, which needs the runtime of arrays alone.

    Numba's own look in its cache first learns all that could be compiled: a fifth of a second.
    """

    def load(signature: Any, context: Any) -> Any:
        rtsys.initialize(context)
        with kept._guard_against_spurious_io_errors():
            return kept._load_overload(signature, context)

    return load


def _announced(load: Callable[..., Any]) -> Callable[..., Any]:
    """Say so where numba finds nothing in its cache and goes on to compile."""

    def load_or_announce(*signature: Any) -> Any:
        with _PAUSE:
            found = load(*signature)
        if found is None:
            _announce()
        return found

    return load_or_announce


@cache
def _announce() -> None:
    """Tell the user what takes so long, once."""
    sys.stderr.write("bulgefit: compiling kernels, once per machine (about 15 s)\n")


class _Pause(event.Listener):
    """Collect no garbage while numba compiles, or loads what it compiled.

    It makes millions of objects that stay, and looking through them again and again takes an
    eighth of the time. Compilations nest, and numba's lock lets one thread compile or load at a
    time.
    """

    def __init__(self) -> None:
        self._depth, self._collecting = 0, False

    def __enter__(self) -> None:
        if self._depth == 0:
            self._collecting = gc.isenabled()
            gc.disable()
        self._depth += 1

    def __exit__(self, *_: object) -> None:
        self._depth -= 1
        if self._depth == 0 and self._collecting:
            gc.enable()

    def on_start(self, _: event.Event) -> None:
        self.__enter__()

    def on_end(self, _: event.Event) -> None:
        self.__exit__()


_PAUSE = _Pause()
event.register("numba:compile", _PAUSE)


def inlined(function: Callable[..., Any]) -> Any:
    """Make `function` part of the compiled function that calls it.

    Were it a function of its own, the process that has just compiled it would run it as it was
    compiled alone, and later ones the copy in its caller, which was optimised once more: with sums
    that may be reordered, a first run would differ from later ones in the last bits.
    """
    return njit(inline="always", no_cpython_wrapper=True, **_OPTIONS)(function)


def merged(function: Callable[..., Any]) -> Any:
    """As `inlined`, by LLVM at its first look: for arithmetic of points and lanes, and gathering.

    Types are then inferred once, not in every caller, which takes most of the time to compile.
    A loop that is to run in vectors would be optimised before LLVM knows the caller's arrays, and
    not as well.
    """
    return njit(forceinline=True, no_cpython_wrapper=True, **_OPTIONS)(function)
