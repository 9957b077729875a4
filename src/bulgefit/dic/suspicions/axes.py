"""Do displacement and positions speak of the same axes? Swapped, mirrored, deformed positions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.in_plane import InPlane, in_plane
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_axes"]

# An estimate departs from another where they lie this many standard errors apart.
_SURE = 5.0
# Poisson's ratios below which the stiffer fibres move less in plane.
_NARROW = 0.5

# How the displacement's axes may lie to those of the positions, as (dx, dy) = Q (x, y): code, what
# it is, and what convert is told.
_WAYS = {
    ((-1, 0), (0, 1)): ("dx_mirrored", "dx points to -x", "--flip dx"),
    ((1, 0), (0, -1)): ("dy_mirrored", "dy points to -y", "--flip dy"),
    ((-1, 0), (0, -1)): ("dx_dy_mirrored", "dx and dy point to -x and -y", "--flip dx,dy"),
    ((0, 1), (1, 0)): ("dx_dy_swapped", "dx is along y and dy along x", "--swap-xy displacement"),
    ((0, -1), (1, 0)): (
        "dx_dy_turned",
        "dx is along -y and dy along x",
        "--swap-xy displacement --flip dy",
    ),
    ((0, 1), (-1, 0)): (
        "dx_dy_turned",
        "dx is along y and dy along -x",
        "--swap-xy displacement --flip dx",
    ),
    ((0, -1), (-1, 0)): (
        "dx_dy_turned",
        "dx is along -y and dy along -x",
        "--swap-xy displacement --flip dx,dy",
    ),
}


def about_axes(test: BulgeTest) -> Iterator[Suspicion]:
    """z by the apex, x and y by how a clamped membrane moves in its plane."""
    known = np.flatnonzero(np.isfinite(test.apex_displacement))
    if len(known) and test.apex_displacement[known[test.pressure[known].argmax()]] < 0:
        yield Suspicion(
            "z_reversed",
            "the apex moves to -z under pressure: the z axis points into the specimen",
            "bulgefit convert IN OUT --flip z,dz, and y,dy too if the axes are to stay "
            "right-handed",
        )
    motion = in_plane(test)
    if motion is not None:
        yield from _about_positions(motion)
        yield from _about_directions(motion, test)


def _about_positions(motion: InPlane) -> Iterator[Suspicion]:
    # the clamp holds the rim, so that a displacement's slope is 0 over the disc (Gauss), while a
    # position's is 1: the nearer one is taken
    sure = np.abs(motion.slope) - _SURE * motion.slope_error
    if sure.max() > 0.5:
        row, column = np.unravel_index(int(sure.argmax()), (2, 2))
        twice = row == column and motion.slope[row, column] < 0.0
        yield Suspicion(
            "positions_not_displacements",
            f"d{'xy'[row]} changes by {motion.slope[row, column]:.2f} mm per mm of "
            f"{'xy'[column]} over the disc, where a clamp lets it change by 0: "
            + (
                "the positions were taken off a displacement"
                if twice
                else "displacement holds deformed positions"
            ),
            "convert the export without --from-positions"
            if twice
            else "bulgefit convert IN OUT --from-positions takes the reference off",
        )


def _about_directions(motion: InPlane, test: BulgeTest) -> Iterator[Suspicion]:
    scores = {way: float((np.array(way) * motion.swelling).sum()) for way in _WAYS}
    way = max(scores, key=lambda key: scores[key])
    # 2 is expected of the right way, and 0 of none: below 1 none is the nearer one, and above 4 the
    # way is farther off than none is, as where heights are next to nothing
    margin = scores[way] - float(np.trace(motion.swelling))
    error = _SURE * float(np.sqrt((motion.swelling_error**2).sum()))
    if 1 < scores[way] <= 4 and margin > error:
        code, what, how = _WAYS[way]
        yield Suspicion(
            code,
            f"{what}: the points of a clamped membrane under pressure move outwards in plane, "
            f"and (dx, dy) follows {_shown(way)} by {scores[way] / 2:.2f} of what the rise asks "
            "for",
            f"bulgefit convert IN OUT {how}, or the same of the positions if these are wrong",
        )
    elif scores[way] < float(np.trace(motion.swelling)) and abs(test.poisson_ratio) < _NARROW:
        yield from _about_order(motion, test.warp_angle)


def _shown(way: tuple[tuple[int, int], ...]) -> str:
    names = {(1, 0): "x", (-1, 0): "-x", (0, 1): "y", (0, -1): "-y"}
    return f"({', '.join(names[row] for row in way)})"


def _about_order(motion: InPlane, warp_angle: float | None) -> Iterator[Suspicion]:
    # on the stiffer fibres of an orthotropic membrane the in-plane motion is the smaller one:
    # so it is in bulgefit's own solutions for E1/E2 from 1/5 to 5, nu12 up to 0.45 and slack
    along, across = motion.swelling[0, 0], motion.swelling[1, 1]
    error = float(np.hypot(motion.swelling_error[0, 0], motion.swelling_error[1, 1]))
    # a warp halfway between the axes lies alike to both
    towards_x = np.cos(2.0 * np.deg2rad(warp_angle or 0.0))
    if (along - across) * towards_x > _SURE * error:
        yield Suspicion(
            "fill_stiffer_than_warp",
            f"the in-plane motion is {along:.2f} of an evenly strained cap's along x and "
            f"{across:.2f} along y, so that E2 will come out above E1; the data cannot tell "
            "whether warp and fill were swapped in all arrays",
            "if the warp lies along y: bulgefit convert IN OUT --swap-xy"
            if warp_angle is None
            else "if the warp lies elsewhere: say where with --warp-angle",
        )
