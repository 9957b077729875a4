"""What stands in an HDF5 file? Answered by a process apart (`hdf5_apart`), question by question.

An answer is a line of JSON for each data set, followed by its numbers, and a line at the end. Only
what stands in the file itself is read: links, external storage and virtual data sets could name
any file of the machine, and no checksum would cover that.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator
from itertools import islice
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import need_memory
from bulgefit.dic.registry import one_line
from bulgefit.errors import InputError
from bulgefit.files import memory_for, open_regular

__all__ = ["ATTRIBUTES", "serve"]

#: Attributes that are told: units, what Istra4D's channels are, and MATLAB's mark of an array
#: without elements.
ATTRIBUTES = ("unit", "name", "factor", "offset", "MATLAB_empty")

# Seconds of processor time, and bytes that are unpacked in each further one.
_SECONDS, _BYTES_A_SECOND = 2.0, 2e7
# Memory that Python and the libraries take by themselves.
_OWN_MEMORY = 500_000_000
# Names at the root, and values of an attribute, that are told.
_MOST_NAMES, _MOST_VALUES = 1000, 256
# deflate, shuffle, fletcher32, szip, nbit, scale-offset, and h5py's own lzf. Others are loaded as
# code from a folder of plugins.
_FILTERS = {1, 2, 3, 4, 5, 6, 32000}

# What follows the line of a data set; None follows that of a list of cells.
_Told = tuple[dict[str, Any], NDArray[Any] | None]


def serve() -> None:
    """Answer each line of standard input, a path and keys, until there is no further one."""
    for line in sys.stdin.buffer:
        where, keys = json.loads(line)
        _answer(where, keys)


def _answer(where: str, keys: list[str]) -> None:
    out = sys.stdout.buffer
    try:
        with open_regular(where) as file:
            allowed = memory_for(file)
            _limit(allowed, os.fstat(file.fileno()).st_size)
            for head, numbers in _told(file, keys, allowed, where):
                out.write(json.dumps(head).encode() + b"\n")
                if numbers is not None:
                    out.write(numbers.reshape(-1).view(np.uint8).data)
            last: dict[str, Any] = {"names": _names(file)}
    except InputError as error:
        last = {"error": str(error)}
    except MemoryError:
        last = {"error": f"{where}: does not fit into memory, or is damaged"}
    except Exception as error:  # a damaged file can raise nearly anything
        last = {"error": f"{where}: damaged HDF5 file ({one_line(error)}); copy it again"}
    out.write(json.dumps(last).encode() + b"\n")
    out.flush()


def _limit(allowed: int, size: int) -> None:
    """Be ended by the system rather than take too much for a file, where the system can."""
    try:
        import resource
    except ImportError:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = used.ru_utime + used.ru_stime + _SECONDS + size / _BYTES_A_SECOND
    for kind, most in (
        (resource.RLIMIT_CPU, math.ceil(seconds)),
        (resource.RLIMIT_DATA, allowed + _OWN_MEMORY),
        (resource.RLIMIT_CORE, 0),
    ):
        _, ceiling = resource.getrlimit(kind)
        if ceiling == resource.RLIM_INFINITY or most < ceiling:
            resource.setrlimit(kind, (most, ceiling))


def _told(file: BinaryIO, keys: list[str], allowed: int, where: str) -> Iterator[_Told]:
    import h5py

    with h5py.File(file, "r") as archive:
        for key in keys:
            place = f"{where}: {key}"
            member = _member(archive, key, place)
            if member is None:
                continue
            if getattr(member, "dtype", None) != h5py.ref_dtype:
                allowed, told = _one(member, key, allowed, place)
                yield told
                continue
            allowed = _need(member, allowed, place)
            yield {"key": key, "cells": True}, None
            # MATLAB counts cells down the columns, and h5py shows its axes the other way round
            for reference in member[()].ravel():
                allowed, told = _one(archive[reference], key, allowed, place)
                yield told


def _one(member: Any, key: str, allowed: int, where: str) -> tuple[int, _Told]:
    """What is left of the memory after one data set, and what is told of it."""
    _need_numbers(member, where)
    allowed = _need(member, allowed, where)
    numbers = np.ascontiguousarray(member[()]).reshape(member.shape)
    head = {"key": key, "shape": numbers.shape, "dtype": numbers.dtype.str}
    return allowed, ({**head, "attributes": _attributes(member)}, numbers)


def _names(file: BinaryIO) -> list[str]:
    import h5py

    with h5py.File(file, "r") as archive:
        return [*islice(archive, _MOST_NAMES)]


def _member(archive: Any, key: str, where: str) -> Any:
    """What stands under a key in this very file; None where nothing does."""
    import h5py

    member = archive
    for name in key.split("/"):
        link = member.get(name, getlink=True) if isinstance(member, h5py.Group) else None
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            raise InputError(f"{where} is a link, which is not followed; store the array itself")
        member = member[name]
    return member


def _need_numbers(member: Any, where: str) -> None:
    """Refuse what is no array of real numbers."""
    if getattr(member, "shape", None) is None or member.dtype.kind not in "fiub":
        raise InputError(f"{where} is not a data set of real numbers")


def _need(dataset: Any, allowed: int, where: str) -> int:
    """What is left of the memory after a data set whose values stand in the file, in a known form.

    Raises
    ------
    InputError
        They do not, or nothing is left.
    """
    if dataset.external or dataset.is_virtual:
        raise InputError(
            f"{where} stands in another file, which is not read; store the array itself"
        )
    creation = dataset.id.get_create_plist()
    filters = {creation.get_filter(i)[0] for i in range(creation.get_nfilters())}
    if not filters <= _FILTERS:
        raise InputError(f"{where} is compressed in an unknown way; use gzip or none")
    # a chunk is unpacked whole, however little of it is asked for
    if dataset.chunks and math.prod(dataset.chunks) > dataset.size * 2 + (1 << 20):
        raise InputError(f"{where} has chunks far larger than itself; store it anew")
    return need_memory(dataset.shape, dataset.dtype, allowed, where)


def _attributes(dataset: Any) -> dict[str, list[str | float]]:
    found = {}
    for name in ATTRIBUTES:
        if name in dataset.attrs:
            values = np.atleast_1d(np.asarray(dataset.attrs[name], dtype=object)).ravel()
            found[name] = [*map(_plain, values[:_MOST_VALUES].tolist())]
    return found


def _plain(value: Any) -> str | float:
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    return float(value) if isinstance(value, (int, float, np.number)) else str(value)
