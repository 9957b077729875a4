"""What the clamp does: the rim's shape, its springs, and how it creeps and lifts by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.clamp import LEAST_COMPLIANCE, Clamp
from bulgefit.trial.draw import Draw
from bulgefit.trial.gauge import true_load

__all__ = ["Course", "course_of", "decades", "degrees_apart", "lift", "positions", "soften_sector"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Course:
    """What each frame of a test asks of the fabric and the clamp.

    Attributes
    ----------
    pressure : (frames,) array, MPa
        True.
    soft : (frames,) array
        Stiffness over that of the first frame.
    compliance : (frames,) array, mm per N/mm, or None
        Of a clamp that slips, or may.
    lift : (frames,) array, mm
        Of the edge where it rises most.
    """

    pressure: Floats
    soft: Floats
    compliance: Floats | None
    lift: Floats

    @property
    def steady(self) -> bool:
        """Whether all frames lie on one path in pressure."""
        slips = self.compliance is not None and np.ptp(self.compliance) > 0.0
        return not (slips or self.lift.any() or np.ptp(self.soft) > 0.0)


def course_of(drawn: Draw, recorded: Floats, time: Floats) -> Course:
    """The course of a test whose frames have these recorded pressures (MPa) and times (s)."""
    pressure, bar = true_load(drawn, recorded), 10.0 * true_load(drawn, recorded)
    compliance = None
    if {"clamp_slip", "clamp_creep", "slipping_sector"} & {*drawn.effects}:
        more = drawn.get("clamp_creep.compliance") * decades(time)
        compliance = drawn.get("clamp_slip.compliance") + more
    # a plate that lifts off: stiff once it has moved, (1 - exp(-s p))/s, at first p
    shape = drawn.get("rim_lift.shape", 1.0)
    rise = drawn.get("rim_lift.amplitude") * -np.expm1(-bar * shape) / shape
    return Course(pressure, 1.0 - drawn.get("creep.rate") * decades(time), compliance, rise)


def decades(time: Floats) -> Floats:
    """Decades (frames,) of time under load, 0 in the first frame.

    Their clock starts at the first frame and counts median intervals of frames.
    """
    return np.log10(1.0 + (time - time[0]) / float(np.median(np.diff(time))))


def positions(drawn: Draw, unit: Floats, radius: float) -> Floats:
    """Stress-free positions (n, 3) mm of points of the unit disc."""
    x, y = unit.T
    square = x * x + y * y
    oval = drawn.get("clamp_shape.ellipticity")
    axes = (1.0 + drawn.get("clamp_shape.radius_error")) * np.array([1.0 + oval, 1.0 - oval])
    # ρ³ cos 3φ and ρ³ sin 3φ are smooth at the centre
    cube = (x + 1j * y) ** 3
    lobes = 1.0 + drawn.get("clamp_lobes.c3") * cube.real + drawn.get("clamp_lobes.s3") * cube.imag
    height = [drawn.get(f"initial_shape.{n}") for n in ("h0", "hx", "hy", "c2", "s2", "h2")]
    modes = np.stack([np.ones_like(x), x, y, x * x - y * y, 2.0 * x * y, square])
    z = (1.0 - square) * (height @ modes)
    return np.column_stack([radius * lobes[:, None] * unit * axes, z])


def lift(drawn: Draw, unit: Floats) -> Floats:
    """Share (n,) of the lift at points of the unit circle: max(0, cos(φ - direction))."""
    turn = np.deg2rad(drawn.get("rim_lift.direction"))
    return np.maximum(0.0, unit @ [np.cos(turn), np.sin(turn)])


def degrees_apart(degrees: Floats, middle: float) -> Floats:
    """Degrees between directions and a middle one, 0 to 180."""
    return np.abs((degrees - middle + 180.0) % 360.0 - 180.0)


def soften_sector(clamp: Clamp, drawn: Draw, even: float) -> None:
    """Add a sector's compliance to the springs of a rim whose own is `even` (mm per N/mm)."""
    degrees = np.rad2deg(np.arctan2(clamp.radial[:, 1], clamp.radial[:, 0]))
    away = degrees_apart(degrees, drawn.get("slipping_sector.middle"))
    half = drawn.get("slipping_sector.half_width")
    share = np.cos(0.5 * np.pi * np.minimum(away / half, 1.0)) ** 2
    before = max(even, LEAST_COMPLIANCE)
    after = np.maximum(even + share * drawn.get("slipping_sector.compliance"), LEAST_COMPLIANCE)
    change = clamp.length / after - clamp.length / before
    clamp.stiffness += change[:, None, None] * clamp.radial[:, :, None] * clamp.radial[:, None, :]
