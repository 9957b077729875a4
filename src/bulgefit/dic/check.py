"""Can these data be a bulge test? Every reason why not is one line of advice."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.units import PRESSURE
from bulgefit.errors import InputError

if TYPE_CHECKING:
    from bulgefit.dic.bulge_test import Block, BulgeTest

__all__ = ["check", "check_lengths", "check_pressure_unit"]

Floats = NDArray[np.floating]

# Points may lie this far outside the clamp, relative to its radius: rounding and registration.
_OUTSIDE = 1.001
# A gauge may be off by this part of the highest pressure, so that it reads below zero at rest.
_BELOW_ZERO = 0.05
# The highest pressure of a test lies between these, MPa: no fabric holds more, and a number above
# it is in another unit.
_POSSIBLE_PRESSURE = (0.01, 10.0)


def check(test: BulgeTest) -> None:
    """Refuse what cannot be a bulge test in mm and MPa.

    Raises
    ------
    InputError
        Specimen, pressures, times or points cannot be; the message says where and what to do.
    """
    _check_specimen(test)
    _check_pressure(test)
    _check_time(test)
    for block in test.blocks:
        _check_displacement(test, block)
    if not any(block.measured.any() for block in test.blocks):
        raise InputError(f"{_where(test)}: all points are lost in every frame; nothing to fit")
    _check_static(test)
    _check_clamp(test)


def check_pressure_unit(pressure: Floats, unit: str, where: str) -> None:
    """Raise InputError where the pressures are too high for the unit they were given in.

    Parameters
    ----------
    pressure : (frames,) array, MPa
    unit : str
        The unit of the file (or of the caller), one of `bulgefit.dic.units.PRESSURE`.
    where : str
        File, for the message.
    """
    lowest, highest = _POSSIBLE_PRESSURE
    largest = float(pressure[np.isfinite(pressure)].max(initial=0.0))
    if largest > highest:
        number = largest / PRESSURE[unit]
        usual = ("Pa", "kPa", "bar", "MPa")
        likely = [name for name in usual if lowest <= number * PRESSURE[name] <= highest]
        looks = f", it looks like {' or '.join(likely)}" if likely else ""
        raise InputError(f"{where}: pressure {number:g} {unit} cannot be{looks}; give {unit}")


def check_lengths(radius: float, thickness: float, where: str) -> None:
    """Raise InputError where radius or thickness (mm) look like another unit's.

    Parameters
    ----------
    radius, thickness : float, mm
    where : str
        File, or whose they are, for the message.
    """
    if not 0 < radius < np.inf:
        raise InputError(f"{where}: radius {radius:g} mm must be positive; give the clamp's radius")
    if radius < 1:
        raise InputError(
            f"{where}: radius {radius:g} mm is too small, it looks like metres; give mm (--radius)"
        )
    if radius > 10_000:
        raise InputError(
            f"{where}: radius {radius:g} mm is too large, it looks like micrometres; "
            "give mm (--radius)"
        )
    if not 0 < thickness < np.inf:
        raise InputError(f"{where}: thickness {thickness:g} mm must be positive")
    if thickness < 1e-3:
        raise InputError(
            f"{where}: thickness {thickness:g} mm is too small, it looks like metres; "
            "give mm (--thickness)"
        )
    if thickness > radius / 2:
        raise InputError(
            f"{where}: thickness {thickness:g} mm is more than half the radius {radius:g} mm, it "
            "looks like micrometres; give mm (--thickness)"
        )


def _check_specimen(test: BulgeTest) -> None:
    where, nu = _where(test), test.poisson_ratio
    check_lengths(test.radius, test.thickness, where)
    if not abs(test.ellipticity) < 1:
        raise InputError(f"{where}: ellipticity {test.ellipticity:g} must lie between -1 and 1")
    if not np.isfinite(test.warp_angle or 0.0):
        raise InputError(f"{where}: warp_angle {test.warp_angle:g} must be a number of degrees")
    # of a sheet its square is below E1/E2: what is beyond is a number of per cent, or none
    if not abs(nu) < 2:
        raise InputError(f"{where}: poisson_ratio {nu:g} must lie between -2 and 2")


def _check_pressure(test: BulgeTest) -> None:
    where, pressure = _where(test), test.pressure
    if not len(pressure):
        raise InputError(f"{where}: no pressure, hence no frame; a test needs at least one")
    bad = np.flatnonzero(~np.isfinite(pressure))
    if len(bad):
        raise InputError(
            f"{where}: pressure of frame {bad[0]} is {pressure[bad[0]]} (frames count from 0; "
            f"{len(bad)} not finite); give it or leave the frame out"
        )
    check_pressure_unit(pressure, "MPa", where)
    highest, lowest = float(pressure.max()), float(pressure.min())
    if highest <= 0:
        raise InputError(
            f"{where}: no frame is under pressure (highest {_bar(highest)}); "
            "inflation pressures are positive"
        )
    if lowest < -_BELOW_ZERO * highest:
        raise InputError(
            f"{where}: pressure of frame {int(pressure.argmin())} is negative ({_bar(lowest)}; "
            "frames count from 0), more than a gauge's offset; leave the frame out or correct it"
        )


def _check_time(test: BulgeTest) -> None:
    if test.time is None:
        if test.schedule is not None:
            raise InputError(
                f"{_where(test)}: schedule tells when frames were recorded, but no time tells "
                "which of them these are; give time too, or leave schedule out"
            )
        return
    if len(test.time) != test.n_frames:
        raise InputError(
            f"{_where(test)}: time has {len(test.time)} values for {test.n_frames} frames; "
            "every frame needs one"
        )
    bad = np.flatnonzero(~np.isfinite(test.time))
    if len(bad):
        raise InputError(
            f"{_where(test)}: time of frame {bad[0]} is {test.time[bad[0]]}; give it in s, or "
            "leave time out"
        )
    _check_schedule(test, test.time)


def _check_schedule(test: BulgeTest, time: Floats) -> None:
    """Times of all frames that were recorded: those of the test's own are among them."""
    schedule = np.asarray(test.schedule)
    within = len(schedule) and schedule.min() <= time.min() and time.max() <= schedule.max()
    if not (within and len(schedule) >= len(time) and np.isfinite(schedule).all()):
        raise InputError(
            f"{_where(test)}: schedule is no list of the times of all frames that were recorded, "
            f"in s, among them the {len(time)} of this test; correct it, or leave it out"
        )


def _check_displacement(test: BulgeTest, block: Block) -> None:
    displacement = block.displacement
    if np.isinf(displacement).any():
        row, point = np.argwhere(np.isinf(displacement))[0, :2]
        raise InputError(
            f"{_where(test)}: displacement of point {point} in frame {block.frames[row]} is "
            "infinite; write NaN where a point is lost"
        )
    # fmax and fmin pass over NaN without a warning where all is NaN
    largest = np.fmax.reduce(np.abs(displacement), axis=None, initial=0.0)
    if largest > 2 * test.radius:
        row, point = np.argwhere(np.abs(displacement) == largest)[0, :2]
        raise InputError(
            f"{_where(test)}: displacement {largest:g} mm of point {point} in frame "
            f"{block.frames[row]} is more than the clamp's diameter {2 * test.radius:g} mm; "
            "give mm, and NaN where a point is lost"
        )


def _check_static(test: BulgeTest) -> None:
    static = test.static_displacement
    if static is None:
        return
    if not np.isfinite(static).any():
        raise InputError(
            f"{_where(test)}: static_displacement holds no measured point; leave it out"
        )
    if np.fmax.reduce(np.abs(static), axis=None) > 2 * test.radius:
        raise InputError(
            f"{_where(test)}: static_displacement exceeds the clamp's diameter; give mm, and NaN "
            "where a point is lost"
        )


def _check_clamp(test: BulgeTest) -> None:
    worst, outside = 0.0, 0
    for block in test.blocks:
        points = block.reference[block.measured.any(axis=0)]
        far = np.hypot(*test.on_circle(points).T) > _OUTSIDE * test.radius
        outside += int(far.sum())
        worst = max(worst, float(np.hypot(*points[far, :2].T).max(initial=0.0)))
    if outside:
        clamp = f"clamp radius is {test.radius:g} mm; correct the radius"
        if test.ellipticity:
            a, b = test.semi_axes
            clamp = f"clamp's semi-axes are {a:g} and {b:g} mm; correct them"
        raise InputError(
            f"{_where(test)}: {outside} points lie outside the clamp, at up to r = {worst:.4g} mm "
            f"where the {clamp}, or drop them with bulgefit convert --crop {min(test.semi_axes):g}"
        )


def _bar(pressure: float) -> str:
    return f"{pressure * 10:.4g} bar"


def _where(test: BulgeTest) -> str:
    return test.source or test.name
