"""What do strain, curvature and tension come to at each place, and how sure is that?

Of the three equations of a membrane's equilibrium the one along the normal,

    N_xx k_xx + 2 N_xy k_xy + N_yy k_yy = p,

needs nothing but the shape. It gives one number at each place, N = p/(k_xx + k_yy): the tension
that would carry the pressure were it alike in all directions, as it is at the apex of an isotropic
sheet (p R/2), and of any other fabric the mean of the tensions along the principal curvatures,
weighted by these. How the tensions differ is left open by the shape: see `rings`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.surface.shape import flattening, slopes_of, strain_and_curvature
from bulgefit.dic.surface.windows import DEGREE, Windows, windows

__all__ = ["Frames", "Surface", "frames_of", "surface_of"]

Floats = NDArray[np.float64]

#: Values of windows that are looked at together.
_AT_ONCE = 500_000


@dataclass(frozen=True, eq=False)
class Surface:
    """Local values at some places; NaN where too few points were measured about one.

    Each standard error is that of the noise of the test, carried through the window.

    Attributes
    ----------
    points : (c, 2) array, mm
        Places before inflation.
    strain, strain_noise : (frames, c, 3) arrays, 1
        Hencky strain xx, yy, xy (tensor components), in axes that go with the fabric.
    curvature, curvature_noise : (frames, c, 3) arrays, 1/mm
        xx, yy, xy in the same axes; positive where domed.
    tension, tension_noise : (frames, c) arrays, N/mm
        Mean tension p/(k_xx + k_yy) of the deformed fabric.
    stress, stress_noise : (frames, c) arrays, MPa
        That tension over the thickness of a fabric that keeps its volume.
    """

    points: Floats
    strain: Floats
    strain_noise: Floats
    curvature: Floats
    curvature_noise: Floats
    tension: Floats
    tension_noise: Floats
    stress: Floats
    stress_noise: Floats

    def at(self, place: int) -> Surface:
        """One of the places alone."""
        rest = {f.name: getattr(self, f.name)[:, [place]] for f in fields(self)[1:]}
        return Surface(self.points[[place]], **rest)


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames in which the same points of a block were measured, and windows among these.

    Attributes
    ----------
    frames : (k,) int array
    displacement : (k, n, 3) array, mm
    local : Windows
    reference : (c, 6, 3) array, mm
        Position before inflation and its derivatives at the centres.
    """

    frames: NDArray[np.intp]
    displacement: NDArray[np.floating]
    local: Windows
    reference: Floats

    def parts(self) -> Iterator[tuple[NDArray[np.intp], Floats]]:
        """Some frames at a time: deformed positions and their derivatives (k, c, 6, 3), mm."""
        size = max(1, _AT_ONCE // max(1, self.local.weights.size))
        for start in range(0, len(self.frames), size):
            rows = slice(start, start + size)
            yield self.frames[rows], self.reference + self.local(self.displacement[rows])

    @property
    def flat(self) -> Floats:
        """`flattening` of the reference surface, (c, 2, 2)."""
        return flattening(self.reference[:, 1:3])


def frames_of(
    test: BulgeTest, centres: Floats, window: float, degree: int = DEGREE
) -> list[Frames]:
    """Frames of a test, those together in which the same points were wholly measured.

    Frames in which no window has a point are left out: sums over nothing would be 0, not unknown.
    """
    found = []
    for block in test.blocks:
        whole = np.isfinite(block.displacement).all(axis=2)
        patterns, which = np.unique(whole, axis=0, return_inverse=True)
        for index, seen in enumerate(patterns):
            rows = np.flatnonzero(which.ravel() == index)
            points = np.asarray(block.reference[seen], dtype=np.float64)
            local = windows(points[:, :2], centres, window, degree)
            if not local.neighbours.size:
                continue
            reference = np.zeros((len(centres), 6, 3))
            reference[:, 0, :2], reference[:, 1:3, :2] = centres, np.eye(2)
            reference[..., 2] = local(points)[..., 2]
            moved = block.displacement[rows][:, seen]
            found.append(Frames(block.frames[rows], moved, local, reference))
    return found


def surface_of(test: BulgeTest, centres: Floats, window: float, sigma: Floats) -> Surface:
    """Local values at centres (c, 2) mm, by windows of a radius (mm), for noise (3,) mm."""
    shape = (test.n_frames, len(centres))
    value, noise = np.full((2, *shape, 7), np.nan)
    total, total_noise = np.full((2, *shape), np.nan)
    for group in frames_of(test, centres, window):
        spread, flat = group.local.covariance(), group.flat
        for frames, here in group.parts():
            found, slope = slopes_of(partial(_with_sum, flat=flat), here, window)
            through = np.einsum("fcqkd,ckl->fcqld", slope, spread)
            error = np.sqrt(np.einsum("fcqld,fcqld,d->fcq", through, slope, sigma**2))
            value[frames], total[frames] = found[..., :7], found[..., 7]
            noise[frames], total_noise[frames] = error[..., :7], error[..., 7]
    with np.errstate(divide="ignore", invalid="ignore"):
        tension = np.asarray(test.pressure, dtype=np.float64)[:, None] / total
        of_tension = np.abs(tension * total_noise / total)
        area = value[..., 6]
        stress = tension * area / test.thickness
        # strain hardly adds to what curvature does
        of_stress = np.abs(stress) * np.hypot(total_noise / total, noise[..., 6] / area)
    return Surface(
        centres, value[..., :3], noise[..., :3], value[..., 3:6], noise[..., 3:6],
        tension, of_tension, stress, of_stress,
    )  # fmt: skip


def _with_sum(derivatives: Floats, flat: Floats) -> Floats:
    """Strain, curvature, ratio of areas, and the sum of the curvatures."""
    found = strain_and_curvature(derivatives, flat)
    return np.concatenate([found, found[..., [3]] + found[..., [4]]], axis=-1)
