"""Which frames were recorded, of those that were interpolated straight in pressure?

Displacement that was brought to common pressures straight between recorded frames is a broken line
in pressure, whose corners are those frames. Each stretch of it is a line: where two neighbouring
ones meet, a frame was recorded, at a pressure that nobody need have kept.

What a frame adds to the span of the lighter ones tells the stretches apart. A stretch begins on a
line that is known, so that its first frame alone adds a direction, the noise of the frame recorded
at its far end; seen from the heavier frames the same holds of its last. Corners are then found by
least squares over the stretches that leave no room for more than one each (variable projection:
Golub and Pereyra, 1973, "The differentiation of pseudo-inverses and nonlinear least squares
problems whose variables separate").
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.check import check
from bulgefit.dic.mixtures import independent_frames, values_of
from bulgefit.dic.noise import rough_part
from bulgefit.dic.reference_image import RESOLVED
from bulgefit.dic.units import PRESSURE
from bulgefit.errors import InputError

__all__ = ["recorded_frames", "unmixed"]

Floats = NDArray[np.float64]
#: The frames below and above a corner; the same one twice where it was recorded itself.
Gap = tuple[int, int]

#: Recorded frames that must be told: with fewer, none is between two others.
_LEAST = 3
#: Share of the radius within which the surface is smooth beside the noise, and units of usual
#: noise (its median) at which a point counts as corrupt.
_CALM, _WILD = 0.7, 6.0
#: Points by which noise of frames is compared at least: from three components each, shares are
#: then known to a tenth.
_FEW = 40
#: Share of its gap to which a corner must be known: what a straight line does over a hundredth of
#: the way between two frames is far below what the fabric does between them.
_KNOWN = 0.01
#: Sum of a recorded frame's weights in those that are kept beyond which single precision (4e-6 mm
#: at 40 mm) is no longer small against the noise of a good camera (1e-3 mm).
_MOST_WEIGHT = 100.0


def recorded_frames(test: BulgeTest) -> BulgeTest | None:
    """The recorded frames of an interpolated test, at the pressures at which they were recorded.

    The lightest and the heaviest frame stand on a line of which one end is known. They were
    recorded where the common pressures are even steps between them, and they are kept where their
    noise is their own, too: no more like that of the next recorded frame than those of any two
    recorded frames are. Corners that cannot be told, since no frame lies between two of them, are
    left out.

    Parameters
    ----------
    test : BulgeTest
        Of one block.

    Returns
    -------
    BulgeTest or None
        None where the frames are no mixtures, or not straight ones in pressure.
    """
    if len(test.blocks) != 1 or independent_frames(test) == test.n_frames:
        return None
    order = np.argsort(test.pressure, kind="stable")
    pressure = np.asarray(test.pressure, dtype=np.float64)[order]
    if (np.diff(pressure) <= 0.0).any():
        return None
    (block,) = test.blocks
    moved = np.asarray(block.displacement, dtype=np.float64)[order]
    time = None if test.time is None else np.asarray(test.time, dtype=np.float64)[order]
    corners = [c for chain in _chains(values_of(moved)) for c in _corners(chain, pressure, moved)]
    if len(corners) < _LEAST:
        return None
    inner = [_frame(corner, pressure, moved, time) for corner in corners]
    first, last = (
        _Frame(float(pressure[k]), moved[k], None if time is None else float(time[k]))
        for k in (0, -1)
    )
    points = np.asarray(block.reference[:, :2], dtype=np.float64) / test.radius
    if _laid_between(pressure):
        inner = _with_own_ends(
            points,
            first if corners[0].is_first else None,
            inner,
            last if corners[-1].is_last else None,
        )
    return _test_of(test, inner)


def unmixed(test: BulgeTest) -> BulgeTest:
    """The same; InputError where the frames are no straight mixtures in pressure."""
    found = recorded_frames(test)
    if found is None:
        raise InputError(
            f"--recorded: {test.name}: its frames were not interpolated straight in pressure "
            f"between {_LEAST + 2} or more recorded ones, or they do not tell those; leave it out"
        )
    return found


@dataclass(frozen=True, eq=False)
class _Frame:
    """Pressure (MPa), displacement (n, 3) mm and time (s) of a recorded frame."""

    pressure: float
    moved: Floats
    time: float | None


@dataclass(frozen=True, eq=False)
class _Chain:
    """Corners that are told together: frames from the last known line to the next, and gaps."""

    frames: slice
    gaps: tuple[Gap, ...]
    is_first: bool
    is_last: bool


@dataclass(frozen=True, eq=False)
class _Corner:
    """One corner of a chain, and the pressures of all of them (MPa)."""

    chain: _Chain
    knots: Floats
    number: int

    @property
    def is_first(self) -> bool:
        """Whether none can be below it."""
        return self.chain.is_first and self.number == 0

    @property
    def is_last(self) -> bool:
        """Whether none can be above it."""
        return self.chain.is_last and self.number == len(self.knots) - 1


def _chains(values: Floats) -> Iterator[_Chain]:
    """Gaps that hold a corner each, with the frames that tell them."""
    last = len(values) - 1
    # shares sum to one, which tells a line from one through an image at rest (1 mm rms)
    values = np.column_stack([values, np.full(last + 1, np.sqrt(values.shape[1]))])
    starts = set(_adding(values))
    ends = {last - k for k in _adding(values[::-1])}
    gaps: list[Gap] = []
    for j in range(1, last + 1):
        if j in starts and j - 1 in ends:
            gaps.append((j - 1, j))
        elif j - 1 in ends and j + 1 in starts and j not in starts | ends:
            gaps.append((j, j))
    bounds = [(0, 0), *gaps, (last, last)]
    lines = [(low, high) for (_, low), (high, _) in pairwise(bounds)]
    known = [k for k, (low, high) in enumerate(lines) if high > low]
    for before, after in pairwise(known):
        # two frames tell a line; with more, nothing else is told
        frames = slice(lines[before][1] - 1, lines[after][0] + 2)
        yield _Chain(frames, tuple(gaps[before:after]), before == 0, after == len(gaps))


def _adding(values: Floats) -> Iterator[int]:
    """Frames of (frames, values) that are no mixtures of those since the last two on one line.

    Farther back nothing more is told, and rounding is carried along.
    """
    first = 0
    for number, frame in enumerate(values):
        basis = np.linalg.qr(values[first:number].T)[0] if number else np.empty((len(frame), 0))
        left = frame
        for _ in range(2):  # once more for what rounding left
            left = left - basis @ (basis.T @ left)
        if np.sqrt(np.mean(left**2)) > RESOLVED:
            yield number
        else:
            first = number - 1


def _corners(chain: _Chain, pressure: Floats, moved: Floats) -> list[_Corner]:
    """The corners of a chain; none where they cannot be told, or lines do not meet there."""
    here, values = pressure[chain.frames], values_of(moved[chain.frames])
    # what frames have in common is found among their coordinates as well
    frames = np.linalg.svd(values, full_matrices=False)
    mixed = frames.U * frames.S / np.sqrt(values.shape[1])
    low, high = (np.array([pressure[g[k]] for g in chain.gaps]) for k in (0, 1))
    knots = low.copy()
    free = high > low

    def left(own: Floats) -> Floats:
        at = np.array(knots)
        at[free] = own
        hats = _hats(here, at)
        return np.asarray(mixed - hats @ np.linalg.lstsq(hats, mixed)[0]).ravel()

    if free.any():
        found = least_squares(
            left,
            0.5 * (low + high)[free],
            bounds=(low[free], high[free]),
            x_scale=(high - low)[free],
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        knots[free] = found.x
        # what is left is rounding, and may have led this far astray
        sharp = np.linalg.svd(found.jac * (high - low)[free], compute_uv=False)[-1]
        if sharp * _KNOWN < np.sqrt(2.0 * found.cost):
            return []
    if np.abs(left(knots[free])).max(initial=0.0) > RESOLVED or (np.diff(knots) <= 0.0).any():
        return []
    return [_Corner(chain, knots, k) for k in range(len(knots))]


def _hats(pressure: Floats, knots: Floats) -> Floats:
    """Shares (frames, knots + 2) of the frames at the corners and at both ends."""
    at = np.array([pressure[0], *knots, pressure[-1]])
    return np.stack([np.interp(pressure, at, one) for one in np.eye(len(at))], axis=1)


def _frame(corner: _Corner, pressure: Floats, moved: Floats, time: Floats | None) -> _Frame:
    """The frame recorded at a corner; NaN where what was lost leaves a point untold."""
    here, seen = pressure[corner.chain.frames], moved[corner.chain.frames]
    hats, at = _hats(here, corner.knots), corner.number + 1
    out = np.full(seen.shape[1:], np.nan)
    kept = np.isfinite(seen).all(axis=2)
    patterns, which = np.unique(kept, axis=1, return_inverse=True)
    for number, rows in enumerate(patterns.T):
        back = np.linalg.pinv(hats[rows])[at] if rows.any() else np.zeros(0)
        told = back @ hats[rows]
        told[at] -= 1.0
        if np.abs(told).max() < 1e-9 and np.abs(back).sum() < _MOST_WEIGHT:
            points = which.ravel() == number
            out[points] = np.tensordot(back, seen[rows][:, points], 1)
    when = None if time is None else float(np.linalg.pinv(hats)[at] @ time[corner.chain.frames])
    return _Frame(float(corner.knots[corner.number]), out, when)


def _with_own_ends(
    points: Floats, first: _Frame | None, inner: list[_Frame], last: _Frame | None
) -> list[_Frame]:
    """The recorded frames, with an end before and behind them whose noise is its own.

    Parameters
    ----------
    points : (n, 2) array
        Over the radius.
    first, last : _Frame or None
        None where the frame recorded next to it is not told.
    """
    frames = [frame for frame in (first, *inner, last) if frame is not None]
    rough = rough_part(points, np.array([frame.moved for frame in frames]))
    # towards the rim the surface itself is rough
    rough = rough[:, np.hypot(*points.T) < _CALM]
    seen = np.isfinite(rough).all(axis=(0, 2))
    rough = rough[:, seen]
    usual = np.median(np.abs(rough), axis=1, keepdims=True) if seen.sum() >= _FEW else np.zeros(1)
    if not (usual > 0.0).all():
        return inner
    noise = np.clip(rough / usual, -_WILD, _WILD).reshape(len(frames), -1)
    # what goes smoothly with pressure is in all frames: each is told from all others
    inverse = np.linalg.inv(noise @ noise.T)
    share = -inverse / np.diag(inverse)[:, None]
    np.fill_diagonal(share, -np.inf)
    begin = 0 if first is None else 1
    within = slice(begin, begin + len(inner))
    most = share[within, within].max()
    out = list(inner)
    if first is not None and share[0, 1] <= most:
        out.insert(0, first)
    if last is not None and share[-1, -2] <= most:
        out.append(last)
    return out


def _laid_between(pressure: Floats) -> bool:
    """Whether even steps of no round number lead from the first pressure (MPa) to the last."""
    step = (pressure[-1] - pressure[0]) / (len(pressure) - 1)
    even = np.allclose(np.diff(pressure), step, rtol=1e-6, atol=0.0)
    # three digits; units of 10 have the same
    digits = step / np.array([1.0, PRESSURE["psi"]])
    rounded = [float(f"{one:.3g}") for one in digits]
    return bool(even and not np.isclose(digits, rounded, rtol=1e-6, atol=0.0).any())


def _test_of(test: BulgeTest, frames: Sequence[_Frame]) -> BulgeTest:
    (block,) = test.blocks
    made = replace(
        test,
        blocks=(
            Block(
                block.reference,
                np.arange(len(frames)),
                np.array([frame.moved for frame in frames]),
            ),
        ),
        pressure=np.array([frame.pressure for frame in frames]),
        time=None if test.time is None else np.array([frame.time for frame in frames]),
        schedule=None,
    )
    check(made)
    return made
