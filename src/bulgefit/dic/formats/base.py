"""How do the exports of a DIC system become a test? The same way for every system."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from bulgefit.dic.formats.frames import Frame, upright
from bulgefit.dic.formats.join import joined
from bulgefit.dic.formats.logs import is_log
from bulgefit.dic.formats.positions import CURRENT, POSITIONS, REFERENCE, evidence
from bulgefit.dic.formats.pressures import pressures_of
from bulgefit.dic.formats.source import Head, Source
from bulgefit.dic.formats.specimen import SPECIMEN, specimen_of
from bulgefit.dic.registry import READERS, Reader, Recording, file_checksum
from bulgefit.dic.units import LENGTH, factor
from bulgefit.errors import InputError
from bulgefit.shown import number_of, some_of

__all__ = ["Ask", "Format", "register"]

_OPTIONS = ("pressure", "pressure_column", "pressure_unit", "positions", "length_unit")
_NO_UNIT = "lengths state no unit and are taken as mm; --length-unit gives another"
_TURNED = "y and z change sign: the file's y runs down the image"
_DIGITS = re.compile(r"\d+(?:[.,]\d+)?")
_FOR_PRESSURE = {"pressure": "pressure", "pressure_column": "column", "pressure_unit": "unit"}


@dataclass(frozen=True)
class Ask:
    """What the reader of one file is asked for.

    Attributes
    ----------
    length : float
        What lengths whose unit the file does not state are multiplied by to become mm.
    signal : str or None
        A column that is wanted beside the points.
    columns : mapping of str to str
        What x, y, z, dx, dy, dz are called, for the format that has no names of its own.
    """

    length: float = 1.0
    signal: str | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Format:
    """What is known of a DIC system's exports.

    Attributes
    ----------
    name : str
    system : str
        What writes them.
    example : str
        A line by which they are known.
    recognises : callable
        Whether a `Head` is the beginning of one.
    read : callable
        Reads a path, as an `Ask` asks for, into its frames; most files hold one.
    lost : str
        The mark of a lost point.
    positions : str
        "reference" or "current".
    y_down : bool
        Whether y runs down the image and z away from the cameras.
    options : tuple of str
        Beside those of all such formats.
    by_name_only : bool
        Whether it is read only where the format is named.
    """

    name: str
    system: str
    example: str
    recognises: Callable[[Head], bool]
    read: Callable[[Path, Ask], list[Frame]]
    lost: str
    positions: str
    y_down: bool = False
    options: tuple[str, ...] = ()
    by_name_only: bool = False


def register(format: Format) -> None:
    """Make a format one that `read_test` knows."""
    READERS[format.name] = Reader(
        name=format.name,
        looks_like=format.system,
        matches=partial(_matches, format),
        options=(*_OPTIONS, *format.options),
        read=partial(_read, format),
        example=format.example,
        lost=format.lost,
        positions=format.positions,
        by_content=True,
    )


def _matches(format: Format, source: Source) -> bool:
    if format.by_name_only or "columns" in _specimen(source):
        return False
    return any(map(format.recognises, source.heads))


def _specimen(source: Source) -> dict[str, Any]:
    return specimen_of(source.path / SPECIMEN) if source.path.is_dir() else {}


def _read(
    format: Format,
    source: Source,
    *,
    positions: str | None = None,
    length_unit: str | None = None,
    columns: Mapping[str, str] | None = None,
    **options: Any,
) -> Recording:
    if positions not in (None, *POSITIONS):
        raise InputError(f"--positions {positions}: is not one of {', '.join(POSITIONS)}")
    length = 1.0 if length_unit is None else factor(length_unit, LENGTH, "--length-unit")
    specimen = _specimen(source)
    names = {**specimen.get("columns", {}), **(columns or {})}
    ask = Ask(length, options.get("pressure_column"), names)
    own = [head for head in source.heads if format.recognises(head)]
    if not own:
        raise InputError(
            f"{source.path}: holds no file of the format {format.name}; such a file has "
            f"{format.example}"
        )
    frames = [frame for head in own for frame in format.read(head.path, ask)]
    where = str(source.path)
    pressure = pressures_of(
        frames,
        [head for head in source.heads if head not in own],
        _beside(format, source),
        where,
        **{_FOR_PRESSURE[key]: value for key, value in options.items()},
    )
    left = _left_out(source, own, pressure.used)
    frames, turned = upright(frames, format.y_down)
    kind, notes = _kind_of_positions(format, frames, positions, where)
    placed, by, count = joined(frames, kind)
    used = [*(head.path for head in own), *pressure.used]
    if specimen:
        used.append(source.path / SPECIMEN)
    return Recording(
        pressure=pressure.values,
        checksum=file_checksum(*sorted({*used})),
        frames=placed,
        radius=specimen.get("radius"),
        thickness=specimen.get("thickness"),
        poisson_ratio=specimen.get("poisson_ratio"),
        warp_angle=specimen.get("warp_angle"),
        at_rest=int(specimen.get("at_rest", 0)),
        time=pressure.time,
        name=specimen.get("name"),
        pressure_unit=pressure.unit,
        notes=(
            f"{format.name}: {number_of(len(frames), 'frame')} of {format.system}, "
            f"{kind} positions",
            *notes,
            *([] if length_unit or all(f.has_units for f in frames) else [_NO_UNIT]),
            *([_TURNED] if turned else []),
            *left,
            _said_of_points(frames, by, count, format.lost),
            pressure.note,
        ),
    )


def _beside(format: Format, source: Source) -> Iterator[Head]:
    # a generator, so that a folder of many files is looked through only where that is needed
    yield from (head for head in source.beside if not format.recognises(head))


def _left_out(source: Source, own: list[Head], used: Sequence[Path]) -> list[str]:
    """What there is to say of files that end as the frames do, but are none of them and no log.

    Raises
    ------
    InputError
        One is named as the frames are: without it the test would lack a frame.
    """
    frames = {head.path for head in own}
    endings = {path.suffix.lower() for path in frames}
    names = {_DIGITS.sub("#", path.name) for path in frames}
    rest = [head for head in source.heads if head.path not in frames]
    logs = {*used, *(head.path for head in rest if is_log(head))}
    others = [f for f in source.files if f not in {*frames, *logs} and f.suffix.lower() in endings]
    for file in others:
        if _DIGITS.sub("#", file.name) in names:
            what = "is not of the frames' format" if file.stat().st_size else "is empty"
            raise InputError(
                f"{file}: {what}, but is named as the frames are; export it again, or move it out"
            )
    named = some_of([file.name for file in others])
    return [f"no frames and no logs, left out: {named}"] if others else []


def _kind_of_positions(
    format: Format, frames: list[Frame], asked: str | None, where: str
) -> tuple[str, list[str]]:
    """What the positions are, and what there is to say of it.

    Raises
    ------
    InputError
        The numbers are not what the format declares, and nothing was asked for.
    """
    kind = asked or format.positions
    found = evidence(frames)
    if found is None:
        return kind, ["one frame only: the numbers do not tell whether its positions are " + kind]
    if found.says == kind:
        return kind, []
    if found.says is None:
        return kind, [f"the numbers do not tell whether its positions are {kind}"]
    means = {REFERENCE: "those before inflation (x1 = x0)", CURRENT: "current (x1 = x0 + u)"}
    told = f"positions are {means[found.says]} by the numbers, not {kind}"
    if asked is None:
        raise InputError(
            f"{where}: {told} as {format.name} declares; give --positions {found.says}"
        )
    return kind, [f"{told}, as was asked for"]


def _said_of_points(frames: list[Frame], by: str, count: int, mark: str) -> str:
    counts = [len(frame.position) for frame in frames]
    least, most = min(counts), max(counts)
    measured = f"{least}" if least == most else f"{least} to {most}"
    lost = sum(frame.lost for frame in frames)
    how = "each frame with points of its own"
    if by != "nothing":
        how = f"joined by {by}" + (f" into {count}" if count > most else "")
    marked = f"; {lost} marked as lost ({mark}) left out" if lost else ""
    return f"{measured} points a frame, {how}{marked}"
