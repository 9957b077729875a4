"""Where does each law lose ellipticity? The strains of homogeneous states at which it does.

python benchmarks/ellipticity.py prints the table of docs/verification.md.

The state is a stretch with logarithmic strains e and r e along axes that are turned by an angle
from warp and fill; e grows from 0 until rank-one changes of the deformation cost no energy
(bulgefit.fem.ellipticity), or to 0.5. The fabric wrinkles where it would be compressed.
"""

from __future__ import annotations

import argparse
import math
from itertools import product

from bulgefit.fem.elasticity import orthotropic_stiffness
from bulgefit.fem.ellipticity import ROUNDING, point_margin
from bulgefit.fem.laws import LAWS
from bulgefit.fem.membrane import Fabric

MODULI = (300.0, 225.0)  # E1, E2 MPa
NU12 = 0.24
SHEAR = (100.0, 30.0, 10.0, 3.0, 1.0, 0.3)  # G12 MPa
RATIOS = (1.0, 0.5, 0.0)
ANGLES = (0.0, 22.5, 45.0)  # degrees
LARGEST, STEPS = 0.5, 500


def is_elliptic(law: str, q: tuple[float, ...], e: float, ratio: float, angle: float) -> bool:
    """Whether the law is elliptic at one state."""
    a, b = math.exp(2.0 * e), math.exp(2.0 * ratio * e)
    cos, sin = math.cos(angle), math.sin(angle)
    c = a * cos**2 + b * sin**2, a * sin**2 + b * cos**2, (a - b) * sin * cos
    margin, _ = point_margin(*c, q, LAWS[law], True)
    return bool(margin > -ROUNDING * (q[0] + q[1]))


def first_loss(law: str, shear: float, ratio: float, degrees: float) -> float:
    """Least strain at which ellipticity is lost; infinite where there is none up to 0.5."""
    q = Fabric().law_parameters(orthotropic_stiffness(*MODULI, shear, NU12))
    angle, step = math.radians(degrees), LARGEST / STEPS
    for k in range(1, STEPS + 1):
        if not is_elliptic(law, q, k * step, ratio, angle):
            low, high = (k - 1) * step, k * step
            for _ in range(20):
                middle = 0.5 * (low + high)
                if is_elliptic(law, q, middle, ratio, angle):
                    low = middle
                else:
                    high = middle
            return high
    return math.inf


def table(laws: list[str]) -> list[str]:
    """The map as lines of Markdown: per cent, at each G12 in MPa."""
    lines = [
        "| r | turned by | law |" + "".join(f" {shear:g} |" for shear in SHEAR),
        "|---|---|---|" + "---|" * len(SHEAR),
    ]
    never = set(laws)
    for ratio, degrees, law in product(RATIOS, ANGLES, laws):
        found = [first_loss(law, shear, ratio, degrees) for shear in SHEAR]
        if min(found) < math.inf:
            cells = "".join(f" {100 * e:.3g} |" if e < math.inf else " – |" for e in found)
            lines.append(f"| {ratio:g} | {degrees:g}° | {law} |{cells}")
            never.discard(law)
    words = f"Elliptic in all these states, up to a strain of {100 * LARGEST:g} %: "
    return [*lines, "", words + (", ".join(law for law in laws if law in never) or "none") + "."]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--law", action="append", help="a law by name (default: our own)")
    laws = parser.parse_args().law or ["hencky", "svk", "yarn"]
    print("\n".join(table(laws)))


if __name__ == "__main__":
    main()
