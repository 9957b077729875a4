"""bulgefit info: what is in this test, and what looks wrong?"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from bulgefit.cli import _common
from bulgefit.cli.tests_in import (
    add_reader_arguments,
    add_test_argument,
    files_read,
    reader_options,
)

if TYPE_CHECKING:
    from bulgefit.dic import TestInfo

__all__ = ["HELP", "add_arguments", "run"]

HELP = "show what a bulge test holds and what looks wrong with it"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the verb and its options."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description = (
        "Read and check a bulge test, and show its counts, ranges, coverage and pressures, and\n"
        "what looks wrong: lost or stray points, holes, motion of the camera, unlikely units."
    )
    parser.epilog = (
        "examples:\n"
        "  bulgefit info test.npz\n"
        "  bulgefit info frames/ --radius 100 --thickness 0.81\n"
        "  bulgefit info test.npz --json -"
    )
    add_test_argument(parser)
    parser.add_argument(
        "--json",
        metavar="FILE",
        help="also write the numbers as JSON, lengths in mm, pressures in bar; "
        "- prints the JSON alone (default: the table only)",
    )
    parser.add_argument(
        "--force", action="store_true", help="replace the JSON file if it exists (default: refuse)"
    )
    add_reader_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Read, describe and print."""
    from dataclasses import asdict

    from bulgefit.dic import describe, read_test

    _common.check_outputs(args, files_read([args.test, args.pressure]))
    info = describe(read_test(args.test, **reader_options(args)))
    _common.deliver(args, asdict(info), _table(info))
    return 0


def _table(info: TestInfo) -> str:
    rows = [
        ("test", info.name),
        ("source", info.source),
        ("sha256", info.checksum),
        _clamp(info),
        ("thickness", f"{info.thickness:g} mm"),
        ("nu12", f"{info.poisson_ratio:g}"),
        ("warp", _warp(info)),
        ("frames", _frames(info)),
        ("points", f"{info.n_points} distinct, {_per_frame(info)} a frame"),
        ("measured", f"{info.n_measured} over all frames, {info.n_lost} lost"),
        ("x, y, z", ", ".join(_span(pair) for pair in info.reference_range) + " mm"),
        ("farthest point", f"{info.largest_radius:.4g} mm from the centre"),
        ("dx, dy, dz", ", ".join(_span(pair) for pair in info.displacement_range) + " mm"),
        ("coverage", f"{info.coverage:.0%} of the disc; quadrants {_quadrants(info)}"),
        ("pressure", _pressure(info)),
        ("apex", _apex(info)),
        ("images at rest", _static(info)),
    ]
    if info.duration_s is not None:
        rows.append(("duration", f"{info.duration_s:.4g} s"))
    rows += [("history", line) for line in info.history]
    lines = [f"{key:<15} {value}" for key, value in rows]
    lines.append("looks wrong:" if info.warnings else "nothing looks wrong")
    for warning in info.warnings:
        lines += [f"  - {warning.text} [{warning.code}]", f"    {warning.remedy}"]
    return "\n".join(lines)


def _clamp(info: TestInfo) -> tuple[str, str]:
    if info.semi_axes is None:
        return "clamp radius", f"{info.radius:g} mm"
    along_x, along_y = info.semi_axes
    return "clamp semi-axes", f"{along_x:g} mm along x, {along_y:g} along y"


def _warp(info: TestInfo) -> str:
    if info.warp_angle is None:
        return "along x; nothing says otherwise"
    return f"at {info.warp_angle:g} degree to x"


def _frames(info: TestInfo) -> str:
    shared = "at common points" if info.n_blocks == 1 else "each with points of its own"
    return f"{info.n_frames}, {shared}"


def _per_frame(info: TestInfo) -> str:
    low, high = min(info.points_per_frame), max(info.points_per_frame)
    return f"{low}" if low == high else f"{low} to {high}"


def _span(pair: tuple[float, float] | None) -> str:
    return "not measured" if pair is None else f"{_plain(pair[0])} to {_plain(pair[1])}"


def _plain(number: float) -> str:
    return f"{number + 0.0:.4g}"  # not -0


def _quadrants(info: TestInfo) -> str:
    return ", ".join(f"{part:.0%}" for part in info.coverage_quadrants)


def _pressure(info: TestInfo) -> str:
    low, high = min(info.pressure_bar), max(info.pressure_bar)
    trend = "increasing" if info.pressure_increases else "not increasing throughout"
    return f"{low:.4g} to {high:.4g} bar, {trend}"


def _apex(info: TestInfo) -> str:
    known = [rise for rise in info.apex_mm if rise is not None]
    if not known:
        return "-"
    return f"dz {_plain(known[0])} mm at the first frame, {_plain(known[-1])} at the last"


def _static(info: TestInfo) -> str:
    if info.static_noise_mm is None:
        return str(info.n_static) if info.n_static else "none"
    noise = ", ".join("-" if value is None else f"{value:.2g}" for value in info.static_noise_mm)
    return f"{info.n_static}, noise of dx, dy, dz {noise} mm"
