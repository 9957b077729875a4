"""Where do fits start, and how far may they go? Told by the apex of the tests themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bulgefit.dic.bulge_test import BulgeTest
from bulgefit.dic.suspicions.apex import rise_at_centre
from bulgefit.dic.suspicions.sizes import implied_stiffness

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


#: Rise over the radius below which a cap's strain, two thirds of its square, is lost in rounding.
_LEAST_RISE = 1e-3
#: Part of the radius beyond which a height is less than a tenth of the centre's (1 - 0.95^2), and
#: the clamp's own motion and zero a large part of it.
_AT_CLAMP = 0.95


def implied_modulus(tests: Sequence[BulgeTest]) -> float | None:
    """Mean modulus (MPa) that a spherical cap through rim and apex implies; None where none can.

    A cap (`implied_stiffness`) is within a third of the clamped disc's solution up to strains of
    some 10 % (Beams, 1959, "Mechanical properties of thin films"). Its apex is told by the measured
    point nearest the centre, wherever that lies.
    """
    found = []
    for test in tests:
        pressure, rise = rise_at_centre(test, _AT_CLAMP)
        seen = (pressure > 0.0) & (rise > _LEAST_RISE * test.radius) & (rise < test.radius)
        if seen.any():
            # high pressures hide slack and initial height
            heavy = seen & (pressure >= np.median(pressure[seen]))
            stiffness = implied_stiffness(
                pressure[heavy], rise[heavy], test.radius, test.poisson_ratio
            )
            found.append(float(np.median(stiffness)) / test.thickness)
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
