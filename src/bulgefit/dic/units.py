"""How large is a unit in bulgefit's own: mm, MPa, s and degree?"""

from __future__ import annotations

import math
import reprlib

from bulgefit.errors import InputError

__all__ = ["ANGLE", "LENGTH", "PRESSURE", "PURE", "TIME", "factor", "usual"]

LENGTH = {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3, "µm": 1e-3, "in": 25.4}
PRESSURE = {
    "MPa": 1.0,
    "N/mm^2": 1.0,
    "Pa": 1e-6,
    "kPa": 1e-3,
    "GPa": 1e3,
    "bar": 0.1,
    "mbar": 1e-4,
    # one pound-force on a square inch
    "psi": 4.4482216152605 / 25.4**2,
    "hPa": 1e-4,
    # conventional columns of mercury and of water (NIST SP 811, Thompson and Taylor, 2008, app. B)
    "mmHg": 133.322387415e-6,
    "mmH2O": 9.80665e-6,
    "inH2O": 25.4 * 9.80665e-6,
}
TIME = {"s": 1.0, "ms": 1e-3, "min": 60.0}
ANGLE = {"degree": 1.0, "deg": 1.0, "°": 1.0, "rad": 180.0 / math.pi}
PURE = {"1": 1.0, "": 1.0}

#: Other ways to write units of pressure. A gauge's own (barg, psig) count from the air outside, as
#: pressures of a bulge do.
_USUAL = {
    **dict.fromkeys(("N/mm²", "N/mm2", "N/mm**2"), "N/mm^2"),
    **dict.fromkeys(("Bar", "BAR", "barg", "bar(g)"), "bar"),
    **dict.fromkeys(("mBar", "mBAR"), "mbar"),
    **dict.fromkeys(("PSI", "Psi", "psig", "psi(g)"), "psi"),
    **dict.fromkeys(("kpa", "KPa", "KPA", "kPA"), "kPa"),
}


def usual(unit: str) -> str:
    """A unit as it is usually written."""
    return _USUAL.get(unit, unit)


def factor(unit: str, known: dict[str, float], where: str) -> float:
    """What a value in `unit` is multiplied by to become mm, MPa, s or degree.

    Parameters
    ----------
    unit : str
    known : dict of str to float
        `LENGTH`, `PRESSURE`, `TIME`, `ANGLE` or `PURE`.
    where : str
        File and key, for the message.

    Raises
    ------
    InputError
        The unit is not known.
    """
    if unit not in known:
        names = ", ".join(name for name in known if name)
        raise InputError(f"{where} has the unit {reprlib.repr(unit)}; known are {names}")
    return known[unit]
