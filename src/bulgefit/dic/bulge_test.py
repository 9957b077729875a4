"""What a bulge test is: points, displacements and pressures of one specimen."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.dic import assemble
from bulgefit.dic.check import check
from bulgefit.dic.frames import dataframe, labelled
from bulgefit.errors import InputError
from bulgefit.parallel.parcels import sent_once
from bulgefit.shown import Drawn

__all__ = ["Block", "BulgeTest"]

Floats = NDArray[np.floating]


@sent_once
@dataclass(frozen=True, eq=False)
class Block:
    """Frames that were measured at the same points. Its arrays are read-only.

    Attributes
    ----------
    reference : (n, 3) array, mm
        Positions of the points before inflation.
    frames : (k,) int array
        Indices of the frames of the test, ascending.
    displacement : (k, n, 3) array, mm
        NaN where a point (or one of its components) was lost.
    """

    reference: Floats
    frames: NDArray[np.intp]
    displacement: Floats

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, _read_only(getattr(self, item.name)))

    def __reduce__(self) -> tuple[Any, ...]:
        # through the constructor, because a pickled array forgets that it is read-only
        return Block, (self.reference, self.frames, self.displacement)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(k, n) array: whether any component of the point was measured in the frame."""
        return np.asarray(np.isfinite(self.displacement).any(axis=2))


@dataclass(frozen=True, eq=False)
class BulgeTest(Drawn):
    """One measured (or made) bulge inflation test.

    A test whose frames share their points is one block; where every frame has points of its own
    it is a block a frame (and a frame without any point is in no block). Code above this floor
    loops over `blocks` and never asks which. Build a test with `from_arrays` or `from_frames`,
    which check it; the constructor does not.

    Attributes
    ----------
    name : str
    blocks : tuple of Block
    pressure : (frames,) array, MPa
    radius, thickness : float, mm
        Clamp radius and nominal thickness.
    ellipticity : float
        The clamp's semi-axes are radius (1 + ellipticity) along x and radius (1 - ellipticity)
        along y; 0 where it is a circle.
    poisson_ratio : float
        nu12 that a fit holds fixed unless it is freed.
    static_displacement : (m, n, 3) array, mm, or None
        Repeated images at rest, at the points of the only block: the noise alone.
    time : (frames,) array, s, or None
    schedule : (recorded,) array, s, or None
        Times of all frames that were recorded, also those that are left out since.
    warp_angle : float, degree, or None
        Where the warp was mounted: its angle to x, counter-clockwise seen from +z, -180 to 180.
        None where nothing is said of it: x is the warp, however the axes are turned.
    source, checksum : str
        Where the test was read from, and the SHA-256 of what was read ("" if made in memory).
    history : tuple of str
        What was done to it before, one line each; it is written into files.
    """

    name: str
    blocks: tuple[Block, ...]
    pressure: Floats
    radius: float = 100.0
    thickness: float = 0.81
    poisson_ratio: float = 0.24
    static_displacement: Floats | None = None
    time: Floats | None = None
    source: str = ""
    checksum: str = ""
    history: tuple[str, ...] = ()
    ellipticity: float = 0.0
    schedule: Floats | None = None
    warp_angle: float | None = None

    def __post_init__(self) -> None:
        if self.schedule is None:
            object.__setattr__(self, "schedule", self.time)
        if self.warp_angle is not None and math.isfinite(self.warp_angle):
            object.__setattr__(self, "warp_angle", math.remainder(self.warp_angle, 360.0))
        for key in ("pressure", "static_displacement", "time", "schedule"):
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, _read_only(value))

    def __reduce__(self) -> tuple[Any, ...]:
        return BulgeTest, tuple(getattr(self, item.name) for item in fields(self))

    @classmethod
    def from_arrays(
        cls,
        reference: ArrayLike,
        displacement: ArrayLike,
        pressure: ArrayLike,
        *,
        name: str = "test",
        radius: float = 100.0,
        thickness: float = 0.81,
        poisson_ratio: float = 0.24,
        static_displacement: ArrayLike | None = None,
        time: ArrayLike | None = None,
        schedule: ArrayLike | None = None,
        source: str = "",
        checksum: str = "",
        history: Sequence[str] = (),
        ellipticity: float = 0.0,
        warp_angle: float | None = None,
        crop: float | None = None,
        mends: Sequence[Callable[[BulgeTest], BulgeTest]] = (),
    ) -> BulgeTest:
        """Make a checked test whose frames share their points. The arrays are copied.

        Parameters
        ----------
        reference : (n, 3) array_like, mm
        displacement : (frames, n, 3) array_like, mm
            NaN where lost; float32 is kept, everything else becomes float64.
        pressure : (frames,) array_like, MPa
        name : str
        radius, thickness : float, mm
        poisson_ratio : float
        static_displacement : (m, n, 3) array_like, mm, optional
        time : (frames,) array_like, s, optional
        schedule : (recorded,) array_like, s, optional
            Times of all frames that were recorded, where others are left out; default: `time`.
        source, checksum : str
        history : sequence of str
        ellipticity : float
        warp_angle : float, degree, optional
            See the attribute.
        crop : float, mm, optional
            Points farther than this from the centre are left out before the test is checked.
        mends : sequence of callables, optional
            Each takes the test and gives back a better one, before it is cropped and checked.

        Raises
        ------
        InputError
            The arrays are not a bulge test (see `bulgefit.dic.check.check`).
        """
        where = source or name
        load = assemble.per_frame(pressure, "pressure", where)
        points, moved, static = assemble.common_points(
            reference, displacement, static_displacement, where
        )
        if len(moved) != len(load):
            raise InputError(
                f"{where}: displacement has {len(moved)} frames and pressure {len(load)}; "
                "every frame needs one pressure"
            )
        test = cls(
            name=name,
            blocks=(Block(points, np.arange(len(load)), moved),),
            pressure=load,
            radius=float(radius),
            thickness=float(thickness),
            poisson_ratio=float(poisson_ratio),
            static_displacement=static,
            time=None if time is None else assemble.per_frame(time, "time", where),
            schedule=None if schedule is None else assemble.per_frame(schedule, "schedule", where),
            source=source,
            checksum=checksum,
            history=tuple(history),
            ellipticity=float(ellipticity),
            warp_angle=None if warp_angle is None else float(warp_angle),
        )
        return test._checked(crop, mends)

    @classmethod
    def from_frames(
        cls,
        frames: Sequence[tuple[ArrayLike, ArrayLike]],
        pressure: ArrayLike,
        *,
        name: str = "test",
        radius: float = 100.0,
        thickness: float = 0.81,
        poisson_ratio: float = 0.24,
        time: ArrayLike | None = None,
        schedule: ArrayLike | None = None,
        source: str = "",
        checksum: str = "",
        history: Sequence[str] = (),
        ellipticity: float = 0.0,
        warp_angle: float | None = None,
        crop: float | None = None,
        mends: Sequence[Callable[[BulgeTest], BulgeTest]] = (),
    ) -> BulgeTest:
        """Make a checked test whose frames may have points of their own.

        Where the distinct reference points are at most 1.5 times those of the largest frame, the
        frames become one block with NaN for lost points; otherwise every frame is a block.

        Parameters
        ----------
        frames : sequence of ((n_i, 3) array_like, (n_i, 3) array_like), mm
            Reference and displacement of each frame; points without a position or without any
            measured component are dropped.
        pressure : (frames,) array_like, MPa
        name, radius, thickness, poisson_ratio, time, schedule
            As in `from_arrays`.
        source, checksum, history, ellipticity, warp_angle, crop, mends
            As in `from_arrays`.

        Raises
        ------
        InputError
            The frames are not a bulge test (see `bulgefit.dic.check.check`).
        """
        where = source or name
        load = assemble.per_frame(pressure, "pressure", where)
        if len(frames) != len(load):
            raise InputError(
                f"{where}: {len(frames)} frames and {len(load)} pressures; "
                "every frame needs one pressure"
            )
        test = cls(
            name=name,
            blocks=tuple(Block(*parts) for parts in assemble.own_points(frames, where)),
            pressure=load,
            radius=float(radius),
            thickness=float(thickness),
            poisson_ratio=float(poisson_ratio),
            time=None if time is None else assemble.per_frame(time, "time", where),
            schedule=None if schedule is None else assemble.per_frame(schedule, "schedule", where),
            source=source,
            checksum=checksum,
            history=tuple(history),
            ellipticity=float(ellipticity),
            warp_angle=None if warp_angle is None else float(warp_angle),
        )
        return test._checked(crop, mends)

    def __repr__(self) -> str:
        low, high = 10.0 * float(self.pressure.min()), 10.0 * float(self.pressure.max())
        return (
            f"BulgeTest({self.name!r}: {self.n_frames} frames from {low:.4g} to {high:.4g} bar, "
            f"{self.n_points} points, {self.n_measured} measured, radius {self.radius:g} mm, "
            f"thickness {self.thickness:g} mm)"
        )

    def to_dict(self) -> dict[str, Any]:
        """What the test is, without its points, as JSON types."""
        return {
            "name": self.name,
            "frames": self.n_frames,
            "points": self.n_points,
            "measured": self.n_measured,
            "pressure_bar": (10.0 * self.pressure).tolist(),
            "time_s": None if self.time is None else self.time.tolist(),
            "apex_mm": [float(w) if np.isfinite(w) else None for w in self.apex_displacement],
            "radius_mm": self.radius,
            "thickness_mm": self.thickness,
            "poisson_ratio": self.poisson_ratio,
            "warp_angle_degree": self.warp_angle,
            "source": self.source,
            "sha256": self.checksum,
            "history": list(self.history),
        }

    def to_dataframe(self) -> Any:
        """A row a measured point and frame, lengths in mm; needs `bulgefit[pandas]`."""
        parts = []
        for frame in range(self.n_frames):
            reference, displacement = self.frame(frame)
            load = np.full((len(reference), 2), (frame, 10.0 * self.pressure[frame]))
            parts.append(np.hstack([load, reference, displacement]))
        columns = ["frame", "pressure_bar", "x_mm", "y_mm", "z_mm", "dx_mm", "dy_mm", "dz_mm"]
        table = dict(zip(columns, np.concatenate(parts).T, strict=True))
        return dataframe({**table, "frame": table["frame"].astype(np.int64)})

    def to_xarray(self) -> Any:
        """Displacement (mm) by frame, point and component, of a test of one block.

        Needs `bulgefit[xarray]`.

        Raises
        ------
        InputError
            Frames have points of their own, or xarray is not installed.
        """
        if len(self.blocks) != 1:
            raise InputError(
                f"{self.name}: its frames have points of their own; to_dataframe takes such"
            )
        (block,) = self.blocks
        return labelled(
            block.displacement,
            ("frame", "point", "component"),
            {
                "frame": block.frames,
                "component": ["dx", "dy", "dz"],
                "pressure_bar": ("frame", 10.0 * self.pressure[block.frames]),
                **{f"{a}_mm": ("point", block.reference[:, i]) for i, a in enumerate("xyz")},
            },
            name="displacement",
            unit="mm",
        )

    @property
    def stretch(self) -> NDArray[np.float64]:
        """(2,) array: the clamp's semi-axes along x and y over its radius."""
        return np.array([1.0 + self.ellipticity, 1.0 - self.ellipticity])

    @property
    def semi_axes(self) -> NDArray[np.float64]:
        """(2,) array, mm: the clamp's semi-axes along x and y."""
        return np.asarray(self.radius * self.stretch)

    def on_circle(self, points: Floats) -> NDArray[np.float64]:
        """Positions (n, 2) mm of points (n, 2 or 3) where the clamp's ellipse is a circle."""
        return np.asarray(points[:, :2] / self.stretch, dtype=np.float64)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.pressure)

    @cached_property
    def n_points(self) -> int:
        """Number of distinct points over all frames, lost ones included."""
        if len(self.blocks) == 1:
            return len(self.blocks[0].reference)
        return assemble.distinct_points([block.reference for block in self.blocks])[1]

    @cached_property
    def n_measured(self) -> int:
        """Number of measured points summed over the frames (any component counts)."""
        return sum(int(block.measured.sum()) for block in self.blocks)

    @property
    def pressure_increases(self) -> bool:
        """Whether every frame's pressure is higher than the one before."""
        return bool((np.diff(self.pressure) > 0).all())

    @cached_property
    def apex(self) -> NDArray[np.intp]:
        """(frames,) array: the point nearest the centre whose dz was measured in the frame.

        It is an index into the points of the frame's block; -1 where the frame has none.
        """
        nearest = np.full(self.n_frames, -1, dtype=np.intp)
        for block in self.blocks:
            order = np.argsort(np.hypot(*block.reference[:, :2].T), kind="stable")
            found = np.isfinite(block.displacement[:, order, 2])
            index = order[found.argmax(axis=1)]
            nearest[block.frames] = np.where(found.any(axis=1), index, -1)
        return _read_only(nearest)

    @cached_property
    def apex_displacement(self) -> Floats:
        """(frames,) array, mm: dz of the `apex` point; NaN where the frame has none."""
        rise = np.full(self.n_frames, np.nan)
        for block in self.blocks:
            index = self.apex[block.frames]
            dz = block.displacement[np.arange(len(block.frames)), index, 2]
            rise[block.frames] = np.where(index >= 0, dz, np.nan)
        return _read_only(rise)

    def frame(self, index: int) -> tuple[Floats, Floats]:
        """One frame without its lost points.

        Parameters
        ----------
        index : int
            Frame of the test, counted from 0 (from the end where negative).

        Returns
        -------
        reference, displacement : (n_i, 3) arrays, mm
            A component that alone was lost is NaN.
        """
        index = range(self.n_frames)[index]
        for block in self.blocks:
            row = int(np.searchsorted(block.frames, index))
            if row < len(block.frames) and block.frames[row] == index:
                displacement = block.displacement[row]
                kept = np.isfinite(displacement).any(axis=1)
                return block.reference[kept], displacement[kept]
        return np.empty((0, 3)), np.empty((0, 3))

    def rotated(self, angle: float) -> BulgeTest:
        """Turn the test about z, counter-clockwise seen from +z.

        A `warp_angle` that was told turns with it. Where dx or dy alone was lost both are lost
        afterwards, unless the turn is a multiple of 90 degrees.

        Parameters
        ----------
        angle : float, degree

        Raises
        ------
        InputError
            The clamp is an ellipse whose axes would not lie along x and y.
        """
        quarters, rest = divmod(angle, 90.0)
        if self.ellipticity and rest:
            raise InputError(
                f"{self.source or self.name}: the axes of an elliptic clamp lie along x and y, so "
                f"it turns by 90 degrees, not by {angle:g}; say where the warp lies with "
                "--warp-angle"
            )
        static = self.static_displacement
        return replace(
            self,
            blocks=tuple(
                Block(_turn(block.reference, angle), block.frames, _turn(block.displacement, angle))
                for block in self.blocks
            ),
            static_displacement=None if static is None else _turn(static, angle),
            ellipticity=-self.ellipticity if quarters % 2 else self.ellipticity,
            warp_angle=None if self.warp_angle is None else self.warp_angle + angle,
        )

    def select(
        self,
        frames: Any = None,
        points: ArrayLike | Sequence[ArrayLike] | None = None,
    ) -> BulgeTest:
        """Keep some frames and points, in the order of the test.

        Parameters
        ----------
        frames : slice, int or bool array_like, optional
            Frames to keep.
        points : (n,) bool array_like, or a sequence of them, optional
            Points to keep; one mask a block where the test has several blocks.

        Raises
        ------
        InputError
            What is kept is not a bulge test, e.g. all its points are lost.
        """
        index = np.arange(self.n_frames)
        kept_frames = index if frames is None else np.unique(index[frames])
        if points is None:
            masks: list[Any] = [slice(None)] * len(self.blocks)
        elif len(self.blocks) == 1:
            masks = [np.asarray(points, dtype=bool).reshape(-1)]
        else:
            masks = [np.asarray(mask, dtype=bool) for mask in points]  # type: ignore[union-attr]
        blocks = []
        for block, mask in zip(self.blocks, masks, strict=True):
            rows = np.flatnonzero(np.isin(block.frames, kept_frames))
            reference = block.reference[mask]
            if len(rows) and (len(reference) or len(self.blocks) == 1):
                renumbered = np.searchsorted(kept_frames, block.frames[rows])
                blocks.append(Block(reference, renumbered, block.displacement[rows][:, mask]))
        static = self.static_displacement
        test = replace(
            self,
            blocks=tuple(blocks),
            pressure=self.pressure[kept_frames],
            time=None if self.time is None else self.time[kept_frames],
            static_displacement=None if static is None else static[:, masks[0]],
        )
        check(test)
        return test

    def with_history(self, line: str) -> BulgeTest:
        """The same test, with one more line of what was done to it."""
        return replace(self, history=(*self.history, " ".join(line.split())))

    def cropped(self, radius: float) -> BulgeTest:
        """Leave out the points farther than `radius` (mm) from the centre."""
        masks = [np.hypot(*block.reference[:, :2].T) <= radius for block in self.blocks]
        return self.select(points=masks)

    def _checked(
        self, crop: float | None, mends: Sequence[Callable[[BulgeTest], BulgeTest]]
    ) -> BulgeTest:
        test = self
        for mend in mends:
            test = mend(test)
        if crop is not None:
            return test.cropped(crop)
        check(test)
        return test


def _read_only(array: Any) -> Any:
    # a view, so that the caller's own array stays writable
    view = np.asarray(array).view()
    view.flags.writeable = False
    return view


def _turn(vectors: Floats, angle: float) -> Floats:
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    quarters, rest = divmod(angle, 90.0)
    if rest == 0.0:
        # exact, and a lost component does not spoil the other one
        turned = [(x, y), (-y, x), (-x, -y), (y, -x)][int(quarters) % 4]
    else:
        c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
        turned = (c * x - s * y, s * x + c * y)
    return np.stack([*turned, z], axis=-1).astype(vectors.dtype, copy=False)
