"""How is a pickle of numpy arrays read without running what it says?

No class or function of numpy (or of anything else) is handed to the pickle. Its few names are
answered by inert shells that only note what they are given; the arrays are then made from the
noted bytes here. A pickle that asks for any other name is refused.

Python's own slow unpickler is taken: the fast one fills memory up to whatever index a pickle
gives to a memorised object.
"""

from __future__ import annotations

import math
import pickle
import re
import struct
from collections.abc import Callable
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Shell", "UnsafePickleError", "load_shells", "to_array"]


class UnsafePickleError(Exception):
    """The pickle asks for something other than numpy arrays."""


class Shell:
    """Stands for an object that a pickle wants to make; keeps the arguments and the state.

    All shells are classes with a `__setstate__`, so that a pickle cannot change them either:
    its BUILD instruction calls that method and never sets attributes.
    """

    __slots__ = ("arguments", "state")

    def __init__(self, *arguments: Any) -> None:
        self.arguments = arguments
        self.state: Any = None

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Array(Shell):
    """numpy's `_reconstruct` and `ndarray`: the state is (version, shape, dtype, fortran, data)."""

    __slots__ = ()


class _FromBuffer(Shell):
    """numpy's `_frombuffer` of protocol 5: the arguments are (data, dtype, shape, order)."""

    __slots__ = ()


class _Scalar(Shell):
    """numpy's `scalar`: the arguments are (dtype, data)."""

    __slots__ = ()


class _Dtype(Shell):
    """numpy's `dtype`: the arguments are (code, align, copy), the state says the byte order."""

    __slots__ = ()


class _Latin1(Shell):
    """`_codecs.encode`, by which old protocols write bytes: the arguments are (text, codec)."""

    __slots__ = ()


_SHELLS: dict[tuple[str, str], type[Shell]] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Dtype,
    ("_codecs", "encode"): _Latin1,
}
for _core in ("numpy.core", "numpy._core"):
    _SHELLS[f"{_core}.multiarray", "_reconstruct"] = _Array
    _SHELLS[f"{_core}.multiarray", "scalar"] = _Scalar
    _SHELLS[f"{_core}.numeric", "_frombuffer"] = _FromBuffer


class _Bounded:
    """A file of which no more can be asked for than it has: memory is taken before it is read."""

    def __init__(self, file: IO[bytes]) -> None:
        here = file.tell()
        self.file, self.end = file, file.seek(0, 2)
        file.seek(here)

    def read(self, count: int) -> bytes:
        """The next `count` bytes."""
        if not 0 <= count <= self.end - self.file.tell():
            raise EOFError("cut short")
        return self.file.read(count)

    def readinto(self, buffer: bytearray) -> int:
        """Fill a buffer."""
        found = self.read(len(buffer))
        buffer[:] = found
        return len(found)

    def readline(self) -> bytes:
        """The bytes up to the next line break."""
        return self.file.readline()


# Instructions of a pickle. A frame takes some thirty; one makes at most a hundred bytes.
_MOST_INSTRUCTIONS = 300_000


class _Counted(dict[int, Any]):
    """The instructions of an unpickler, of which it can look up so many."""

    left = _MOST_INSTRUCTIONS

    def __getitem__(self, code: int) -> Any:
        self.left -= 1
        if self.left < 0:
            raise ValueError("too many instructions")
        return super().__getitem__(code)


class _Unpickler(pickle._Unpickler):
    # given by `load`, in every version of Python
    read: Callable[[int], bytes]
    append: Callable[[Any], None]

    def __init__(self, file: IO[bytes]) -> None:
        # the encoding lets bytes of Python 2 through unchanged
        super().__init__(_Bounded(file), encoding="latin1")
        own = {pickle.BYTEARRAY8[0]: _Unpickler._load_bytearray}
        self.dispatch = _Counted({**pickle._Unpickler.dispatch, **own})  # type: ignore[misc]

    def _load_bytearray(self) -> None:
        # Python's own takes the memory before it reads
        (size,) = struct.unpack("<Q", self.read(8))
        self.append(bytearray(self.read(size)))

    def find_class(self, module: str, name: str) -> Any:
        try:
            return _SHELLS[module, name]
        except KeyError:
            raise UnsafePickleError(f"{module}.{name}") from None


def load_shells(file: IO[bytes]) -> Any:
    """Load a pickle into plain Python containers, numbers and shells.

    Raises
    ------
    UnsafePickleError
        The pickle names a global other than those of numpy arrays; the message is its name.
    ValueError
        It is damaged or no pickle.
    """
    try:
        return _Unpickler(file).load()
    except UnsafePickleError:
        raise
    except Exception as error:  # a damaged pickle can raise nearly anything
        raise ValueError(f"damaged or no pickle: {type(error).__name__}") from None


def to_array(value: Any) -> NDArray[Any]:
    """Make the array that a shell (or a number) stands for.

    Only real numbers are made from bytes; the elements of an object array stay as they are,
    shells included.

    Raises
    ------
    ValueError
        The shell is not a well-formed array.
    """
    try:
        if isinstance(value, (int, float)):
            return np.asarray(float(value))
        if isinstance(value, _Array):
            _, shape, dtype, fortran, data = value.state
            return _make(data, dtype, shape, "F" if fortran else "C")
        if isinstance(value, _FromBuffer):
            data, dtype, shape, order = value.arguments
            return _make(data, dtype, shape, order)
        if isinstance(value, _Scalar):
            dtype, data = value.arguments
            return _make(data, dtype, (), "C")
    except (TypeError, OverflowError) as error:
        raise ValueError(f"not a well-formed array: {error}") from None
    raise ValueError(f"{type(value).__name__} is not an array")


def _make(data: Any, dtype: Any, shape: Any, order: Any) -> NDArray[Any]:
    if not isinstance(shape, tuple) or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError("an array's shape is not made of whole numbers")
    if order not in ("C", "F"):
        raise ValueError("an array's order is neither C nor F")
    size, kind = math.prod(shape), _numpy_dtype(dtype)
    if kind.hasobject:
        if not isinstance(data, list) or len(data) != size:
            raise ValueError("an object array has another number of elements than its shape")
        flat = np.empty(size, dtype=object)
        for i, element in enumerate(data):
            flat[i] = element
        return flat.reshape(shape, order=order)
    raw = _bytes(data)
    if len(raw) != size * kind.itemsize:
        raise ValueError("an array has another number of bytes than its shape")
    return np.frombuffer(raw, dtype=kind).reshape(shape, order=order)


def _numpy_dtype(value: Any) -> np.dtype[Any]:
    code = value.arguments[0] if isinstance(value, _Dtype) and value.arguments else None
    code = code.decode("latin1") if isinstance(code, bytes) else code
    if code in ("O", "O8", "O4", "|O"):
        return np.dtype(object)
    if not isinstance(code, str) or not re.fullmatch(r"[<>=]?(f2|f4|f8|[iu][1248])", code):
        raise ValueError(f"an array of {code!r} is not one of real numbers")
    state = value.state
    byte_order = state[1] if isinstance(state, tuple) and len(state) > 1 else "="
    byte_order = byte_order.decode("latin1") if isinstance(byte_order, bytes) else byte_order
    if byte_order in ("<", ">"):
        code = f"{byte_order}{code.lstrip('<>=')}"
    return np.dtype(code)


def _bytes(data: Any) -> bytes | bytearray:
    if isinstance(data, _Latin1):
        text, codec = data.arguments
        if not isinstance(text, str) or codec not in ("latin1", "latin-1"):
            raise ValueError("an array's bytes are written in an unknown way")
        return text.encode("latin1")
    if isinstance(data, str):
        return data.encode("latin1")
    if isinstance(data, (bytes, bytearray)):
        return data
    raise ValueError(f"an array's bytes are {type(data).__name__}")
