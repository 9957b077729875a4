"""How is bulgefit's own npz read? Never with pickles."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

import numpy as np

from bulgefit.dic.keyed_arrays import OPTIONAL, REQUIRED, recording_from
from bulgefit.dic.registry import Recording, file_checksum, one_line, reader
from bulgefit.errors import InputError

__all__ = ["read_npz"]


@reader("npz", [".npz"], example="arrays reference, displacement, pressure, radius, thickness")
def read_npz(path: Path) -> Recording:
    """Read the arrays of an npz; the keys are those of `keyed_arrays`."""
    try:
        with path.open("rb") as file:
            if file.read(4) not in (b"PK\x03\x04", b"PK\x05\x06"):
                raise InputError(f"{path}: not an npz file (no zip archive)")
            file.seek(0)
            with np.load(file, allow_pickle=False) as archive:
                wanted = [key for key in archive.files if key in REQUIRED + OPTIONAL]
                arrays = {key: archive[key] for key in wanted}
                others = {key: np.empty(0) for key in archive.files if key not in wanted}
    except (InputError, OSError, MemoryError):
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise InputError(
            f"{path}: damaged or cut short ({one_line(error)}); copy it again"
        ) from None
    except Exception as error:  # a damaged header can raise nearly anything
        if "allow_pickle" in str(error):
            raise InputError(
                f"{path}: holds pickled Python objects, which are not loaded; save plain arrays"
            ) from None
        raise InputError(
            f"{path}: cannot be read as npz ({one_line(error)}); save it anew"
        ) from None
    for key, array in arrays.items():
        if not isinstance(array, np.ndarray):  # numpy gives out what it does not know as bytes
            raise InputError(f"{path}: {key} is not a numpy array; save it with numpy.savez")
    return recording_from({**arrays, **others}, file_checksum(path), str(path))
