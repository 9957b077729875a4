"""What evidence would models have that differ from one in a few groups? By blocks of its inverse.

With the misfit linear near a point, each model's evidence is a matter of normal equations alone
(`laplace`), but with hundreds of coordinates and thousands of models each factorisation counts.
What goes is held at its null, where the Gaussian of what stays is the conditional one; what comes
is found beside what stays. Both take matrices of the size of what changes (Schur complements;
Boyd and Vandenberghe, 2004, "Convex optimization", section A.5.5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from bulgefit.gap.evidence.laplace import inverted, quadratic
from bulgefit.gap.evidence.orthant import log_share_above
from bulgefit.gap.evidence.problem import Columns, Layout, Linearised

__all__ = ["Forecast"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Forecast:
    """The evidence of models near one, by the misfit near a point.

    Attributes
    ----------
    layout : Layout
    inside, outside : (p,), (q,) int array
        Coordinates of the model, and the others that have derivatives.
    value : float
        -2 ln(likelihood × prior) at the model's optimum, and its Gaussian's ln det A.
    x : (n,) array
        Where the misfit was made linear.
    mean : (p,) array
        The optimum, whatever bounds there are.
    covariance : (p, p) array
        C = A⁻¹.
    carried : (p, q) array
        C B, B being the matrix between inside and outside.
    slope : (q,) array
        Of what is outside, at the optimum and the nulls.
    stiff : (q, q) array
        D - Bᵀ C B, D being the matrix of what is outside.
    """

    layout: Layout
    inside: Columns
    outside: Columns
    value: float
    x: Floats
    mean: Floats
    covariance: Floats
    carried: Floats
    slope: Floats
    stiff: Floats

    @classmethod
    def of(cls, here: Linearised, layout: Layout, columns: Columns) -> Forecast:
        """About the model that frees `columns`."""
        own = np.searchsorted(here.columns, columns)
        rest = np.setdiff1d(np.arange(len(here.columns)), own)
        here = _without(here, layout, columns, rest)
        value, slope, matrix = quadratic(here, layout, here.columns)
        value -= _believed(layout, here.columns[rest], here.x[here.columns[rest]])
        inner, between = matrix[np.ix_(own, own)], matrix[np.ix_(own, rest)]
        covariance, log_det = inverted(inner)
        carried, step = covariance @ between, covariance @ slope[own]
        return cls(
            layout,
            columns,
            here.columns[rest],
            float(value - slope[own] @ step + log_det),
            here.x,
            here.x[columns] + step,
            covariance,
            carried,
            slope[rest] - between.T @ step,
            matrix[np.ix_(rest, rest)] - between.T @ carried,
        )

    def score(self, columns: Columns) -> float:
        """-2 ln Z of the model that frees other columns."""
        gone = np.flatnonzero(~np.isin(self.inside, columns, assume_unique=True))
        come = np.flatnonzero(np.isin(self.outside, columns, assume_unique=True))
        lacked = self.inside[gone]
        at = self.layout.without(lacked, columns, self.x)
        back = at - self.mean[gone]
        block = self.covariance[np.ix_(gone, gone)]
        inverse: Floats = np.asarray(np.linalg.inv(block), dtype=np.float64)
        pull = inverse @ back
        score = self.value + float(back @ pull + np.linalg.slogdet(block)[1])
        score -= _believed(self.layout, lacked, at)
        new = self.outside[come]
        score += _believed(self.layout, new, self.x[new])
        across = self.carried[np.ix_(gone, come)]
        slope = self.slope[come] - across.T @ pull
        stiff = self.stiff[np.ix_(come, come)] + across.T @ inverse @ across
        step: Floats = np.asarray(np.linalg.solve(stiff, slope), dtype=np.float64)
        score += float(np.linalg.slogdet(stiff)[1] - slope @ step)
        score += 2.0 * float(np.log(self.layout.width[columns]).sum())
        return score + self._of_bounds(gone, come, inverse, pull, stiff, step)

    def _of_bounds(
        self,
        gone: NDArray[np.intp],
        come: NDArray[np.intp],
        inverse: Floats,
        pull: Floats,
        stiff: Floats,
        step: Floats,
    ) -> float:
        """What lower bounds leave of prior and posterior: of coordinates that have any."""
        stay = np.isfinite(self.layout.lower[self.inside])
        stay[gone] = False
        kept = np.flatnonzero(stay)
        new = np.flatnonzero(np.isfinite(self.layout.lower[self.outside[come]]))
        bound = np.concatenate([self.inside[kept], self.outside[come[new]]])
        if not len(bound):
            return 0.0
        to_gone = self.covariance[np.ix_(kept, gone)]
        along = self.carried[np.ix_(kept, come)]
        along = along - to_gone @ inverse @ self.carried[np.ix_(gone, come)]
        mean = np.concatenate(
            [
                self.mean[kept] + to_gone @ pull - along @ step,
                self.layout.null[self.outside[come[new]]] + step[new],
            ]
        )
        own = np.linalg.inv(stiff)
        inner = self.covariance[np.ix_(kept, kept)] - to_gone @ inverse @ to_gone.T
        across = -along @ own[:, new]
        covariance = np.block(
            [[inner + along @ own @ along.T, across], [across.T, own[np.ix_(new, new)]]]
        )
        lower, width = self.layout.lower[bound], self.layout.width[bound]
        prior = float(log_ndtr((self.layout.null[bound] - lower) / width).sum())
        return 2.0 * (prior - log_share_above(mean, covariance, lower))


def _believed(layout: Layout, columns: Columns, at: Floats) -> float:
    """-2 ln of the prior where coordinates stand: of those that mean nothing there none counts."""
    return float((layout.away(columns, at) ** 2).sum())


def _without(
    here: Linearised, layout: Layout, columns: Columns, rest: NDArray[np.intp]
) -> Linearised:
    """The same where a model of these columns has the rest (`Layout.without`)."""
    lacked, x, change = here.columns[rest], np.array(here.x), np.zeros(len(here.columns))
    x[lacked] = layout.without(lacked, columns, here.x)
    change[rest] = x[lacked] - here.x[lacked]
    turned = here.hessian @ change
    square = here.square + change @ (turned - 2.0 * here.gradient)
    return replace(here, x=x, square=float(square), gradient=here.gradient - turned)
