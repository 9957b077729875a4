"""How is a bulge test read, whatever its format?"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from typing import Any

# imported for their readers, which register themselves
from bulgefit.dic import read_hdf5, read_npz, read_study
from bulgefit.dic.assemble import per_frame
from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.check import check_pressure_unit
from bulgefit.dic.formats import (
    any_table,
    aramis,
    csv_folder,
    davis,
    davis_vc7,
    dice,
    duodic,
    istra4d,
    matchid,
    matchid_hdf5,
    vic3d,
    vic3d_mat,
)
from bulgefit.dic.formats.plugins import load_plugins
from bulgefit.dic.formats.source import Place, source_of
from bulgefit.dic.hdf5_apart import one_helper
from bulgefit.dic.mend import images_at_rest
from bulgefit.dic.registry import READERS, Recording, choose_reader, reader, unreadable
from bulgefit.errors import InputError

__all__ = ["READERS", "Recording", "load_plugins", "read_test", "reader"]

_BUILT_IN = (
    *(csv_folder, read_hdf5, read_npz, read_study),
    *(vic3d, vic3d_mat, davis, davis_vc7, matchid, matchid_hdf5, aramis),
    *(dice, istra4d, duodic, any_table),
)
# The study's value, taken where neither the file nor the caller gives one.
_USUAL_POISSON_RATIO = 0.24


def read_test(
    path: Place | Sequence[Place],
    *,
    format: str | None = None,
    radius: float | None = None,
    thickness: float | None = None,
    semi_axes: tuple[float, float] | None = None,
    poisson_ratio: float | None = None,
    warp_angle: float | None = None,
    at_rest: int | None = None,
    name: str | None = None,
    crop: float | None = None,
    mends: Sequence[Callable[[BulgeTest], BulgeTest]] = (),
    say: Callable[[str], None] | None = None,
    **options: Any,
) -> BulgeTest:
    """Read and check a bulge test.

    Parameters
    ----------
    path : path or sequence of paths
        A file, a folder of one file a frame, a pattern such as `frames/*.csv`, or a list of files.
    format : str, optional
        One of `READERS`, as `bulgefit formats` lists them; by default it is seen from the files.
    radius, thickness : float, mm, optional
        Override what the file says.
    semi_axes : (along x, along y), mm, optional
        Of an elliptic clamp, in the place of its radius.
    poisson_ratio : float, optional
        Overrides what the file says; 0.24 where neither says.
    warp_angle : float, degree, optional
        Of the warp from x, counter-clockwise seen from +z; overrides what the file says.
    at_rest : int, optional
        So many of the first frames are images before inflation; overrides what the files say.
    name : str, optional
        By default the file's name without its suffix.
    crop : float, mm, optional
        Points farther than this from the centre are left out before the test is checked.
    mends : sequence of callables, optional
        Each takes the test and gives back a better one (`bulgefit.dic.mend`), one after the
        other, before the test is cropped and checked.
    say : callable, optional
        Called with a line for each thing that the reader took, joined or left out.
    **options
        Of the format. `columns` (dict of x, y, z, dx, dy, dz to column names) for csv and table;
        for exports of DIC systems `pressure` (a table, or "names"), `pressure_column`,
        `pressure_unit` (such as "bar", or "2.5bar/V"), `positions` ("reference" or "current") and
        `length_unit`.

    Raises
    ------
    InputError
        The file cannot be read or is not a bulge test; one line says why and what to do.
    """
    tell = say or _silent
    for line in load_plugins():
        tell(line)
    lengths = {"radius": radius, "thickness": thickness}
    _need_numbers({**lengths, "poisson_ratio": poisson_ratio, "warp_angle": warp_angle})
    if at_rest is not None and not isinstance(at_rest, Integral):
        raise InputError(f"at_rest: give a whole number of images, not {at_rest!r}")
    source = source_of(path)
    path = source.path
    try:
        with one_helper():
            chosen = choose_reader(source, format, options)
            recording = chosen.read(source, **options)
    except OSError as error:
        raise unreadable(path, error) from error
    except MemoryError:
        raise InputError(f"{path}: does not fit into memory, or is damaged") from None
    for line in recording.notes:
        tell(line)
    pressure = per_frame(recording.pressure, "pressure", str(path))
    if not mends:  # the unit itself may be what is mended; the test is checked afterwards
        check_pressure_unit(pressure, recording.pressure_unit, str(path))
    images = recording.at_rest if at_rest is None else at_rest
    if images:
        mends = [partial(images_at_rest, count=images), *mends]
    common: dict[str, Any] = {
        "name": name or recording.name or path.resolve().stem,
        **_clamp(radius, semi_axes, recording, path),
        "thickness": _given(thickness, recording.thickness, "thickness", path),
        "poisson_ratio": _usual(poisson_ratio, recording.poisson_ratio),
        "warp_angle": recording.warp_angle if warp_angle is None else warp_angle,
        "time": recording.time,
        "schedule": recording.schedule,
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


def _need_numbers(given: Mapping[str, Any]) -> None:
    """Refuse what is no number, of what was given; InputError."""
    for key, value in given.items():
        if value is not None and (not isinstance(value, Real) or isinstance(value, bool)):
            raise InputError(f"{key}: give a number, not {value!r}")


def _silent(line: str) -> None:
    """Say nothing."""


def _clamp(
    radius: float | None,
    semi_axes: tuple[float, float] | None,
    recording: Recording,
    path: Path,
) -> dict[str, float]:
    """Radius and ellipticity: what is asked for, else what the file says."""
    if semi_axes is None:
        oval = 0.0 if radius is not None else recording.ellipticity or 0.0
        return {"radius": _given(radius, recording.radius, "radius", path), "ellipticity": oval}
    if radius is not None:
        raise InputError("--radius and --semi-axes do not go together: an ellipse has no radius")
    axes = list(semi_axes) if isinstance(semi_axes, Iterable) else []
    if len(axes) != 2:
        raise InputError(f"semi_axes: give two lengths in mm, along x and y, not {semi_axes!r}")
    a, b = axes
    _need_numbers({"semi_axes along x": a, "semi_axes along y": b})
    if not (0 < a < math.inf and 0 < b < math.inf):
        raise InputError(f"--semi-axes {a:g} {b:g}: give two lengths above 0 mm, along x and y")
    return {"radius": (a + b) / 2, "ellipticity": (a - b) / (a + b)}


def _given(asked: float | None, said: float | None, key: str, path: Path) -> float:
    value = said if asked is None else asked
    if value is None:
        raise InputError(f"{path}: does not say its {key}; give it in mm with --{key}")
    return value


def _usual(asked: float | None, said: float | None) -> float:
    value = said if asked is None else asked
    return _USUAL_POISSON_RATIO if value is None else value
