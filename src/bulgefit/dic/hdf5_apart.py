"""How is HDF5 read whose library hangs or crashes on damaged files? In a process of its own.

The process answers on its standard output: a line of JSON for each data set, followed by the
numbers, and a line at the end. It may use a few seconds of
processor time, and memory in proportion to the file. Only what stands in the file itself is read:
links, external storage and virtual data sets could name any file of the machine, and no checksum
would cover that.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from io import BufferedReader
from itertools import islice
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import need_memory
from bulgefit.dic.registry import one_line
from bulgefit.errors import InputError
from bulgefit.files import memory_for, open_regular

__all__ = ["Dataset", "answer", "read_apart"]

# Seconds of processor time, and bytes that are unpacked in each further one.
_SECONDS, _BYTES_A_SECOND = 2.0, 2e7
# Memory that Python and the libraries take by themselves.
_OWN_MEMORY = 500_000_000
# Names of others that are told where something is missing.
_MOST_OTHERS = 20
# deflate, shuffle, fletcher32, szip, nbit, scale-offset, and h5py's own lzf. Others are loaded as
# code from a folder of plugins.
_FILTERS = {1, 2, 3, 4, 5, 6, 32000}

# Isolated, so that no module is taken from the folder in which bulgefit happens to run.
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from bulgefit.dic.hdf5_apart import answer; answer(sys.argv[2], sys.argv[3:])"
)


@dataclass(frozen=True)
class Dataset:
    """A data set and its attribute `unit`, None where it has none."""

    numbers: NDArray[Any]
    unit: str | None


def read_apart(
    file: BinaryIO, keys: Iterable[str], where: str
) -> tuple[dict[str, Dataset], list[str]]:
    """Read data sets from an open HDF5 file.

    Parameters
    ----------
    file : binary file
        Its size bounds what is read.
    keys : iterable of str
        Data sets at the root of the file; those that are missing are left out.
    where : str
        The path of the file.

    Returns
    -------
    datasets : dict of str to Dataset
    others : list of str
        Some names of what else stands at the root.

    Raises
    ------
    InputError
        The file is damaged, or a data set is none of real numbers that stand in the file.
    """
    command = [sys.executable, "-I", "-c", _START, json.dumps(sys.path), where, *keys]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        try:
            return _heard(cast(BufferedReader, process.stdout), memory_for(file), where)
        except EOFError:
            process.wait()
            raise InputError(
                f"{where}: damaged HDF5 file ({_end(process.returncode)}); copy it again"
            ) from None
        finally:
            process.kill()


def _end(status: int) -> str:
    import signal

    if status in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)):
        return "the HDF5 library does not come to an end with it"
    return "the HDF5 library fails on it"


def _heard(heard: BufferedReader, allowed: int, where: str) -> tuple[dict[str, Dataset], list[str]]:
    datasets: dict[str, Dataset] = {}
    while True:
        line = heard.readline()
        if not line.endswith(b"\n"):
            raise EOFError
        told = json.loads(line)
        if "error" in told:
            raise InputError(told["error"])
        if "others" in told:
            return datasets, told["others"]
        shape, dtype = tuple(told["shape"]), np.dtype(told["dtype"])
        allowed = need_memory(shape, dtype, allowed, f"{where}: {told['key']}")
        numbers = np.empty(shape, dtype)
        if numbers.size:
            raw = numbers.reshape(-1).view(np.uint8)
            if heard.readinto(raw.data) != len(raw):
                raise EOFError
        datasets[told["key"]] = Dataset(numbers, told["unit"])


# ---- in the process apart ----


def answer(where: str, keys: list[str]) -> None:
    """Write the data sets of a file to standard output."""
    out = sys.stdout.buffer
    with open_regular(where) as file:
        allowed = memory_for(file)
        _limit(allowed, os.fstat(file.fileno()).st_size)
        try:
            for key, numbers, unit in _datasets(file, keys, allowed, where):
                head = {"key": key, "shape": numbers.shape, "dtype": numbers.dtype.str}
                out.write(json.dumps({**head, "unit": unit}).encode() + b"\n")
                out.write(numbers.reshape(-1).view(np.uint8).data)
            last: dict[str, Any] = {"others": _others(file, keys)}
        except InputError as error:
            last = {"error": str(error)}
        except MemoryError:
            last = {"error": f"{where}: does not fit into memory, or is damaged"}
        except Exception as error:  # a damaged file can raise nearly anything
            last = {"error": f"{where}: damaged HDF5 file ({one_line(error)}); copy it again"}
    out.write(json.dumps(last).encode() + b"\n")
    out.flush()


def _limit(allowed: int, size: int) -> None:
    """Be ended by the system rather than take too much, where the system can."""
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


def _datasets(
    file: BinaryIO, keys: list[str], allowed: int, where: str
) -> Iterable[tuple[str, NDArray[Any], str | None]]:
    import h5py

    with h5py.File(file, "r") as archive:
        for key in keys:
            if key in archive:
                dataset = _own_dataset(archive, key, f"{where}: {key}")
                allowed = need_memory(dataset.shape, dataset.dtype, allowed, f"{where}: {key}")
                yield key, np.ascontiguousarray(dataset[()]).reshape(dataset.shape), _unit(dataset)


def _others(file: BinaryIO, keys: list[str]) -> list[str]:
    import h5py

    with h5py.File(file, "r") as archive:
        return list(islice((key for key in archive if key not in keys), _MOST_OTHERS))


def _own_dataset(archive: Any, key: str, where: str) -> Any:
    """A data set whose numbers stand in the file, in a known form."""
    import h5py

    if not isinstance(archive.get(key, getlink=True), h5py.HardLink):
        raise InputError(f"{where} is a link, which is not followed; store the array itself")
    dataset = archive[key]
    if getattr(dataset, "shape", None) is None or dataset.dtype.kind not in "fiu":
        raise InputError(f"{where} is not a data set of real numbers")
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
    return dataset


def _unit(dataset: Any) -> str | None:
    unit = dataset.attrs.get("unit")
    if unit is None:
        return None
    return unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
