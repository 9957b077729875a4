"""bulgefit align: how do I get from a raw cloud of points to a test in the clamp's frame?"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

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
    from bulgefit.dic.align import Pose

    Step = tuple[str, Callable[[BulgeTest], BulgeTest]]

__all__ = ["HELP", "add_arguments", "run"]

HELP = "lay a raw cloud of points into the clamp's frame; bin it, mask it, drop strays"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Turn and shift a bulge test so that the clamp's plane is z = 0 and its centre is\n"
        "x = y = 0, and write it as .npz or HDF5 (.h5, .hdf5), with what was done in it. What is\n"
        "asked for is done in the order of this help. How the test lay before and how it lies\n"
        "afterwards is shown."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit align raw/ test.npz --radius 100 --thickness 0.81 --bin 7\n"
        "  bulgefit align test.npz aligned.npz --marks=-60,2,60,5 --rigid --drop-strays"
    )
    add_test_argument(parser, "input")
    parser.add_argument("output", metavar="OUT", help="file to write: .npz, .h5 or .hdf5")
    _add_steps(parser)
    parser.add_argument(
        "--json",
        metavar="FILE",
        help="also write before, after and steps as JSON; - prints it alone (default: a table)",
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace OUT and FILE if they exist, but never IN (default: refuse)",
    )
    add_reader_arguments(parser)


def _add_steps(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("steps")
    group.add_argument(
        "--no-plane",
        dest="plane",
        action="store_false",
        help="leave the plane as it is (default: that through the outer points becomes z = 0)",
    )
    group.add_argument(
        "--no-centre",
        dest="centre",
        action="store_false",
        help="leave the origin as it is (default: the centre of the circle on which the heights "
        "fall to zero, where it is farther off than its error, or of the outline where they do "
        "not tell)",
    )
    axes = group.add_mutually_exclusive_group()
    axes.add_argument(
        "--angle",
        type=float,
        metavar="DEG",
        help="the warp lies at this angle to x, counter-clockwise seen from +z, in degrees; x "
        "comes to run along it (default: 0)",
    )
    axes.add_argument(
        "--marks",
        metavar="X1,Y1,X2,Y2",
        help="two points on one warp yarn, mm, as they lie once plane and centre are set; x comes "
        "to run along it",
    )
    group.add_argument(
        "--crop", type=float, metavar="MM", help="drop points farther than this from the centre"
    )
    group.add_argument(
        "--mask",
        action="append",
        default=[],
        metavar="X,Y,R",
        help="drop points within R of (X, Y), mm; may be given several times",
    )
    group.add_argument(
        "--drop-strays",
        action="store_true",
        help="mark displacements far off those of their neighbours as lost",
    )
    group.add_argument(
        "--rigid",
        action="store_true",
        help="take the rigid motion of the rim off each frame; a clamp that is stiff and cameras "
        "that stand still have none",
    )
    group.add_argument(
        "--bin",
        type=float,
        metavar="MM",
        help="average the points in squares of this side, images at rest likewise",
    )


def run(args: argparse.Namespace) -> int:
    """Read, align, show and write."""
    from dataclasses import asdict

    from bulgefit.dic import read_test, write_test
    from bulgefit.dic.align import pose_of
    from bulgefit.dic.writers import check_written

    _common.check_outputs(args, files_read([args.input, args.pressure]), [args.output])
    check_written(args.output, args.force)
    steps = _steps(args)
    poses: list[Pose] = []
    said: list[str] = []

    def align(test: BulgeTest) -> BulgeTest:
        poses.append(pose_of(test))
        for line, step in steps:
            test = step(test)
            said.append(line)
        poses.append(pose_of(test))
        return test.with_history(f"bulgefit align {args.input}: {'; '.join(said) or 'nothing'}")

    test = read_test(args.input, mends=[align], **reader_options(args))
    payload = {
        "source": test.source,
        "checksum": test.checksum,
        "output": args.output,
        "steps": said,
        "before": asdict(poses[0]),
        "after": asdict(poses[1]),
        "versions": _common.versions(),
    }
    _common.deliver(
        args,
        payload,
        _table(*poses),
        lambda: write_test(test, args.output, force=args.force),
    )
    warn_of_alarms(args, test)
    return 0


def _steps(args: argparse.Namespace) -> list[Step]:
    """What is asked for, in the order in which it is done, with a word on each."""
    from bulgefit.dic import align, binning, rim_motion

    steps: list[Step] = []
    if args.plane:
        steps.append(("plane through the outer points to z = 0", align.on_plane))
    if args.centre:
        steps.append(("clamp's centre to the origin, if told from it", align.centred))
    if args.angle is not None:
        (angle,) = _numbers("--angle", str(args.angle), 1)
        steps.append((f"turned by {-angle:g} degrees", lambda test: align.along_warp(test, angle)))
    if args.marks is not None:
        marks = _numbers("--marks", args.marks, 4)
        steps.append((f"warp through {args.marks}", lambda test: align.by_marks(test, marks)))
    if args.crop is not None:
        (crop,) = _positive("--crop", args.crop)
        steps.append((f"cropped at {crop:g} mm", lambda test: test.cropped(crop)))
    if args.mask:
        discs = [_numbers("--mask", text, 3) for text in args.mask]
        steps.append((f"without {' '.join(args.mask)}", lambda test: align.masked(test, discs)))
    if args.drop_strays:
        steps.append(("strays lost", align.without_strays))
    if args.rigid:
        steps.append(("rigid motion of the rim taken off", rim_motion.without_rim_motion))
    if args.bin is not None:
        (side,) = _positive("--bin", args.bin)
        steps.append((f"binned at {side:g} mm", lambda test: binning.binned(test, side)))
    return steps


def _numbers(option: str, text: str, count: int) -> list[float]:
    import math

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        what = f"{count} numbers, such as {','.join(['1'] * count)}" if count > 1 else "a number"
        raise InputError(f"{option} {text}: give {what}")
    return numbers


def _positive(option: str, value: float) -> list[float]:
    (number,) = _numbers(option, str(value), 1)
    if not number > 0:
        raise InputError(f"{option} {value:g}: give a length above 0 mm")
    return [number]


def _table(before: Pose, after: Pose) -> str:
    rows: list[tuple[str, Callable[[Pose], str]]] = [
        ("tilt of the outer points", lambda pose: _one(pose.tilt_deg, "degrees")),
        ("height of their plane", lambda pose: _one(pose.height_mm, "mm")),
        ("outline", lambda p: f"{_two(p.outline_centre_mm)}, radius {p.outline_radius_mm:.4g} mm"),
        ("heights' centre", lambda p: _with(_two(p.rim_centre_mm), _two(p.rim_centre_error_mm))),
        ("heights' radius", lambda p: _with(_one(p.rim_radius_mm), _one(p.rim_radius_error_mm))),
        (
            "heights' semi-axes",
            lambda p: _with(_two(p.rim_semi_axes_mm), _two(p.rim_semi_axes_error_mm)),
        ),
        ("rim turns by up to", lambda pose: _one(pose.rim_rotation_deg, "degrees")),
        ("rim shifts by up to", lambda pose: _one(pose.rim_shift_mm, "mm")),
        ("stray displacements", lambda pose: str(pose.strays)),
        ("points", lambda pose: f"{pose.points}, {pose.measured} measured over all frames"),
    ]
    shown = [(name, say(before), say(after)) for name, say in rows]
    width = max(len(was) for _, was, _ in shown)
    lines = [f"{'':<26}{'before':<{width}}  after"]
    return "\n".join([*lines, *(f"{name:<26}{was:<{width}}  {now}" for name, was, now in shown)])


def _one(value: float | None, unit: str = "mm") -> str:
    return "not told" if value is None else f"{value:.4g} {unit}"


def _two(pair: Any) -> str:
    return "not told" if pair is None else f"({pair[0]:.2f}, {pair[1]:.2f}) mm"


def _with(value: str, error: str) -> str:
    return value if value == "not told" else f"{value} ± {error}"
