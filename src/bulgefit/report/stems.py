"""What are the files of each test called? Distinct, short names that stay in their folder."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain, count

__all__ = ["file_stems"]

#: Bytes: with what is put before and after it, a name stays below the 255 that most systems take.
LONGEST = 150


def file_stems(names: Sequence[str]) -> list[str]:
    """What the files of each test begin with.

    Its name without what a path cannot hold, cut where it is long; tests of one name are numbered
    by their place among all.

    Parameters
    ----------
    names : sequence of str
        Of the tests.
    """
    clean = [_clean(name) for name in names]
    # upper and lower case are one on some systems
    keys = [stem.casefold() for stem in clean]
    alone = {key for key in keys if keys.count(key) == 1}
    taken, stems = set(alone), []
    for place, (stem, key) in enumerate(zip(clean, keys, strict=True), 1):
        if key not in alone:
            numbered = (f"{stem}_{n}" for n in chain([place], count(1)))
            stem = next(name for name in numbered if name.casefold() not in taken)
            taken.add(stem.casefold())
        stems.append(stem)
    return stems


def _clean(name: str) -> str:
    plain = re.sub(r"[^\w.+-]+", "_", name).strip(".")
    return plain.encode()[:LONGEST].decode(errors="ignore") or "test"
