"""How is HDF5 read whose library hangs or crashes on damaged files? In a process of its own.

The process serves one read after another (`hdf5_answers`), so that a folder of many files costs
one start. It may use a few seconds of processor time a file, and memory in proportion to it. What
ends it is one damaged file; the next question starts another.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from io import BufferedReader
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import need_memory
from bulgefit.errors import InputError
from bulgefit.files import memory_for

__all__ = ["HDF5_SIGNATURE", "Contents", "Dataset", "one_helper", "read_apart"]

#: The first bytes of an HDF5 file without a block of the user's before it.
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"

# Isolated, so that no module is taken from the folder in which bulgefit happens to run.
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from bulgefit.dic.hdf5_answers import serve; serve()"
)


@dataclass(frozen=True)
class Dataset:
    """A data set and what its attributes say, each as a list.

    Attributes
    ----------
    numbers : array
    attributes : mapping of str to list of str or float
        Those of `hdf5_answers.ATTRIBUTES` that it has.
    """

    numbers: NDArray[Any]
    attributes: Mapping[str, list[Any]]

    @property
    def unit(self) -> str | None:
        """Its attribute `unit`, None where it has none."""
        found = self.attributes.get("unit")
        return str(found[0]) if found else None


@dataclass(frozen=True)
class Contents:
    """What was read of a file.

    Attributes
    ----------
    datasets : dict of str to Dataset
        By the keys that were asked for, those that are missing left out.
    cells : dict of str to list of Dataset
        The same of data sets of references, as MATLAB keeps its cells: what they refer to.
    names : list of str
        Some names of what stands at the root.
    """

    datasets: dict[str, Dataset] = field(default_factory=dict)
    cells: dict[str, list[Dataset]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)


def read_apart(file: BinaryIO, keys: Iterable[str], where: str) -> Contents:
    """Read data sets from an open HDF5 file.

    Parameters
    ----------
    file : binary file
        Its size bounds what is read.
    keys : iterable of str
        Data sets, with the groups in which they stand: `coordinates/mask`.
    where : str
        The path of the file.

    Raises
    ------
    InputError
        The file is damaged, or a data set is none of real numbers that stand in the file.
    """
    with one_helper() as helper:
        return helper.ask(where, [*keys], memory_for(file))


@contextmanager
def one_helper() -> Iterator[_Helper]:
    """Let all that is read within go through one process; the outermost of these ends it."""
    if (known := _current.get()) is not None:
        yield known
        return
    helper = _Helper()
    before = _current.set(helper)
    try:
        yield helper
    finally:
        _current.reset(before)
        helper.end()


class _Helper:
    """The process apart; it starts with the first question."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        # what was said of files that ended it: a second question would end it again
        self._damaged: dict[str, str] = {}

    def ask(self, where: str, keys: list[str], allowed: int) -> Contents:
        """The named data sets of a file, in at most so many bytes of memory."""
        if where in self._damaged:
            raise InputError(self._damaged[where])
        process = self._process = self._process or _started()
        question, answer = cast(BinaryIO, process.stdin), cast(BufferedReader, process.stdout)
        try:
            question.write(json.dumps([where, keys]).encode() + b"\n")
            question.flush()
            told = _heard(answer, allowed, where)
        except (EOFError, BrokenPipeError):
            process.wait()
            status = process.returncode
            self.end()
            why = f"{where}: damaged HDF5 file ({_how_it_ended(status)}); copy it again"
            self._damaged[where] = why
            raise InputError(why) from None
        except BaseException:
            self.end()  # what is left of its answer would be taken for the next one
            raise
        if isinstance(told, str):
            raise InputError(told)
        return told

    def end(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            with self._process:  # closes its pipes and waits for it
                self._process = None


_current: ContextVar[_Helper | None] = ContextVar("helper", default=None)


def _started() -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-I", "-c", _START, json.dumps(sys.path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


def _how_it_ended(status: int) -> str:
    import signal

    if status in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)):
        return "the HDF5 library does not come to an end with it"
    return "the HDF5 library fails on it"


def _heard(heard: BufferedReader, allowed: int, where: str) -> Contents | str:
    """What the process says of a file, or why it does not read it."""
    contents = Contents()
    while True:
        line = heard.readline()
        if not line.endswith(b"\n"):
            raise EOFError
        told = json.loads(line)
        if "error" in told:
            return str(told["error"])
        if "names" in told:
            contents.names.extend(told["names"])
            return contents
        key = told["key"]
        if "cells" in told:
            contents.cells[key] = []
            continue
        shape, dtype = tuple(told["shape"]), np.dtype(told["dtype"])
        allowed = need_memory(shape, dtype, allowed, f"{where}: {key}")
        dataset = Dataset(_numbers(heard, shape, dtype), told["attributes"])
        if key in contents.cells:
            contents.cells[key].append(dataset)
        else:
            contents.datasets[key] = dataset


def _numbers(heard: BufferedReader, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    numbers = np.empty(shape, dtype)
    if numbers.size:
        raw = numbers.reshape(-1).view(np.uint8)
        if heard.readinto(raw.data) != len(raw):
            raise EOFError
    return numbers
