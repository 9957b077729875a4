"""What if stdout or stderr is closed, is full, or does not know a letter?"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TextIO

__all__ = ["drop", "prepare", "say"]


def prepare() -> None:
    """Let no stream fail for a letter that it does not know, nor for having been closed."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever started us
            nowhere = os.open(os.devnull, os.O_WRONLY)
            setattr(sys, name, os.fdopen(nowhere, "w", encoding="utf-8"))
        elif hasattr(stream, "reconfigure"):  # what is no file may have none
            stream.reconfigure(errors="backslashreplace")


def say(text: str) -> None:
    """Write to stderr; where it takes nothing more, what is said is lost, and nothing else."""
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except OSError:
        drop(sys.stderr)


def drop(stream: TextIO) -> None:
    """Throw away what a stream still holds, which cannot be written at exit either."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
