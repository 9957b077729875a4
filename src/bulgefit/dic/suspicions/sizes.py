"""Do the numbers have the size that their unit asks for? Pressure, thickness, rise, stiffness."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.apex import rise_at_centre
from bulgefit.dic.suspicions.suspicion import Suspicion

__all__ = ["about_bounds", "about_moduli", "about_sizes", "about_thickness", "implied_stiffness"]

Floats = NDArray[np.float64]

# Highest pressures, MPa, between which a test on a fabric is expected (0.02 to 10 bar).
_USUAL_PRESSURE = (0.002, 1.0)
# Young's modulus, MPa, that no material exceeds: diamond.
_STIFFEST = 1e6
# E t of fabrics, N/mm: an elastomer of 1 mm has 5, and the heaviest glass or aramid cloth stays
# below 5,000. PVC-coated polyester and PTFE-coated glass have some 200 to 2,000 (European Design
# Guide for Tensile Surface Structures, Forster and Mollaert eds., 2004).
_FABRIC = (5.0, 5000.0)
# E, MPa, below which no yarns carry along warp and fill: the softest textile fibres, wool and
# nylon, have 2,000 (Morton and Hearle, Physical Properties of Textile Fibres, 2008, ch. 13), of
# which fibres fill at least a quarter of a cloth, half of them along each direction, and crimp
# leaves at least a fifth: 2,000 / 4 / 2 / 5.
_YARNS = 50.0
# A sheet whose span is less than this many times its thickness is a plate, not a membrane
# (Ventsel and Krauthammer, Thin Plates and Shells, 2001, sect. 1.1: 80 to 100).
_MEMBRANE = 80.0
# Poisson's ratio of a sheet that keeps its volume.
_INCOMPRESSIBLE = 0.5

_UNIT = "bulgefit convert IN OUT --unit pressure=UNIT/TAKEN, such as psi/bar or MPa/bar"


def about_sizes(test: BulgeTest) -> Iterator[Suspicion]:
    """Pressure and thickness by themselves, then the rise that they should have caused."""
    low, high = _USUAL_PRESSURE
    highest = float(test.pressure.max())
    if not low <= highest <= high:
        yield Suspicion(
            "pressure_size",
            f"highest pressure is {highest * 10:.3g} bar, where fabrics are tested at "
            f"{low * 10:g} to {high * 10:g}: are the pressures in the unit that the file says or "
            "asks for?",
            f"if they are in another one: {_UNIT}",
        )
    yield from about_thickness(test.radius, test.thickness)
    yield from _about_rise(test)


def about_moduli(thickness: float, moduli: Mapping[str, float]) -> Iterator[Suspicion]:
    """Of the cloth of a model: its thickness in mm, Young's moduli in MPa by name."""
    name = max(moduli, key=lambda one: moduli[one])
    stiffness = moduli[name] * thickness
    if moduli[name] > _STIFFEST:
        yield Suspicion(
            "modulus_size",
            f"{name} = {moduli[name]:.3g} MPa: nothing is stiffer than diamond, "
            f"{_STIFFEST:,.0f} MPa, so that it may be in Pa",
            "give moduli in MPa: 1 GPa is 1,000, and 1 Pa a millionth",
        )
    elif not _FABRIC[0] <= stiffness <= _FABRIC[1]:
        yield Suspicion(
            "stiffness",
            f"{name} t is {stiffness:.3g} N/mm, which no fabric has ({_FABRIC[0]:g} to "
            f"{_FABRIC[1]:,.0f})",
            "give moduli in MPa and the thickness in mm",
        )


def about_bounds(
    thickness: float, bounds: Mapping[str, tuple[float, float]]
) -> Iterator[Suspicion]:
    """Of a fit: whether some cloth lies between bounds (MPa) of Young's moduli, by name."""
    middle = math.sqrt(_FABRIC[0] * _FABRIC[1]) / thickness
    nearest = {name: min(max(middle, low), high) for name, (low, high) in bounds.items()}
    if nearest:
        yield from about_moduli(thickness, nearest)


def about_thickness(radius: float, thickness: float) -> Iterator[Suspicion]:
    """Whether a membrane of this radius can be so thick (mm)."""
    if 2 * radius < _MEMBRANE * thickness:
        yield Suspicion(
            "thickness_size",
            f"thickness {thickness:g} mm: the clamp's diameter is {2 * radius / thickness:.2g} "
            f"times that, and below {_MEMBRANE:g} times a sheet is a plate and no membrane",
            "give the thickness in mm with --thickness; every verb takes it",
        )


def _about_rise(test: BulgeTest) -> Iterator[Suspicion]:
    known = np.flatnonzero(np.isfinite(test.apex_displacement))
    if not len(known):
        return
    frame = int(known[test.pressure[known].argmax()])
    bar = float(test.pressure[frame]) * 10
    rise, least = abs(float(test.apex_displacement[frame])), _least_rise(test, frame)
    if rise < least:
        yield Suspicion(
            "rise_too_small",
            f"the apex rises by {rise:.2g} mm at {bar:.3g} bar, where the stiffest material "
            f"would rise by {least:.2g} mm: is the displacement in mm?",
            "if it is in another unit: bulgefit convert IN OUT --unit displacement=UNIT/mm; or the "
            "radius is too large: --radius in mm",
        )
    else:
        yield from _about_stiffness(test)


def _least_rise(test: BulgeTest, frame: int) -> float:
    """What the stiffest membrane would show at the apex point of a frame, mm."""
    pressure = max(float(test.pressure[frame]), 0.0)
    (block,) = (block for block in test.blocks if frame in block.frames)
    ((x, y),) = test.on_circle(block.reference[test.apex[frame]][None])
    # p = 3 E t w^3 / R^4, in which the factor is near that of a clamped isotropic disc
    at_centre = np.cbrt(pressure * test.radius**4 / (3 * _STIFFEST * test.thickness))
    return float(at_centre * max(1 - (x**2 + y**2) / test.radius**2, 0.0))


def _about_stiffness(test: BulgeTest) -> Iterator[Suspicion]:
    pressure, rise = rise_at_centre(test)
    if not len(rise) or pressure[-1] <= 0 or rise[-1] == 0:
        return
    cap = implied_stiffness(pressure[-1], abs(rise[-1]), test.radius, test.poisson_ratio)
    stiffness = float(cap)
    modulus = stiffness / test.thickness
    seen = (
        f"a rise of {abs(rise[-1]):.3g} mm at {pressure[-1] * 10:.3g} bar asks for E t of about "
        f"{stiffness:.2g} N/mm"
    )
    if not _FABRIC[0] <= stiffness <= _FABRIC[1]:
        yield Suspicion(
            "stiffness",
            f"{seen}, which no fabric has ({_FABRIC[0]:g} to {_FABRIC[1]:,.0f}): pressures, "
            "displacement or radius are in another unit",
            f"{_UNIT}; likewise displacement=cm/mm; the radius is given with --radius",
        )
    elif modulus < _YARNS:
        yield Suspicion(
            "modulus",
            f"{seen}, and over {test.thickness:g} mm for E of about {modulus:.2g} MPa: knits and "
            f"elastomers have that, but yarns give a woven cloth {_YARNS:g} or more, so that "
            "pressures are too small (tenfold, or psi) or the thickness is too large",
            f"if the cloth is woven: {_UNIT}, or give --thickness in mm",
        )


def implied_stiffness(
    pressure: ArrayLike, rise: ArrayLike, radius: float, poisson_ratio: float
) -> Floats:
    """E t (N/mm) of spherical caps under equal tension all round.

    Its tension is p R / 2, and its strain the logarithm of the arc over the chord. Orthotropic
    membranes of known moduli come out 0.6 to 1.1 times the mean of theirs.

    Parameters
    ----------
    pressure : float or array, MPa
    rise : float or array, mm
    radius : float, mm
    poisson_ratio : float
        More than a half, which cloth may have along a stiff warp, counts as that: no sheet that is
        alike all round has more.
    """
    pressure, rise = np.asarray(pressure, dtype=float), np.asarray(rise, dtype=float)
    curvature_radius = (radius**2 + rise**2) / (2 * rise)
    half_angle = 2 * np.arctan2(rise, radius)
    strain = np.log(half_angle * curvature_radius / radius)
    shrink = 1 - min(poisson_ratio, _INCOMPRESSIBLE)
    return np.asarray(shrink * pressure * curvature_radius / 2 / strain)
