"""How are values with their errors written, and what may be done with them?"""

from __future__ import annotations

import math

__all__ = ["CARE", "INTERVAL", "USE", "listed", "value_text"]

#: Standard errors on either side of a value that hold the truth in 95 % of cases (Gaussian).
INTERVAL = 1.96
#: Relative standard errors up to which a modulus is to be used, and to be used with care; the same
#: as those by which a fit says "found" and "found roughly".
USE, CARE = 0.05, 0.25


def value_text(value: float, stderr: float) -> str:
    """A value with its standard error, to the two digits that the error carries."""
    if not (math.isfinite(stderr) and stderr > 0.0):
        return f"{value:.4g}"
    if stderr < 1e-6 or abs(value) >= 1e6:
        return f"{value:.4g} ± {stderr:.2g}"
    places = max(0, 1 - math.floor(math.log10(stderr)))
    return f"{value:.{places}f} ± {stderr:.{places}f}"


def listed(items: list[str] | tuple[str, ...], last: str = "and") -> str:
    """Items in a sentence: a, b and c."""
    return f" {last} ".join(filter(None, (", ".join(items[:-1]), items[-1]))) if items else ""
