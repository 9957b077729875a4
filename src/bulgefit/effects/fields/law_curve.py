"""The material's place: stress that rises with strain along warp and fill, however it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.base import Own
from bulgefit.effects.fields.base import Field, Sampled
from bulgefit.effects.parameter import Parameter
from bulgefit.effects.places import Cloth
from bulgefit.fem.laws.potential import KNOTS

__all__ = ["EFFECT"]

Floats = NDArray[np.float64]

_AXES = ("warp", "fill")
_WARP, _FILL = (tuple(f"{axis}_{knot}" for knot in range(1, len(KNOTS))) for axis in _AXES)
#: Coated fabrics lose or gain 40 % of their slope within 2 % of strain, as crimp straightens and
#: coatings yield.
_CHANGE, _WITHIN = 0.4, 0.02


def _parameter(name: str, width: float) -> Parameter:
    """Change of the logarithm of the slope from one knot to the next, `width` (strain) on."""
    return Parameter(
        name,
        "1",
        -2.0,
        2.0,
        prior=_CHANGE * float(np.sqrt(width / _WITHIN)),
        reason="slopes of coated fabrics change by 40 % over 2 % strain, and less over less",
        step=1e-4,
    )


class LawCurve(Field):
    """Slopes of the stress are E exp(Σ changes) at the knots and linear between them.

    So stress rises with strain whatever the changes are; E is the slope at rest, and at a knot what
    laws with names (`nonlinear_material`) make of it there; what falls at the last knot falls by
    its share of what those leave before the cloth tears, as it stays so beyond. Independent changes
    whose variance is in proportion to the strain between knots make the logarithm of the slope a
    Wiener process, the smoothness prior of splines (Wahba, 1978, "Improper priors, spline smoothing
    and the problem of guarding against model errors in regression").
    """

    id = "law_curve"
    place = "material"
    meaning = "stress rises with strain along warp and fill by no simple law"
    remedy = "measure the curve in a biaxial test, or report the force at the strains of use"
    quantity = "relative change of the slope of stress"
    parameters = tuple(
        _parameter(name, width)
        for names in (_WARP, _FILL)
        for name, width in zip(names, np.diff(KNOTS), strict=True)
    )
    forms = (_WARP, _FILL, (*_WARP, *_FILL))
    shared = True
    of_several = True  # of one test, a gauge that errs over pressure looks alike

    def material(self, own: Own, cloth: Cloth) -> Cloth:
        """See the class."""
        return replace(cloth, curve=_curve(own)) if any(own.values()) else cloth

    def sampled(self, own: Own, radius: float, pressure: Floats) -> Sampled:
        """At the knots, along warp (0 degree) and fill (90 degree)."""
        strain, axis = np.tile(KNOTS, 2), np.repeat([0.0, 90.0], len(KNOTS))
        where = {"strain": strain, "from_warp_degree": axis}
        return Sampled(np.expm1(_curve(own)).ravel(), where)


def _curve(own: Own) -> Floats:
    """Logarithms (2, knots) of the slopes over that at rest."""
    changes = np.array([[own[name] for name in names] for names in (_WARP, _FILL)])
    return np.column_stack([np.zeros(2), np.cumsum(changes, axis=1)])


EFFECT = LawCurve()
