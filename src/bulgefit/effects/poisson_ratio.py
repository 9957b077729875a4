"""Poisson's ratio is not the one that the test states."""

from __future__ import annotations

from dataclasses import replace

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]


class PoissonRatio(Effect):
    """nu12, the contraction along fill under tension along warp; its null is the test's."""

    id = "poisson_ratio"
    place = "material"
    meaning = "Poisson's ratio is not the one assumed"
    remedy = "measure the contraction in a uniaxial or biaxial test of the fabric"
    parameters = (
        Parameter(
            "nu12",
            "1",
            0.0,
            0.5,
            null=None,
            prior=0.08,
            reason="published ratios of coated fabrics scatter by about 0.1",
            step=1e-5,
        ),
    )
    shared = True

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        return replace(cloth, nu12=own["nu12"])


EFFECT = PoissonRatio()
