"""How large is a field? The width of its prior by which the data are likeliest.

A field's own width is that of the largest ones that are usual: where it has a small part that an
effect does too, so wide a prior sees no difference between them. With the width that the evidence
finds (MacKay, 1992, "Bayesian interpolation", section 4.4) an effect beside it pays for what it
takes over, and a field that the data do not ask for is none.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from scipy.optimize import minimize_scalar

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.laplace import laplace
from bulgefit.gap.evidence.problem import Layout, Linearised

__all__ = ["amplitudes"]

#: Factors of a width between which one is looked for: a field a thousandth as large is none, and
#: nobody has seen one ten times as large.
_LEAST, _MOST = 1e-3, 1e1
#: Rounds over the fields of a model, whose sizes depend on each other.
_ROUNDS = 2


def amplitudes(here: Linearised, layout: Layout, fields: Collection[Owned]) -> dict[Owned, float]:
    """Factors of the prior widths of some groups by which the evidence is largest.

    Parameters
    ----------
    here : Linearised
        By a model's coordinates, near its most probable values.
    layout : Layout
    fields : collection of Owned
        Groups of the model, each with a width of its own.
    """
    found = dict.fromkeys(sorted(fields), 1.0)
    for _ in range(_ROUNDS if len(found) > 1 else 1):
        for name in found:

            def misses(log: float, name: Owned = name) -> float:
                scaled = layout.scaled({**found, name: float(np.exp(log))})
                return laplace(here, scaled, here.columns).score

            best = minimize_scalar(misses, bounds=np.log([_LEAST, _MOST]), method="bounded")
            found[name] = float(np.exp(best.x))
    return found
