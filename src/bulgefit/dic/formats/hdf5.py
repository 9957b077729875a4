"""How are arrays of another system's HDF5 file read? Nothing outside the file is followed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bulgefit.errors import InputError

__all__ = ["SIGNATURE", "child", "largest_size", "numbers"]

#: The first bytes of an HDF5 file without a block of the user's before it.
SIGNATURE = b"\x89HDF\r\n\x1a\n"
# Measured fields hardly compress, but masked ones do; 200 MB more is what any machine has.
_COMPRESSION, _SPARE = 4, 200 * 2**20


def largest_size(path: Path) -> int:
    """Bytes that the arrays of a file may take: more is a file that was made to fill the memory."""
    return _COMPRESSION * path.stat().st_size + _SPARE


def child(group: Any, name: str, path: Path) -> Any:
    """A member of a group that stands in this very file, or None.

    Raises
    ------
    InputError
        It is a link into another file.
    """
    import h5py

    link = group.get(name, getlink=True)
    if link is None:
        return None
    if not isinstance(link, h5py.HardLink):
        raise InputError(f"{path}: {name} is a link, which is not followed; export the data itself")
    return group[name]


def numbers(dataset: Any, name: str, path: Path) -> NDArray[Any]:
    """The numbers of a data set.

    Raises
    ------
    InputError
        It holds none, keeps them in other files, or more than the file could.
    """
    if getattr(dataset, "shape", None) is None or dataset.dtype.kind not in "fiub":
        raise InputError(f"{path}: {name} is not a data set of real numbers")
    if dataset.is_virtual or dataset.external is not None:
        raise InputError(f"{path}: {name} keeps its numbers in other files; export the data itself")
    if dataset.size * dataset.dtype.itemsize > largest_size(path):
        raise InputError(f"{path}: {name} is larger than its file can hold; it is damaged")
    return np.asarray(dataset[()])
