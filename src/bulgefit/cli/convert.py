"""bulgefit convert: how do I bring a measured test into bulgefit's own files?"""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING

from bulgefit.cli import _common
from bulgefit.cli.tests_in import (
    add_reader_arguments,
    add_test_argument,
    files_read,
    reader_options,
    warn_of_alarms,
)
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from bulgefit.dic import BulgeTest

    Mend = Callable[[BulgeTest], BulgeTest]

__all__ = ["HELP", "add_arguments", "run"]

HELP = "convert a bulge test to .npz or .h5; mend, turn and crop it on the way"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Read a bulge test of any known format, mend what `bulgefit info` finds, check it, and\n"
        "write it as .npz or HDF5 (.h5, .hdf5). What is asked for is done in the order of this\n"
        "help: units, positions, swap, flip, shift, level, centre, recorded, whole\n"
        "bins; then points are cropped, and the test is turned last."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit convert frames/ test.npz --radius 100 --thickness 0.81 --columns x=X,y=Y\n"
        "  bulgefit convert study.npy test.h5 --crop 98\n"
        "  bulgefit convert test.npz turned.npz --rotate 90\n"
        "  bulgefit convert test.npz mended.npz --unit pressure=psi/bar --flip dx --centre rim"
    )
    add_test_argument(parser, "input")
    parser.add_argument("output", metavar="OUT", help="file to write: .npz, .h5 or .hdf5")
    _add_mends(parser)
    parser.add_argument(
        "--crop",
        type=float,
        metavar="MM",
        help="drop points farther than this from the centre, in mm (default: keep all)",
    )
    parser.add_argument(
        "--rotate",
        type=float,
        default=0.0,
        metavar="DEG",
        help="turn about z in degrees, counter-clockwise seen from +z (default: 0)",
    )
    parser.add_argument(
        "--poisson",
        type=float,
        metavar="NU12",
        help="Poisson's ratio nu12 to note, no unit (default: what the file says, else 0.24)",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace OUT if it exists, but never IN (default: refuse)",
    )
    add_reader_arguments(parser)


def _add_mends(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("mending")
    group.add_argument(
        "--unit",
        action="append",
        default=[],
        metavar="WHAT=UNIT/TAKEN",
        help="the numbers of pressure, reference, displacement, radius or thickness are in UNIT, "
        "where they were taken for TAKEN (bulgefit's own files: MPa and mm), e.g. "
        "pressure=psi/bar or displacement=um/mm; may be given several times",
    )
    group.add_argument(
        "--from-positions",
        action="store_true",
        help="displacement (and that of images at rest) holds deformed positions: take the "
        "reference off",
    )
    group.add_argument(
        "--swap-xy",
        nargs="?",
        const="all",
        choices=("all", "reference", "displacement"),
        help="let x and y change places in these arrays; bare, in all, and the semi-axes of an "
        "elliptic clamp too",
    )
    group.add_argument(
        "--flip",
        metavar="COLUMN,...",
        help="change the sign of some of x, y, z (reference), dx, dy, dz (displacement)",
    )
    group.add_argument(
        "--shift", metavar="X,Y[,Z]", help="add this to the reference positions, in mm"
    )
    group.add_argument(
        "--level",
        action="store_true",
        help="turn and lift the test so that the plane through the rim of its reference is z = 0",
    )
    group.add_argument(
        "--centre",
        choices=("rim", "apex"),
        help="shift the reference so that x = y = 0 is the centre of the circle on which the "
        "heights fall to zero (rim), or the highest point (apex)",
    )
    group.add_argument(
        "--recorded",
        action="store_true",
        help="undo an interpolation straight in pressure: keep the recorded frames, as far as the "
        "interpolated ones tell them",
    )
    group.add_argument(
        "--whole-bins",
        action="store_true",
        help="of points that are means over square bins, given at the bins' centres, leave out "
        "those whose bin the rim or a hole cuts",
    )


def run(args: argparse.Namespace) -> int:
    """Read, mend, crop, turn and write."""
    import math

    from bulgefit.dic import read_test, write_test
    from bulgefit.dic.writers import check_written
    from bulgefit.files import check_apart

    check_apart([args.output], files_read([args.input, args.pressure]))
    check_written(args.output, args.force)
    if not math.isfinite(args.rotate):
        raise InputError(f"--rotate {args.rotate}: give an angle in degrees")
    if args.crop is not None and not args.crop > 0:
        raise InputError(f"--crop {args.crop:g}: give a radius above 0 mm")
    options = reader_options(args)
    test = read_test(
        args.input, poisson_ratio=args.poisson, crop=args.crop, mends=_mends(args), **options
    )
    if args.rotate:
        test = test.rotated(args.rotate)
    if done := _done(args):
        test = test.with_history(f"bulgefit convert {args.input}: {done}")
    write_test(test, args.output, force=args.force)
    warn_of_alarms(args, test)
    _common.progress(
        args,
        f"{args.output}: {test.n_frames} frames, {test.n_points} points, "
        f"{test.pressure.min() * 10:.4g} to {test.pressure.max() * 10:.4g} bar",
    )
    return 0


def _done(args: argparse.Namespace) -> str:
    """The options that changed the numbers, as they were given."""
    said = [] if args.at_rest is None else [f"--at-rest {args.at_rest}"]
    said += [f"--unit {text}" for text in args.unit]
    said += ["--from-positions"] if args.from_positions else []
    for name in ("swap_xy", "flip", "shift"):
        if getattr(args, name) is not None:
            said.append(f"--{name.replace('_', '-')} {getattr(args, name)}")
    said += ["--level"] if args.level else []
    said += [f"--centre {args.centre}"] if args.centre is not None else []
    said += ["--recorded"] if args.recorded else []
    said += ["--whole-bins"] if args.whole_bins else []
    said += [f"--crop {args.crop:g}"] if args.crop is not None else []
    said += [f"--rotate {args.rotate:g}"] if args.rotate else []
    return " ".join(said)


def _mends(args: argparse.Namespace) -> list[Mend]:
    """What is asked for, in the order in which it is done."""
    from bulgefit.dic import mend
    from bulgefit.dic.cut_bins import whole_bins
    from bulgefit.dic.unmix import unmixed

    units = [_unit(text) for text in args.unit]
    mends: list[Mend] = [
        partial(mend.in_unit, quantity=quantity, unit=unit, taken=taken)
        for quantity, unit, taken in units
    ]
    if args.from_positions:
        mends.append(mend.from_positions)
    if args.swap_xy is not None:
        mends.append(partial(mend.swapped, arrays=args.swap_xy))
    if args.flip is not None:
        columns = [name.strip() for name in args.flip.split(",")]
        mend.check_columns(columns)
        mends.append(partial(mend.flipped, columns=columns))
    if args.shift is not None:
        mends.append(partial(mend.shifted, shift=_vector(args.shift)))
    if args.level:
        mends.append(mend.levelled)
    if args.centre is not None:
        mends.append(partial(mend.centred, by=args.centre))
    if args.recorded:
        mends.append(unmixed)
    if args.whole_bins:
        mends.append(whole_bins)
    return mends


def _unit(text: str) -> tuple[str, str, str]:
    """The quantity, the unit of its numbers, and the one they were taken for."""
    from bulgefit.dic import mend

    quantity, equals, units = text.replace(" ", "").partition("=")
    # N/mm^2 has a stroke of its own
    for unit in mend.QUANTITIES.get(quantity, ()):
        if units.startswith(f"{unit}/"):
            taken = units[len(unit) + 1 :]
            mend.scale_of(quantity, unit, taken)
            return quantity, unit, taken
    if not equals or quantity not in mend.QUANTITIES:
        raise InputError(
            f"--unit {text}: give WHAT=UNIT/TAKEN, WHAT one of {', '.join(mend.QUANTITIES)}"
        )
    known = ", ".join(mend.QUANTITIES[quantity])
    raise InputError(
        f"--unit {text}: give {quantity}=UNIT/TAKEN, the unit of the numbers and the one they "
        f"were taken for, each one of {known}"
    )


def _vector(text: str) -> list[float]:
    import math

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
        raise InputError(f"--shift {text}: give X,Y or X,Y,Z in mm, such as 1.5,-2")
    return [*numbers, 0.0][:3]
