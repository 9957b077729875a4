"""How is bulgefit's own npz read? Never with pickles, and no more than it may take of memory."""

from __future__ import annotations

import struct
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.keyed_arrays import OPTIONAL, REQUIRED, need_memory, recording_from
from bulgefit.dic.registry import Recording, one_line, reader
from bulgefit.errors import InputError
from bulgefit.files import checksum_of, memory_for, open_regular

__all__ = ["READ_HEADER", "read_npz"]

# The last record of a zip archive: its signature and the size of the archive's directory.
_END = struct.Struct("<4s8xL6x")
# The directory of an archive with ten thousand arrays has half of this; objects are made of it.
_LARGEST_DIRECTORY = 1 << 20
# What numpy writes. Others (bzip2, LZMA) may ask for memory of their own.
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_CHUNK = 1 << 22
#: Of the versions of the npy format that numpy writes of plain arrays.
READ_HEADER = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


@reader("npz", [".npz"], example="arrays reference, displacement, pressure, radius, thickness")
def read_npz(path: Path) -> Recording:
    """Read the arrays of an npz; the keys are those of `keyed_arrays`."""
    with open_regular(path) as file:
        try:
            arrays = _arrays(file, path)
        except (InputError, OSError, MemoryError):
            raise
        except (zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise InputError(
                f"{path}: damaged or cut short ({one_line(error)}); copy it again"
            ) from None
        except Exception as error:  # a damaged header can raise nearly anything
            raise InputError(
                f"{path}: cannot be read as npz ({one_line(error)}); save it anew"
            ) from None
        return recording_from(arrays, checksum_of(file), str(path))


def _arrays(file: BinaryIO, path: Path) -> dict[str, NDArray[Any]]:
    _check_directory(file, path)
    with zipfile.ZipFile(file) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        wanted = [key for key in members if key in REQUIRED + OPTIONAL]
        arrays = {key: np.empty(0) for key in members if key not in wanted}
        allowed = memory_for(file)
        for key in wanted:
            with _member(archive, members[key], key, path) as stream:
                shape, fortran, dtype = _header(stream, key, path)
                allowed = need_memory(shape, dtype, allowed, f"{path}: {key}")
                arrays[key] = _content(stream, shape, fortran, dtype)
    return arrays


def _check_directory(file: BinaryIO, path: Path) -> None:
    if file.read(4) not in (b"PK\x03\x04", b"PK\x05\x06"):
        raise InputError(f"{path}: not an npz file (no zip archive)")
    file.seek(max(0, file.seek(0, 2) - _END.size))
    end = file.read()
    signature, size = _END.unpack(end) if len(end) == _END.size else (b"", 0)
    if signature != b"PK\x05\x06":
        raise zipfile.BadZipFile("its directory is missing")
    if size > _LARGEST_DIRECTORY:
        raise InputError(f"{path}: has far too many members for a bulge test; save it anew")


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, key: str, path: Path) -> IO[bytes]:
    if info.compress_type not in _COMPRESSIONS:
        raise InputError(f"{path}: {key} is compressed in an unknown way; use numpy.savez")
    return archive.open(info)


def _header(stream: IO[bytes], key: str, path: Path) -> tuple[tuple[int, ...], bool, Any]:
    start = stream.read(len(np.lib.format.MAGIC_PREFIX) + 2)
    version = tuple(start[-2:])
    if start[:-2] != np.lib.format.MAGIC_PREFIX or version not in READ_HEADER:
        raise InputError(f"{path}: {key} is not a numpy array; save it with numpy.savez")
    shape, fortran, dtype = READ_HEADER[version](stream)
    if dtype.hasobject:
        raise InputError(
            f"{path}: holds pickled Python objects, which are not loaded; save plain arrays"
        )
    if any(length < 0 for length in shape):
        raise ValueError(f"{key} has shape {shape}")
    return shape, fortran, dtype


def _content(
    stream: IO[bytes], shape: tuple[int, ...], fortran: bool, dtype: np.dtype[Any]
) -> NDArray[Any]:
    array = np.empty(shape, dtype, order="F" if fortran else "C")
    # a view as bytes, filled as the member is unpacked
    raw = array.reshape(-1, order="A").view(np.uint8).data if array.size else memoryview(b"")
    at = 0
    while at < len(raw):
        part = stream.read(min(_CHUNK, len(raw) - at))
        if not part:
            raise EOFError("an array ends before its last number")
        raw[at : at + len(part)] = part
        at += len(part)
    # one byte more makes zipfile compare the checksum of the member
    if stream.read(1):
        raise ValueError("an array goes on after its last number")
    return array
