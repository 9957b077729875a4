"""What do rings about the apex carry? The pressure on all that lies inside them.

A ring of the fabric that lay at radius r carries, by the balance of forces along z, the pressure on
the area A that it encloses seen from above, whatever the fabric:

    mean of N_m = p A / (integral of -nu_z ds),

weighted by -nu_z, with the unit vector nu in the surface, across the ring and outwards. Where all
is the same around the axis that is the textbook's N_m = p r/(2 sin phi). The hoop tension follows
from the balance along the normal, N_m k_m + N_h k_h = p, with means over the ring: exact where all
is the same around the axis, off by the square of how tension and curvature vary around it
elsewhere (Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells, 1959, ch. 14).

How tension varies around a ring is not told by the shape: of the equilibrium's solutions one
function on the rim stays free (Pucher, Abhandlungen IVBH 5, 1938: an elliptic equation for a stress
function), and its part of order 2, warp against fill, reaches the apex undiminished. So what each
yarn direction carries there needs a law of the material, which is what a fit is for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.surface.local import frames_of
from bulgefit.dic.surface.shape import (
    metric,
    normal,
    second_form,
    slopes_of,
    strain_and_curvature,
)

__all__ = ["Rings", "ring_values", "rings_of"]

Floats = NDArray[np.float64]

#: Places on a ring: sums over them are exact for orders around the axis below half of it.
_AROUND = 48
#: Share of a value by which it is changed to find what follows from it.
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class Rings:
    """Means around rings; NaN where a part of the ring was not measured.

    Along the last axis stand meridian and hoop.

    Attributes
    ----------
    radius : (r,) array, mm
        Before inflation.
    strain, strain_noise : (frames, r, 2) arrays, 1
        Hencky strain of lines that ran along and across the radius.
    curvature, curvature_noise : (frames, r, 2) arrays, 1/mm
    tension, tension_noise : (frames, r, 2) arrays, N/mm
        Of the deformed fabric.
    stress, stress_noise : (frames, r, 2) arrays, MPa
        Tension over the thickness of a fabric that keeps its volume.
    """

    radius: Floats
    strain: Floats
    strain_noise: Floats
    curvature: Floats
    curvature_noise: Floats
    tension: Floats
    tension_noise: Floats
    stress: Floats
    stress_noise: Floats


def rings_of(test: BulgeTest, radii: Floats, window: float, sigma: Floats) -> Rings:
    """Rings of radii (r,) mm, by windows of a radius (mm), for noise (3,) mm."""
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    value, noise = np.full((2, test.n_frames, len(radii), 8), np.nan)
    centres = (radii[:, None, None] * around).reshape(-1, 2)
    for group in frames_of(test, centres, window) if len(radii) else []:
        local = partial(
            ring_values,
            reference=group.reference,
            flat=group.flat,
            around=np.tile(around, (len(radii), 1)),
        )
        spread = [
            group.local.shared(slice(i, i + _AROUND)) for i in range(0, len(centres), _AROUND)
        ]
        for frames, here in group.parts():
            each, slope = slopes_of(local, here, window)
            means = each.reshape(len(frames), len(radii), _AROUND, -1).mean(axis=2)
            load = np.asarray(test.pressure, dtype=np.float64)[frames, None]
            value[frames], by_mean = _carried_slopes(means, load, test.thickness)
            slope = slope.reshape(len(frames), len(radii), _AROUND, *slope.shape[2:]) / _AROUND
            slope = np.einsum("froq,frcqkd->frdock", by_mean, slope)
            noise[frames] = _errors(slope.reshape(*slope.shape[:4], -1), spread, sigma)
    pairs = [part[..., i : i + 2] for i in range(0, 8, 2) for part in (value, noise)]
    return Rings(radii, *pairs)


def _errors(slope: Floats, spread: list[Floats], sigma: Floats) -> Floats:
    """Standard errors (frames, r, 8) by slopes (frames, r, 3, 8, windows' values)."""
    variance = np.empty((*slope.shape[:2], slope.shape[3]))
    for ring, shared in enumerate(spread):
        own = slope[:, ring]
        variance[:, ring] = np.einsum("fdok,fdok,d->fo", own @ shared, own, sigma**2)
    return np.sqrt(variance)


def _carried_slopes(means: Floats, pressure: Floats, thickness: float) -> tuple[Floats, Floats]:
    """`_carried`, and its slopes by the means (..., 8, 7)."""
    slopes = np.empty((*means.shape[:-1], 8, means.shape[-1]))
    for i in range(means.shape[-1]):
        step = np.zeros_like(means)
        step[..., i] = _STEP * np.maximum(np.abs(means[..., i]), _STEP)
        ends = [_carried(means + sign * step, pressure, thickness) for sign in (1.0, -1.0)]
        with np.errstate(invalid="ignore"):  # a ring that lies flat carries nothing
            slopes[..., i] = (ends[0] - ends[1]) / (2.0 * step[..., [i]])
    return _carried(means, pressure, thickness), slopes


def _carried(means: Floats, pressure: Floats, thickness: float) -> Floats:
    """Strains, curvatures, tensions and stresses (..., 8) of rings' means (..., 7)."""
    area, across, strain_m, strain_h, bent_m, bent_h, stretched = np.moveaxis(means, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        meridian = pressure * area / across
        hoop = (pressure - meridian * bent_m) / bent_h
    tension = np.stack([meridian, hoop], axis=-1)
    stress = tension * stretched[..., None] / thickness
    bent = np.stack([strain_m, strain_h, bent_m, bent_h], axis=-1)
    return np.concatenate([bent, tension, stress], axis=-1)


def ring_values(derivatives: Floats, reference: Floats, flat: Floats, around: Floats) -> Floats:
    """What each place (..., c) adds to its ring's means, (..., c, 7).

    Enclosed area (mm²) and integral of -nu_z ds (mm), whose means around the ring are the whole;
    meridian and hoop strain, meridian and hoop curvature (1/mm), ratio of areas.
    """
    x, tangents = derivatives[..., 0, :], derivatives[..., 1:3, :]
    turn = 2.0 * np.pi * np.hypot(reference[:, 0, 0], reference[:, 0, 1])
    hoop = np.stack([-around[:, 1], around[:, 0]], axis=1)
    along = np.einsum("ci,...cij->...cj", hoop, tangents)
    length = np.linalg.norm(along, axis=-1)
    outwards = np.cross(along, normal(tangents)) / length[..., None]
    area = 0.5 * turn * (x[..., 0] * along[..., 1] - x[..., 1] * along[..., 0])
    across = -turn * outwards[..., 2] * length

    c, a = metric(tangents), metric(reference[:, 1:3])
    strains = [0.5 * np.log(_along(c, line) / _along(a, line)) for line in (around, hoop)]
    found = strain_and_curvature(derivatives, flat)
    bent_hoop = -_along(second_form(derivatives), hoop) / _along(c, hoop)
    bent_meridian = found[..., 3] + found[..., 4] - bent_hoop
    parts = [area, across, *strains, bent_meridian, bent_hoop, found[..., 6]]
    return np.stack(parts, axis=-1)


def _along(tensor: Floats, direction: Floats) -> Floats:
    return np.einsum("ci,...cij,cj->...c", direction, tensor, direction)
