"""Where does a group do what another one, which hides it, does in a fit?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Owned
from bulgefit.gap.evidence.problem import Columns, Layout, Linearised

__all__ = ["handed_over"]

Floats = NDArray[np.float64]


def handed_over(around: Linearised, layout: Layout, old: Columns, name: Owned) -> Floats:
    """The point where a group, in its largest form, has taken over what it can of another's part.

    What it does there to first order is taken off the other's coordinates, so the misfit differs
    by its second order alone.

    Parameters
    ----------
    around : Linearised
        At a fit, by every coordinate.
    layout : Layout
    old : int array
        Coordinates of the group that hides it.
    name : Owned
        The group.

    Returns
    -------
    (n,) array
    """
    new, x = layout.own(name, len(layout.groups[name].shapes) - 1), np.array(around.x)

    def alike(to: Columns, of: Columns, change: Floats) -> Floats:
        """What coordinates do like a change of others, by least squares under their prior."""
        here, there = np.searchsorted(around.columns, to), np.searchsorted(around.columns, of)
        own = around.hessian[np.ix_(here, here)] + np.diag(layout.width[to] ** -2)
        moved = np.linalg.solve(own, around.hessian[np.ix_(here, there)] @ change)
        return np.asarray(moved, dtype=np.float64)

    taken = alike(new, old, x[old] - layout.null[old])
    x[new] = layout.null[new] + taken
    x[old] -= alike(old, new, taken)
    return x
