"""Stress is not linear in strain along warp and fill."""

from __future__ import annotations

import math
from dataclasses import replace

from bulgefit.effects.base import Effect, Own, several
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import KNEE, Cloth

__all__ = ["EFFECT"]

_GAINS, _KNEES = ("k_x", "k_y"), ("s_x", "s_y", "knee_x", "knee_y")


class NonlinearMaterial(Effect):
    """Gains and knees of the stress along warp and fill, in tension.

    The stress gains k E e² (the secant stiffness changes by k per unit strain; > 0 stiffens), and
    its slope changes from E to (1 + s) E about the strain `knee`, where half of that is reached.
    Polyester fibres yield at 0.5 to 2.2 % (Northolt, Baltussen and Schaffers-Korff, 1995, "Yielding
    and hysteresis of polymer fibres"), beyond which their slope is a small part of what it was.
    """

    id = "nonlinear_material"
    place = "material"
    meaning = "stress is not linear in strain along warp and fill"
    remedy = "report secant moduli at the strains of use, or measure the curve in a biaxial test"
    parameters = (
        *several(
            _GAINS,
            "1",
            8.0,
            prior=2.0,
            reason="secant stiffness of coated fabrics changes by some per cent over 3 % strain",
            step=1e-2,
        ),
        # from no change of slope at all, a fit does not find where the knee is
        *(
            Parameter(
                name,
                "1",
                -0.95,
                3.0,
                prior=math.log(4.0),
                reason="polyester yields at 0.5 to 2 % strain, crimp straightens: slopes go to a "
                "quarter or to four times",
                step=1e-3,
                start=0.3,
                coordinate="log",  # of the slope beyond the knee, E(1 + s): it is never nothing
                origin=-1.0,
            )
            for name in _KNEES[:2]
        ),
        # a knee below 0.4 % strain would be that of another modulus
        *(
            Parameter(
                f"knee_{axis}",
                "1",
                0.004,
                0.05,
                null=KNEE,
                prior=0.01,
                reason="knees of coated fabrics lie at 1 to 3 % strain",
                step=1e-5,
                start=0.015,
                coordinate="log",  # a knee at no strain would be that of another modulus
                governor=f"s_{axis}",
            )
            for axis in "xy"
        ),
    )
    forms = (_GAINS, _KNEES, (*_GAINS, *_KNEES))
    shared = True

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        return replace(
            cloth,
            gain=(own["k_x"], own["k_y"]),
            bend=(own["s_x"], own["s_y"]),
            knee=(own["knee_x"], own["knee_y"]),
        )


EFFECT = NonlinearMaterial()
