"""A specimen is not as stiff as the cloth that it was cut from."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from bulgefit.effects.base import Effect, Own
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Cloth

__all__ = ["EFFECT"]


class SpecimenFactor(Effect):
    """E1 and E2 of a specimen are those of its cloth times `warp` and `fill`.

    The curves along warp and fill, which are relative to E1 and E2, go with them.
    """

    id = "specimen_factor"
    place = "material"
    meaning = "the specimen is stiffer or softer than the cloth it was cut from"
    remedy = "test further specimens: their mean is the cloth's"
    parameters = tuple(
        Parameter(
            name,
            "1",
            0.5,
            2.0,
            null=1.0,
            prior=0.08,
            reason="moduli of nominally equal coated fabrics scatter by 5 to 10 %",
            step=1e-5,
            coordinate="log",
        )
        for name in ("warp", "fill")
    )
    factors = MappingProxyType({"E1": "warp", "E2": "fill"})

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        return replace(cloth, E1=own["warp"] * cloth.E1, E2=own["fill"] * cloth.E2)


EFFECT = SpecimenFactor()
