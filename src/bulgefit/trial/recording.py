"""How is a made test recorded: at which points and pressures, with what noise, in which form?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.trial.camera import Setting, material_points
from bulgefit.trial.draw import STATED_POISSON_RATIO, Draw
from bulgefit.trial.gauge import recorded_load
from bulgefit.trial.hexagon import FINENESS
from bulgefit.trial.noise import holes, noise

__all__ = ["Recipe", "has_clock", "place", "record"]

Floats = NDArray[np.float64]

_BAR = 0.1  # MPa
#: Effects that go by time: their tests have a clock.
_TIMED = ("creep", "clamp_creep", "camera_drift")
#: Images at rest, where there are any.
_STATIC = 4


@dataclass(frozen=True)
class Recipe:
    """How large made tests are and what they keep; the defaults are those of the blind trial.

    Attributes
    ----------
    frames : int
    spacing : float, mm
        Of the measured points.
    fineness : int
        Of the mesh, a multiple of 8 (`hexagon.hexagon`).
    shrink : float
        Sizes of effects are divided by up to this.
    audible : bool
        A cause that would be lost in the noise is enlarged, up to what was drawn at first.
    static, heights : bool, optional
        Whether images at rest, and heights before inflation, are kept; default: half of the time
        each.
    interpolated : bool
        Half as many frames are recorded, and interpolated to common pressures.
    mounted : float, degree
        Where the warp was mounted; of a family, that of its last specimen.
    """

    frames: int = 20
    spacing: float = 4.6
    fineness: int = FINENESS
    shrink: float = 1.0
    audible: bool = False
    static: bool | None = None
    heights: bool | None = None
    interpolated: bool = False
    mounted: float = 0.0


def place(drawn: Draw, rng: Generator, recipe: Recipe) -> Setting:
    """Points, pressures and times of the frames that are recorded."""
    frames = (recipe.frames + 1) // 2 if recipe.interpolated else recipe.frames
    time = np.cumsum(10.0 * np.exp(rng.normal(0.0, 0.5, size=frames)))
    # two holds at pressure
    holds = rng.choice(np.arange(1, frames), size=2, replace=False)
    for frame in holds:
        time[frame:] += rng.uniform(40.0, 200.0)
    points, pressure = _points(rng, recipe.spacing), _pressures(drawn, rng, frames)
    setting = Setting(points, pressure, time, mounted=drawn.mounted)
    # the camera sees no fabric beyond the clamp
    rim = setting.radius * (1.0 - 0.02)
    inside = np.hypot(*material_points(drawn, setting).T) < rim
    return replace(setting, reference=setting.reference[inside])


def _points(rng: Generator, spacing: float) -> Floats:
    """A jittered square grid (n, 2) mm inside a circle."""
    reach = rng.uniform(94.0, 97.0)
    line = np.arange(-reach - spacing, reach + 2 * spacing, spacing) + rng.uniform(0, spacing)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    grid = grid + rng.uniform(-0.25, 0.25, size=grid.shape) * spacing
    return grid[np.hypot(*grid.T) < reach]


def _pressures(drawn: Draw, rng: Generator, frames: int) -> Floats:
    """Recorded pressures (frames,) MPa, increasing, from a low first one."""
    low, high = rng.uniform(0.03, 0.05), rng.uniform(2.4, 2.9)
    step = (high - low) / (frames - 1)
    bar = low + step * (np.arange(frames) + rng.uniform(-0.35, 0.35, size=frames))
    bar[0], bar[-1] = low, high
    # a gauge that reads too little may not make the first recorded pressure vanish
    true = bar + max(0.0, 0.01 - drawn.get("pressure_offset.offset") - low)
    return recorded_load(drawn, _BAR * true)


def has_clock(drawn: Draw, rng: Generator) -> bool:
    """Whether the times of the frames are kept."""
    return bool(rng.random() < 0.6) or any(effect in drawn.effects for effect in _TIMED)


def record(
    setting: Setting,
    height: Floats,
    seen: Floats,
    size: tuple[float, float],
    rng: Generator,
    name: str,
    recipe: Recipe,
    *,
    timed: bool,
) -> BulgeTest:
    """The test with noise (mm in plane, out of plane) and holes, in the form that is kept."""
    points, frames = setting.reference, len(setting.pressure)
    drawn_static, drawn_kept = rng.random() < 0.5, rng.random() < 0.5
    static = _STATIC if (drawn_static if recipe.static is None else recipe.static) else 0
    kept = drawn_kept if recipe.heights is None else recipe.heights
    errors = noise(rng, points, frames + static, size, float(rng.uniform(8.0, 12.0)))
    seen = seen + errors[:frames]
    seen[holes(rng, points, frames)] = np.nan
    z = height + rng.normal(0.0, size[1], size=len(points)) if kept else np.zeros(len(points))
    pressure, time = setting.pressure, setting.time
    if recipe.interpolated:
        mix = _mixture(pressure, recipe.frames)
        seen = np.einsum("cf,fnk->cnk", mix, seen)
        pressure, time = mix @ pressure, mix @ time
    return BulgeTest.from_arrays(
        np.column_stack([points, z]),
        seen,
        pressure,
        name=name,
        radius=setting.radius,
        thickness=setting.thickness,
        poisson_ratio=STATED_POISSON_RATIO,
        warp_angle=setting.mounted or None,
        static_displacement=errors[frames:] if static else None,
        time=time if timed else None,
    )


def _mixture(recorded: Floats, frames: int) -> Floats:
    """Shares (frames, recorded) of recorded frames in frames at even pressures between them."""
    common = np.linspace(recorded[0], recorded[-1], frames)
    return np.stack([np.interp(common, recorded, one) for one in np.eye(len(recorded))], axis=1)
