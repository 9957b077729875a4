"""The five places of a virtual test as effects fill them: shape, clamp, material, load, camera.

Each is a frozen record that starts as the ideal test's; an effect's hook returns it changed
(`dataclasses.replace`). Points of the shape are given on the unit disc, the clamp's radius being 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.fem.clamp import LEAST_COMPLIANCE

__all__ = [
    "KNEE",
    "LEAST_SLIP",
    "MOTION",
    "Clamping",
    "Clock",
    "Cloth",
    "Load",
    "Scene",
    "concave",
]

Floats = NDArray[np.float64]

#: MPa.
_BAR = 0.1
#: Pressure (MPa) of a test that has none, and interval (s) of frames that have none.
_NONE, _INSTANT = 1e-12, 1e-9

#: Effects of the cameras of a higher `order` act on what the moved frame shows.
MOTION = 10

#: Compliance (mm per N/mm) of a clamp that begins to slip: its rim moves by 2e-5 mm.
LEAST_SLIP = 2.0 * LEAST_COMPLIANCE

#: Knee strain of a fabric whose slope does not change there: any value is a null.
KNEE = 0.01


def concave(bar: Floats, shape: float) -> Floats:
    """How far (n,) what pressure moves has gone that goes by 1 a bar at first.

    (1 - exp(-shape p))/shape, shape in 1/bar: its screws stiffen. Below 0, where differences by it
    reach, it goes on as it is.
    """
    return np.asarray(-np.expm1(-shape * bar) / shape if shape != 0.0 else bar)


@dataclass(frozen=True, eq=False)
class Clock:
    """When the frames were taken.

    Attributes
    ----------
    time : (frames,) array, s
    schedule : (recorded,) array, s
        Of all frames that were recorded, of which these may be some: what goes by time does not
        depend on how many are looked at.
    """

    time: Floats
    schedule: Floats

    @property
    def passed(self) -> Floats:
        """Time (frames,) in s since the first frame of all."""
        return np.asarray(self.time - self.schedule.min())

    @property
    def share(self) -> Floats:
        """Share (frames,) of the test's time that has passed."""
        return np.asarray(self.passed / max(float(np.ptp(self.schedule)), _INSTANT))

    @property
    def decades(self) -> Floats:
        """Decades (frames,) of time since the first frame of all, in their median intervals."""
        return self._decades(self.passed)

    @property
    def course(self) -> Floats:
        """The same over those (frames,) of the last frame of all."""
        whole = self._decades(np.ptp(self.schedule))
        return np.asarray(self.decades / max(float(whole), _INSTANT))

    def _decades(self, passed: ArrayLike) -> Floats:
        step = 1.0
        if len(self.schedule) > 1:
            step = max(float(np.median(np.diff(np.sort(self.schedule)))), _INSTANT)
        return np.asarray(np.log10(1.0 + np.maximum(passed, 0.0) / step))


@dataclass(frozen=True, eq=False)
class Cloth:
    """The material's place.

    Attributes
    ----------
    E1, E2, G12 : float, MPa
    nu12 : float
    points : (m, 4, 2) array
        Gauss points on the unit disc.
    angle : float, degree
        Warp axis from x, counter-clockwise seen from +z.
    slack : (2,) tuple
        Stress-free excess log strain along warp, fill.
    gain : (2,) tuple
        Relative change of the secant stiffness per unit strain along warp, fill.
    bend, knee : (2,) tuples
        Relative change of the slope beyond the knee strain, along warp, fill.
    curve : (2, knots) array or None
        Logarithms of the slope of stress along warp, fill, over that at rest, at the strains
        `bulgefit.fem.laws.potential.KNOTS`; None: it is the same everywhere.
    coupling : (2,) tuple
        D13 and D23, over √(E1 G12) and √(E2 G12).
    thickness : (m, 4) array or None
        Stiffness (thickness) of the Gauss points over the nominal one.
    """

    E1: float
    E2: float
    G12: float
    nu12: float
    points: Floats
    angle: float = 0.0
    slack: tuple[float, float] = (0.0, 0.0)
    gain: tuple[float, float] = (0.0, 0.0)
    bend: tuple[float, float] = (0.0, 0.0)
    knee: tuple[float, float] = (KNEE, KNEE)
    curve: Floats | None = None
    coupling: tuple[float, float] = (0.0, 0.0)
    thickness: Floats | None = None

    def thickened(self, factor: Floats) -> Floats:
        """`thickness` times a factor (m, 4)."""
        return factor if self.thickness is None else self.thickness * factor


@dataclass(frozen=True, eq=False)
class Clamping:
    """The clamp's place.

    Attributes
    ----------
    angle : (rim,) array, rad
        Of the rim's nodes, from x.
    pressure : (frames,) array, MPa
        On the clamp.
    clock : Clock or None
        Where the test tells its time.
    compliance : float or None, mm per N/mm
        The rim moves inwards by this times the radial edge traction; None: it is held.
    eased : (frames,) array or None, mm per N/mm
        By how much more the clamp gives in each frame; None: always alike.
    lift : (frames, rim) array or None, mm
        How far the rim has risen; None: it stays.
    inwards : (frames, rim) array or None, mm
        How far the rim has moved towards the centre, beside what its traction makes it; None: it
        stays.
    along : (frames, rim) array or None, mm
        How far it has moved along the edge, counter-clockwise seen from +z; None: it stays.
    """

    angle: Floats
    pressure: Floats
    compliance: float | None = None
    eased: Floats | None = None
    lift: Floats | None = None
    inwards: Floats | None = None
    along: Floats | None = None
    clock: Clock | None = None

    @property
    def loaded(self) -> Floats:
        """Traction of the edge over that at the highest pressure, (frames,).

        Of a flat, linear membrane it goes with p^(2/3) (Hencky, 1915, "Über den Spannungszustand
        in kreisrunden Platten mit verschwindender Biegungssteifigkeit").
        """
        pressure = np.maximum(self.pressure, 0.0)
        return np.asarray(np.cbrt(pressure / max(pressure.max(), _NONE)) ** 2)

    def opened(self, shape: float) -> Floats:
        """How far (frames,) an edge has risen that goes up by 1 a bar at first (`concave`)."""
        return concave(np.maximum(self.pressure, 0.0) / _BAR, shape)

    def giving(self, by: Floats) -> Floats:
        """`eased` and further (frames,) mm per N/mm."""
        return by if self.eased is None else self.eased + by

    def lifted(self, by: Floats) -> Floats:
        """`lift` and further (frames, rim) mm."""
        return by if self.lift is None else self.lift + by

    def pulled(self, by: Floats) -> Floats:
        """`inwards` and further (frames, rim) mm."""
        return by if self.inwards is None else self.inwards + by

    def sheared(self, by: Floats) -> Floats:
        """`along` and further (frames, rim) mm."""
        return by if self.along is None else self.along + by

    @property
    def edge(self) -> Floats | None:
        """Displacement (frames, rim, 3) mm of the rim, or of the springs' ends; None: it stays."""
        if self.lift is None and self.inwards is None and self.along is None:
            return None
        out = np.zeros((len(self.pressure), len(self.angle), 3))
        if self.lift is not None:
            out[..., 2] = self.lift
        if self.inwards is not None:
            out[..., 0] = -self.inwards * np.cos(self.angle)
            out[..., 1] = -self.inwards * np.sin(self.angle)
        if self.along is not None:
            out[..., 0] -= self.along * np.sin(self.angle)
            out[..., 1] += self.along * np.cos(self.angle)
        return out


@dataclass(frozen=True, eq=False)
class Load:
    """The load's place.

    Attributes
    ----------
    recorded : (frames,) array, MPa
    clock : Clock or None
        Where the test tells its time.
    applied : (frames,) array, MPa
        True pressure on fabric and clamp.
    softening : float or (frames,) array
        Stiffness of the fabric over that of the first frame: where it is c, p is balanced as the
        fresh fabric balances p/c.
    """

    recorded: Floats
    clock: Clock | None
    applied: Floats
    softening: Floats | float = 1.0

    @property
    def balanced(self) -> Floats:
        """Pressure (frames,) MPa that the model balances."""
        return np.asarray(self.applied / self.softening)


@dataclass(frozen=True, eq=False)
class Scene:
    """What the cameras look at.

    Attributes
    ----------
    reference : (n, 3) array, mm
        Where the points were seen before inflation.
    position : (n, 2) array, mm
        Where they are in the cameras' frame, the lens undone.
    standing : (n, 3) array, mm
        Where they stand when the frame turns: at the initial height.
    pressure : (frames,) array, MPa
        Applied, on the fixture.
    highest : float, MPa
        Of all frames of the test, of which these may be some.
    radius : float, mm
    turn, shift : (frames, 3) arrays, degree and mm
        Rotation vector and shift of the frame, from all effects together: applied before what the
        cameras make of it (lens, depth, axes).
    elapsed : (frames,) array or None
        Share of the test's time that has passed.
    """

    reference: Floats
    position: Floats
    standing: Floats
    pressure: Floats
    highest: float
    radius: float
    turn: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    shift: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    elapsed: Floats | None = None
