"""How is a bulge test read, whatever its format?"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

# imported for their readers, which register themselves
from bulgefit.dic import read_csv_folder, read_hdf5, read_npz, read_study
from bulgefit.dic.assemble import per_frame
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.check import check_pressure_unit
from bulgefit.dic.registry import READERS, Recording, choose_reader, reader, unreadable
from bulgefit.errors import InputError

__all__ = ["READERS", "Recording", "read_test", "reader"]

_BUILT_IN = (read_csv_folder, read_hdf5, read_npz, read_study)
# The study's value, taken where neither the file nor the caller gives one.
_USUAL_POISSON_RATIO = 0.24


def read_test(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    radius: float | None = None,
    thickness: float | None = None,
    poisson_ratio: float | None = None,
    name: str | None = None,
    crop: float | None = None,
    mends: Sequence[Callable[[BulgeTest], BulgeTest]] = (),
    **options: Any,
) -> BulgeTest:
    """Read and check a bulge test.

    Parameters
    ----------
    path : path
        A file, or a folder of CSV files.
    format : str, optional
        One of `READERS` (npz, hdf5, study, csv); by default it is seen from the path.
    radius, thickness : float, mm, optional
        Override what the file says.
    poisson_ratio : float, optional
        Overrides what the file says; 0.24 where neither says.
    name : str, optional
        By default the file's name without its suffix.
    crop : float, mm, optional
        Points farther than this from the centre are left out before the test is checked.
    mends : sequence of callables, optional
        Each takes the test and gives back a better one (`bulgefit.dic.mend`), one after the
        other, before the test is cropped and checked.
    **options
        Of the format: `columns` (dict of x, y, z, dx, dy, dz to column names) for csv.

    Raises
    ------
    InputError
        The file cannot be read or is not a bulge test; one line says why and what to do.
    """
    path = Path(path)
    chosen = choose_reader(path, format, options)
    try:
        recording = chosen.read(path, **options)
    except OSError as error:
        raise unreadable(path, error) from error
    except MemoryError:
        raise InputError(f"{path}: does not fit into memory, or is damaged") from None
    pressure = per_frame(recording.pressure, "pressure", str(path))
    if not mends:  # the unit itself may be what is mended; the test is checked afterwards
        check_pressure_unit(pressure, recording.pressure_unit, str(path))
    common: dict[str, Any] = {
        "name": name or recording.name or path.resolve().stem,
        "radius": _given(radius, recording.radius, "radius", path),
        "thickness": _given(thickness, recording.thickness, "thickness", path),
        "poisson_ratio": _usual(poisson_ratio, recording.poisson_ratio),
        "time": recording.time,
        "source": str(path),
        "checksum": recording.checksum,
        "history": recording.history,
        "crop": crop,
        "mends": mends,
    }
    if recording.frames is not None:
        return BulgeTest.from_frames(recording.frames, pressure, **common)
    assert recording.reference is not None
    assert recording.displacement is not None
    return BulgeTest.from_arrays(
        recording.reference,
        recording.displacement,
        pressure,
        static_displacement=recording.static_displacement,
        **common,
    )


def _given(asked: float | None, said: float | None, key: str, path: Path) -> float:
    value = said if asked is None else asked
    if value is None:
        raise InputError(f"{path}: does not say its {key}; give it in mm with --{key}")
    return value


def _usual(asked: float | None, said: float | None) -> float:
    value = said if asked is None else asked
    return _USUAL_POISSON_RATIO if value is None else value
