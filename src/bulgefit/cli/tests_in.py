"""Which tests does a verb work on, and how are they read? The same options for every verb."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from bulgefit.cli._common import progress
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from bulgefit.dic import BulgeTest

__all__ = [
    "add_reader_arguments",
    "add_test_argument",
    "add_tests_argument",
    "files_read",
    "reader_options",
    "reading_of",
    "tests_from",
    "warn_of_alarms",
]


_TEST = (
    "bulge test: a file (.npz, .h5, the study's .npy), or a folder of one file a frame (CSV, or an "
    "export of a DIC system, of which a quoted 'pattern*' picks some; bulgefit formats lists them)"
)

# Options of the formats that are exports of DIC systems.
_OF_EXPORTS = ("pressure", "pressure_column", "pressure_unit", "positions", "length_unit")


def add_tests_argument(parser: argparse.ArgumentParser) -> None:
    """Add the positional TEST [TEST ...], as `args.tests`."""
    parser.add_argument(
        "tests",
        nargs="+",
        metavar="TEST",
        action=_Tests,
        help=_TEST,
    )


class _Tests(argparse.Action):
    """Keep tests; of a pattern that the shell has left alone, as Windows' does, each that it names.

    A .npz is a test of its own. Other files that a pattern names are the frames of one.
    """

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, *_: Any
    ) -> None:
        import glob
        import os

        named = []
        for word in values:
            found = [] if os.path.lexists(word) else sorted(glob.glob(word))
            whole = found and all(name.endswith(".npz") for name in found)
            named += found if whole else [word]
        setattr(namespace, self.dest, named)


def add_test_argument(parser: argparse.ArgumentParser, dest: str = "test") -> None:
    """Add the positional TEST, as `args.test`, or IN, as `args.input`."""
    parser.add_argument(dest, metavar="TEST" if dest == "test" else "IN", help=_TEST)


def add_reader_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how a test is read, such as --format, --radius and --pressure."""
    group = parser.add_argument_group("reading tests")
    group.add_argument(
        "--format",
        metavar="F",
        help="format, one of those that bulgefit formats lists (default: seen from the files)",
    )
    group.add_argument(
        "--radius",
        type=float,
        metavar="MM",
        help="clamp radius in mm (default: what the file says; 100 for the study's layout)",
    )
    group.add_argument(
        "--semi-axes",
        type=float,
        nargs=2,
        metavar=("A", "B"),
        help="semi-axes in mm, along x and y, of an elliptic clamp, in the place of its radius "
        "(default: what the file says, else a circle)",
    )
    group.add_argument(
        "--thickness",
        type=float,
        metavar="MM",
        help="nominal thickness in mm (default: what the file says; 0.81 for the study's layout)",
    )
    group.add_argument(
        "--warp-angle",
        type=float,
        metavar="DEG",
        help="where the warp was mounted: its angle to x in degrees, counter-clockwise seen from "
        "+z, as 90 of a specimen that was turned in the clamp; of every test that is named, and "
        "bulgefit convert writes it into one (default: what the file says, else x is the warp)",
    )
    group.add_argument(
        "--at-rest",
        type=int,
        metavar="N",
        help="the first N frames of every test are images before inflation, which tell the noise "
        "(default: what the files say, else none)",
    )
    group.add_argument(
        "--columns",
        metavar="x=NAME,...",
        help="what the columns x, y, z, dx, dy, dz (mm) are called in the CSV frames of a folder, "
        "or in other text tables with --format table, e.g. x=X_mm,y=Y_mm (default: their own "
        "names)",
    )
    group.add_argument(
        "--pressure",
        metavar="FILE",
        help="table of the pressures of a DIC system's frames, with their file names or numbers; "
        "`names` where the file names tell, as in run_1.5bar.csv (default: a log beside the "
        "frames, else what they recorded, else their names)",
    )
    group.add_argument(
        "--pressure-column",
        metavar="NAME",
        help="column of that table, or of the frames, that holds the pressure (default: the one "
        "that is called so)",
    )
    group.add_argument(
        "--pressure-unit",
        metavar="UNIT",
        help="unit of that column (bar, mbar, kPa, MPa, Pa, psi, mmHg), or what one of its unit is "
        "worth, e.g. 2.5bar/V of a column in V or without a unit (default: what the column states; "
        "that of names stays)",
    )
    group.add_argument(
        "--positions",
        metavar="WHICH",
        help="whether a DIC system's positions are those before inflation (reference) or at the "
        "frame (current) (default: what the format declares, checked on the numbers)",
    )
    group.add_argument(
        "--length-unit",
        metavar="UNIT",
        help="unit of lengths for which a DIC system's file states none (default: mm)",
    )


def reader_options(args: argparse.Namespace) -> dict[str, Any]:
    """Keyword arguments of `read_test` that the parsed options stand for."""
    options: dict[str, Any] = {
        "format": args.format,
        "radius": args.radius,
        "thickness": args.thickness,
        "warp_angle": args.warp_angle,
        "at_rest": args.at_rest,
        "semi_axes": None if args.semi_axes is None else tuple(args.semi_axes),
    }
    for key in _OF_EXPORTS:
        if getattr(args, key) is not None:
            options[key] = getattr(args, key)
    if args.columns is not None:
        options["columns"] = _columns(args.columns)
    options["say"] = lambda line: progress(args, line)
    return options


def reading_of(args: argparse.Namespace) -> dict[str, Any]:
    """What of `reader_options` and --max-pressure was given, as JSON types.

    By `options` and `max_pressure_bar` the same tests are read again.
    """
    if not hasattr(args, "positions"):  # a verb that reads no tests
        return {}
    options = reader_options(args)
    del options["say"]
    return {
        "options": {name: value for name, value in options.items() if value is not None},
        "max_pressure_bar": getattr(args, "max_pressure", None),
    }


def tests_from(args: argparse.Namespace) -> list[BulgeTest]:
    """Read the tests of `args.tests`, and warn of what makes all that follows meaningless.

    Raises
    ------
    InputError
        One cannot be read, or two hold the same data.
    """
    from bulgefit.dic import read_test
    from bulgefit.dic.given import distinctly_named, each_once

    options = reader_options(args)
    tests = distinctly_named([read_test(path, **options) for path in args.tests])
    for test in tests:
        warn_of_alarms(args, test)
    return each_once(tests)


def warn_of_alarms(args: argparse.Namespace, test: BulgeTest) -> None:
    """Tell what makes all that follows from a test meaningless."""
    from bulgefit.dic.suspicions import alarms
    from bulgefit.dic.suspicions.bins import about_bins
    from bulgefit.dic.suspicions.copies import about_copies

    for alarm in (*alarms(test), *about_copies(test), *about_bins(test)):
        progress(args, f"warning: {test.name}: {alarm.text}; {alarm.remedy}")


def files_read(paths: Iterable[str | None]) -> list[Path]:
    """The files that are read where these paths are named; None stands for an option not given.

    Results and pictures in a folder of frames are none of them.
    """
    import glob
    from pathlib import Path

    found = []
    named = [name for name in paths if name is not None]
    for path in map(Path, [*named, *(match for name in named for match in glob.glob(name))]):
        found.append(path)
        if path.is_dir():
            found += [p for p in path.iterdir() if p.suffix not in (".json", ".png")]
            found.append(path / "test.json")
    return found


def _columns(text: str) -> dict[str, str]:
    columns: dict[str, str] = {}
    for item in text.split(","):
        key, equals, name = (part.strip() for part in item.partition("="))
        if not equals or not key or not name:
            raise InputError(f"--columns: {item!r} is not of the form x=NAME")
        if key in columns:
            raise InputError(f"--columns: {key} is given twice; name one column for it")
        columns[key] = name
    return columns
