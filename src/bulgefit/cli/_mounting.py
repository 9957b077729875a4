"""How is a simulated membrane mounted: as options say, as a result's tests were, or as usual?"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bulgefit.cli._common import progress
from bulgefit.cli._effects import found_tests
from bulgefit.errors import InputError

__all__ = ["Mounting", "mounting_from"]

_USUAL_RADIUS, _USUAL_THICKNESS = 100.0, 0.81  # mm


@dataclass(frozen=True)
class Mounting:
    """Clamp, thickness and warp.

    Attributes
    ----------
    axes : list of float, or None
        Semi-axes of the clamp along x and y, mm; None where nothing says them.
    thickness : float
        mm.
    angle : float
        From x to the warp, degree.
    """

    axes: list[float] | None
    thickness: float
    angle: float

    @property
    def radius(self) -> float:
        """Mean of the semi-axes, mm."""
        return _USUAL_RADIUS if self.axes is None else 0.5 * sum(self.axes)

    @property
    def semi_axes(self) -> list[float] | None:
        """Along x and y, mm, of an ellipse; None of a circle."""
        return None if self.axes is None or self.axes[0] == self.axes[1] else self.axes

    @property
    def ellipticity(self) -> float:
        """The semi-axes are radius (1 + ellipticity) along x and radius (1 - ellipticity)."""
        if self.semi_axes is None:
            return 0.0
        a, b = self.semi_axes
        return (a - b) / (a + b)


def mounting_from(args: argparse.Namespace) -> Mounting:
    """Of --radius, --semi-axes, --mesh, --thickness and --angle, else of --from.

    Raises
    ------
    InputError
        An option means nothing, or the tests of --from differ in what no option says.
    """
    axes = _clamp(args)
    thickness, angle = _positive(args.thickness, "--thickness"), args.angle
    if angle is not None and not math.isfinite(angle):
        raise InputError(f"--angle {angle:g}: give an angle in degrees")
    if args.from_file is not None:
        tests = found_tests(Path(args.from_file))
        if axes is None and args.mesh is None:
            option, usual = "--radius or --semi-axes", f"{_USUAL_RADIUS:g} mm"
            axes = _told(args, tests, "semi_axes_mm", option, usual)
        if thickness is None:
            option, usual = "--thickness", f"{_USUAL_THICKNESS:g} mm"
            thickness = _one(_told(args, tests, "thickness_mm", option, usual))
        if angle is None:
            # tests that do not say have the warp along x
            tests = [{"warp_angle_degree": 0.0, **test} for test in tests or [{}]]
            angle = _one(_told(args, tests, "warp_angle_degree", "--angle", "0 degree"))
    return Mounting(axes, _USUAL_THICKNESS if thickness is None else thickness, angle or 0.0)


def _clamp(args: argparse.Namespace) -> list[float] | None:
    """Semi-axes (mm), if options give them."""
    radius = _positive(args.radius, "--radius")
    if args.semi_axes is None:
        return None if radius is None else [radius, radius]
    for option in ("radius", "mesh"):
        if getattr(args, option) is not None:
            raise InputError(f"--semi-axes: does not go with --{option}, which says the clamp, too")
    for axis in args.semi_axes:
        _positive(axis, "--semi-axes")
    return list(args.semi_axes)


def _one(told: list[float] | None) -> float | None:
    return None if told is None else told[0]


def _positive(value: float | None, name: str) -> float | None:
    if value is not None and not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{name} {value:g}: give a length above 0 mm")
    return value


def _told(
    args: argparse.Namespace, tests: list[dict[str, Any]], key: str, option: str, usual: str
) -> list[float] | None:
    """The numbers that all tests of --from have by that key; None, told, where it has none."""
    where = f"--from {args.from_file}: {key} of its tests"
    if not tests or any(key not in test for test in tests):
        progress(args, f"warning: {where} is not told, {usual} is taken; give {option}")
        return None
    numbers = [_numbers(test[key], key) for test in tests]
    if any(own is None for own in numbers):
        raise InputError(f"{where} is not as it was written; give {option}")
    if any(own != numbers[0] for own in numbers):
        shown = ", ".join(str(test[key]) for test in tests)
        raise InputError(f"{where} differs ({shown}); give {option}")
    return numbers[0]


def _numbers(told: Any, key: str) -> list[float] | None:
    """What that key has, as finite numbers, lengths above 0; None where it is something else."""
    items = told if isinstance(told, list) else [told]
    known = all(
        isinstance(one, int | float)
        and not isinstance(one, bool)
        and math.isfinite(one)
        and (one > 0.0 or not key.endswith("_mm"))
        for one in items
    )
    wanted = 2 if key.startswith("semi_axes") else 1
    return [float(one) for one in items] if known and len(items) == wanted else None
