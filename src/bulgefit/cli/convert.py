"""bulgefit convert: how do I bring a measured test into bulgefit's own files?"""

from __future__ import annotations

import argparse

from bulgefit.cli import _common
from bulgefit.cli.tests_in import add_reader_arguments, reader_options
from bulgefit.errors import InputError

__all__ = ["HELP", "add_arguments", "run"]

HELP = "convert a bulge test to .npz or .h5; turn and crop it on the way"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Read a bulge test of any known format, check it, and write it as .npz or HDF5 (.h5,\n"
        ".hdf5). Points are cropped first, then the test is turned."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit convert frames/ test.npz --radius 100 --thickness 0.81 --columns x=X,y=Y\n"
        "  bulgefit convert study.npy test.h5 --crop 98\n"
        "  bulgefit convert test.npz turned.npz --rotate 90"
    )
    parser.add_argument(
        "input", metavar="IN", help="test to read: a file or a folder of CSV frames"
    )
    parser.add_argument("output", metavar="OUT", help="file to write: .npz, .h5 or .hdf5")
    parser.add_argument(
        "--rotate",
        type=float,
        default=0.0,
        metavar="DEG",
        help="turn about z in degrees, counter-clockwise seen from +z (default: 0)",
    )
    parser.add_argument(
        "--crop",
        type=float,
        metavar="MM",
        help="drop points farther than this from the centre, in mm (default: keep all)",
    )
    parser.add_argument(
        "--poisson",
        type=float,
        metavar="NU12",
        help="Poisson's ratio nu12 to note, no unit (default: what the file says, else 0.24)",
    )
    parser.add_argument(
        "--force", action="store_true", help="replace OUT if it exists (default: refuse)"
    )
    add_reader_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Read, crop, turn and write."""
    import math

    from bulgefit.dic import read_test, write_test
    from bulgefit.files import check_output

    check_output(args.output, args.force)
    if not math.isfinite(args.rotate):
        raise InputError(f"--rotate {args.rotate}: give an angle in degrees")
    if args.crop is not None and not args.crop > 0:
        raise InputError(f"--crop {args.crop:g}: give a radius above 0 mm")
    test = read_test(args.input, poisson_ratio=args.poisson, crop=args.crop, **reader_options(args))
    if args.rotate:
        test = test.rotated(args.rotate)
    write_test(test, args.output, force=args.force)
    _common.progress(
        args,
        f"{args.output}: {test.n_frames} frames, {test.n_points} points, "
        f"{test.pressure.min() * 10:.4g} to {test.pressure.max() * 10:.4g} bar",
    )
    return 0
