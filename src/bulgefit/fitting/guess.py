"""Where do fits start, and how far may they go? Told by the apex of the tests themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest

__all__ = ["bounds_from", "implied_modulus", "start_box"]

#: Bounds and the box of starts of a modulus over the one that the apex implies. Warp and fill of
#: woven fabrics differ by up to a factor of four, and the cap formula is right within a third; the
#: shear moduli of fabrics lie between that of a loose weave and that of an isotropic sheet.
_BOUNDS: Mapping[str, tuple[float, float]] = {
    "E1": (1 / 8, 8.0),
    "E2": (1 / 8, 8.0),
    "E": (1 / 5, 5.0),
    "G12": (1 / 200, 1.0),
    "G": (1 / 12, 2.5),
}
_STARTS: Mapping[str, tuple[float, float]] = {
    "E1": (1 / 2, 2.0),
    "E2": (1 / 2, 2.0),
    # of an isotropic sheet E/G lies between 2 and 3
    "E": (0.9, 1.1),
    "G12": (1 / 40, 1 / 5),
    "G": (0.37, 0.44),
}


def implied_modulus(tests: Sequence[BulgeTest]) -> float | None:
    """Mean modulus (MPa) that a spherical cap through rim and apex implies; None where none can.

    A cap of radius R = (a² + w²)/2w carries N = pR/2 per length and is longer than the flat disc by
    the log strain e = ln(R asin(a/R)/a); N = E t e/(1 - ν) under equal biaxial tension. Within a
    third of the clamped disc's solution up to strains of some 10 % (Beams, 1959, "Mechanical
    properties of thin films").
    """
    found = []
    for test in tests:
        rise = np.asarray(test.apex_displacement, dtype=float)
        seen = np.isfinite(rise) & (test.pressure > 0.0) & (rise > 0.0) & (rise < test.radius)
        if not seen.any():
            continue
        height, pressure = rise[seen], np.asarray(test.pressure, dtype=float)[seen]
        radius = (test.radius**2 + height**2) / (2.0 * height)
        strain = np.log(radius * np.arcsin(np.minimum(test.radius / radius, 1.0)) / test.radius)
        tension = 0.5 * pressure * radius
        usable = strain > 1e-6
        if usable.any():
            modulus = (1.0 - test.poisson_ratio) * tension[usable] / strain[usable]
            # high pressures hide slack and initial height
            heavy = pressure[usable] >= np.median(pressure[usable])
            found.append(float(np.median(modulus[heavy])) / test.thickness)
    return float(np.median(found)) if found else None


def bounds_from(tests: Sequence[BulgeTest]) -> dict[str, tuple[float, float]]:
    """Bounds of every modulus, MPa; empty where the tests imply none."""
    return _scaled(_BOUNDS, implied_modulus(tests))


def start_box(tests: Sequence[BulgeTest]) -> dict[str, tuple[float, float]]:
    """Within which moduli (MPa) fits start; empty where the tests imply none."""
    return _scaled(_STARTS, implied_modulus(tests))


def _scaled(
    shares: Mapping[str, tuple[float, float]], modulus: float | None
) -> dict[str, tuple[float, float]]:
    if modulus is None:
        return {}
    return {name: (low * modulus, high * modulus) for name, (low, high) in shares.items()}
