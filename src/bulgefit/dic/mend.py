"""How is a test put right whose units, axes or zeros are wrong? Each mend is one function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.dic.bulge_test import Block, BulgeTest
from bulgefit.dic.rim import rim_of
from bulgefit.dic.units import LENGTH, PRESSURE, factor
from bulgefit.errors import InputError
from bulgefit.shown import number_of

__all__ = [
    "QUANTITIES",
    "centred",
    "check_columns",
    "flipped",
    "from_positions",
    "images_at_rest",
    "in_unit",
    "levelled",
    "scale_of",
    "shifted",
    "swapped",
    "turned_by",
]

Floats = NDArray[np.floating]

#: What may stand in another unit, and the units that are known of it.
QUANTITIES = {
    "pressure": PRESSURE,
    "reference": LENGTH,
    "displacement": LENGTH,
    "radius": LENGTH,
    "thickness": LENGTH,
}
_COLUMNS = ("x", "y", "z", "dx", "dy", "dz")
# The outer part of the disc: on it a specimen that hangs or was left domed is still near the clamp.
_RING = 0.9
_FEWEST_POINTS = 10


def in_unit(test: BulgeTest, quantity: str, unit: str, taken: str) -> BulgeTest:
    """Read the numbers of a quantity in another unit than they were taken for.

    Parameters
    ----------
    test : BulgeTest
    quantity : str
        One of `QUANTITIES`; `displacement` includes the images at rest.
    unit, taken : str
        The unit in which the numbers are, and the one they were taken for.

    Raises
    ------
    InputError
        The quantity or a unit is not known.
    """
    scale = scale_of(quantity, unit, taken)
    if quantity == "reference":
        return _changed(test, reference=lambda points: points * scale)
    if quantity == "displacement":
        return _changed(test, displacement=lambda moved, _: moved * moved.dtype.type(scale))
    return replace(test, **{quantity: getattr(test, quantity) * scale})


def scale_of(quantity: str, unit: str, taken: str) -> float:
    """What numbers in `unit` that were taken for `taken` are multiplied by.

    Raises
    ------
    InputError
        The quantity or a unit is not known.
    """
    if quantity not in QUANTITIES:
        raise InputError(f"--unit: unknown {quantity!r}; known are {', '.join(QUANTITIES)}")
    units, where = QUANTITIES[quantity], f"--unit: {quantity}"
    return factor(unit, units, where) / factor(taken, units, where)


def images_at_rest(test: BulgeTest, count: int) -> BulgeTest:
    """Take the first frames for repeated images at rest: they tell the noise, and are no frames.

    One that is zero all over is the reference, correlated with itself, and tells nothing.

    Parameters
    ----------
    test : BulgeTest
    count : int
        Of frames.

    Raises
    ------
    InputError
        There are not so many beside others, they have points of their own, their pressure is above
        that of other frames, or all are zero.
    """
    where = f"{test.source or test.name}: {number_of(count, 'image')} at rest"
    if not 0 < count < test.n_frames:
        raise InputError(f"{where}, of {number_of(test.n_frames, 'frame')}; leave some frames")
    if len(test.blocks) > 1:
        raise InputError(f"{where}: frames have points of their own, which no noise can be told by")
    highest, lowest = test.pressure[:count].max(), test.pressure[count:].min()
    if highest > lowest:
        raise InputError(
            f"{where}: one was taken at {10 * highest:.4g} bar, above a frame at "
            f"{10 * lowest:.4g} bar; the images at rest stand before the others"
        )
    block = test.blocks[0]
    images = block.displacement[block.frames < count]
    images = images[np.nan_to_num(images).any(axis=(1, 2))]
    if not len(images):
        raise InputError(f"{where}: zero all over, hence the reference itself")
    if test.static_displacement is not None:
        images = np.concatenate([test.static_displacement, images])
    kept = block.frames >= count
    moved = Block(block.reference, block.frames[kept] - count, block.displacement[kept])
    return replace(
        test,
        blocks=(moved,),
        pressure=test.pressure[count:],
        time=None if test.time is None else test.time[count:],
        schedule=None,
        static_displacement=images,
    )


def from_positions(test: BulgeTest) -> BulgeTest:
    """Take the reference off: displacement holds the positions of the deformed specimen."""
    return _changed(
        test, displacement=lambda moved, points: (moved - points).astype(moved.dtype, copy=False)
    )


def flipped(test: BulgeTest, columns: Sequence[str]) -> BulgeTest:
    """Change the sign of some of x, y, z (of the reference) and dx, dy, dz.

    Where one of x and y changes in both, a warp's angle that was told changes its sign too.

    Raises
    ------
    InputError
        A column is unknown.
    """
    check_columns(columns)
    signs = np.array([-1.0 if column in columns else 1.0 for column in _COLUMNS])
    mirrored = ({"x", "dx"} <= {*columns}) != ({"y", "dy"} <= {*columns})
    if mirrored and test.warp_angle is not None:
        test = replace(test, warp_angle=-test.warp_angle)
    return _changed(
        test,
        reference=lambda points: points * signs[:3],
        displacement=lambda moved, _: moved * signs[3:].astype(moved.dtype),
    )


def check_columns(columns: Sequence[str]) -> None:
    """Raise InputError unless all are columns of a test."""
    for column in columns:
        if column not in _COLUMNS:
            raise InputError(f"--flip: unknown {column!r}; known are {', '.join(_COLUMNS)}")


def swapped(test: BulgeTest, arrays: str) -> BulgeTest:
    """Let x and y change places in `reference`, in `displacement`, or in `all` arrays.

    Where they do in all, so do the clamp's semi-axes, and the warp is at its angle to y.
    """
    order = [1, 0, 2]
    if arrays == "all":
        warp = None if test.warp_angle is None else 90.0 - test.warp_angle
        test = replace(test, ellipticity=-test.ellipticity, warp_angle=warp)
    return _changed(
        test,
        reference=lambda points: points if arrays == "displacement" else points[:, order],
        displacement=lambda moved, _: moved if arrays == "reference" else moved[..., order],
    )


def shifted(test: BulgeTest, shift: ArrayLike) -> BulgeTest:
    """Move the reference by a vector (3,), mm."""
    return _changed(test, reference=lambda points: points + np.asarray(shift, dtype=float))


def centred(test: BulgeTest, by: str) -> BulgeTest:
    """Move the reference in plane so that x = y = 0 is the clamp's centre.

    Parameters
    ----------
    test : BulgeTest
    by : str
        `rim`: the centre of the circle on which the heights, continued, fall to zero
        (`bulgefit.dic.rim`). `apex`: the highest point, by a paraboloid through the points near it.

    Raises
    ------
    InputError
        The points or frames do not tell it.
    """
    return shifted(test, -np.append(rim_position(test) if by == "rim" else apex_position(test), 0))


def rim_position(test: BulgeTest) -> Floats:
    """x, y (mm) of the rim's centre, where the heights tell it."""
    found = rim_of(test)
    if found is None:
        raise InputError(
            f"{test.source or test.name}: too few frames or points to tell the rim's centre; give "
            "what you measured with --shift"
        )
    return found.centre


def apex_position(test: BulgeTest) -> Floats:
    """x, y (mm) of the highest point under the highest pressure.

    A paraboloid is laid through the points within half the radius of the highest one.
    """
    reference, displacement = test.frame(int(test.pressure.argmax()))
    known = np.isfinite(displacement[:, 2])
    points, height = reference[known, :2], displacement[known, 2]
    where = f"{test.source or test.name}: the points do not tell the apex"
    if not len(points):
        raise InputError(f"{where}; give what you measured with --shift")
    near = np.hypot(*(points - points[height.argmax()]).T) < test.radius / 2
    x, y = points[near].T
    basis = np.column_stack([np.ones_like(x), x, y, x**2, x * y, y**2])
    if len(x) < _FEWEST_POINTS or np.linalg.matrix_rank(basis) < basis.shape[1]:
        raise InputError(f"{where}; give what you measured with --shift")
    _, a, b, c, d, e = np.linalg.lstsq(basis, height[near], rcond=None)[0]
    if not (c < 0 and 4 * c * e > d**2):
        raise InputError(f"{where}, the heights have no top; give what you measured with --shift")
    return np.asarray(np.linalg.solve([[2 * c, d], [d, 2 * e]], [-a, -b]))


#: What else puts a test on its plane: of `bulgefit convert`.
_BY_HAND = "give z with --shift 0,0,DZ"


def levelled(test: BulgeTest, otherwise: str = _BY_HAND) -> BulgeTest:
    """Turn and lift the test so that the plane through the rim of its reference is z = 0.

    The plane is the least-squares one through the points of the outer tenth of the radius; the
    frame turns about the horizontal axis that brings it level, displacement with it.

    Parameters
    ----------
    test : BulgeTest
    otherwise : str
        What to do where there is no such plane, for the message.

    Raises
    ------
    InputError
        Too few points lie there, or on one side only.
    """
    points, normal = rim_plane(test, otherwise)
    turn = _upright(normal)
    lifted = _changed(test, reference=lambda p: p - [0.0, 0.0, points[2]])
    return turned_by(lifted, turn)


def rim_plane(test: BulgeTest, otherwise: str = _BY_HAND) -> tuple[Floats, Floats]:
    """The plane through the outer ring: its point (0, 0, z) in mm, and its unit normal.

    Parameters and errors as of `levelled`.
    """
    points = np.concatenate([block.reference[block.measured.any(axis=0)] for block in test.blocks])
    ring = points[np.hypot(*test.on_circle(points).T) > _RING * test.radius]
    basis = np.column_stack([ring[:, :2], np.ones(len(ring))])
    # seen from the centre the ring must not lie in one half only
    around = np.sort(np.arctan2(ring[:, 1], ring[:, 0]))
    gaps = np.diff(around, append=around[:1] + 2 * np.pi)
    if len(ring) < _FEWEST_POINTS or gaps.max() > np.pi:
        raise InputError(
            f"{test.source or test.name}: the plane through the rim needs points all around "
            f"beyond {_RING * test.radius:g} mm, found {len(ring)}; {otherwise}"
        )
    a, b, height = np.linalg.lstsq(basis, ring[:, 2], rcond=None)[0]
    return np.array([0.0, 0.0, height]), np.array([-a, -b, 1.0]) / np.sqrt(a * a + b * b + 1)


def _upright(normal: Floats) -> Floats:
    """The rotation (3, 3) about a horizontal axis that turns a unit vector into z."""
    x, y, z = normal
    # Rodrigues' formula for the axis (y, -x, 0) and the cosine z
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return np.eye(3) + cross + cross @ cross / (1 + z)


def turned_by(test: BulgeTest, rotation: Floats) -> BulgeTest:
    """Turn positions and displacements by a rotation (3, 3)."""
    return _changed(
        test,
        reference=lambda points: points @ rotation.T,
        displacement=lambda moved, _: (moved @ rotation.T).astype(moved.dtype, copy=False),
    )


def _changed(
    test: BulgeTest,
    reference: Callable[[Floats], Floats] = lambda points: points,
    displacement: Callable[[Floats, Floats], Floats] = lambda moved, _: moved,
) -> BulgeTest:
    """The test with other arrays; displacement's function is given the old reference too."""
    static = test.static_displacement
    return replace(
        test,
        blocks=tuple(
            Block(
                reference(block.reference),
                block.frames,
                displacement(block.displacement, block.reference),
            )
            for block in test.blocks
        ),
        static_displacement=None
        if static is None
        else displacement(static, test.blocks[0].reference),
    )
