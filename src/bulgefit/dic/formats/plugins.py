"""Which readers do other packages bring? Those under the entry points `bulgefit.readers`."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points

__all__ = ["GROUP", "load_plugins"]

#: The group of entry points, each a module or function that registers readers when it is loaded.
GROUP = "bulgefit.readers"


@cache
def load_plugins() -> tuple[str, ...]:
    """Load the readers of installed packages, once.

    Returns
    -------
    tuple of str
        A line for each that could not be loaded; the others are there all the same.
    """
    found = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return tuple(line for line in map(_load, found) if line)


def _load(entry: EntryPoint) -> str:
    try:
        entry.load()
    except Exception as error:  # whatever is wrong with it, the other formats are read
        reason = " ".join(str(error).split()) or type(error).__name__
        package = f" of {entry.dist.name}" if entry.dist else ""
        return f"reader {entry.name}{package} is left out: {reason} ({entry.value})"
    return ""
