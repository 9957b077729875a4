"""How far does what a model leaves go beyond the noise, in the modes that effects have?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data
from bulgefit.gap.evidence.descend import Fit
from bulgefit.gap.evidence.problem import Layout
from bulgefit.model.virtual_test import Prediction

__all__ = ["determined", "temper"]

Floats = NDArray[np.float64]

#: Degree of the polynomials in x and y, and in p^(1/3), that effects and fields hardly go beyond.
DEGREE, COURSE = 5, 5


def temper(data: Sequence[Data], predictions: Sequence[Prediction], free: float) -> float:
    """Mean square of the residual's smooth modes over what correlated noise makes of it; 1 or more.

    In each component the residual is projected on orthonormal polynomials over the specimen times
    such over the frames, as effects go smoothly with place and pressure. Noise leaves each mode its
    inflation v as variance; a model that errs leaves more, and effects that it has not are told by
    just such modes: what errs in every frame alike counts as often as they do. So variances there
    are v T, and evidence counts 1/T of what it would.

    Parameters
    ----------
    free : float
        Coordinates that the data determined: each takes up to one mode away.
    """
    square, modes = 0.0, 0
    for d, p in zip(data, predictions, strict=True):
        x, y = d.specimen.reference[:, :2].T / d.specimen.test.radius
        orders = [(i, n - i) for n in range(DEGREE + 1) for i in range(n + 1)]
        over, _ = np.linalg.qr(np.stack([x**i * y**j for i, j in orders], axis=1))
        load = np.cbrt(d.specimen.recorded / d.specimen.recorded.max())
        along, _ = np.linalg.qr(np.vander(load, min(COURSE + 1, len(load))))
        seen = np.einsum("nk,fm,fnc->mkc", over, along, d.residual(p), optimize=True)
        square += float((seen**2).sum()) / d.inflation
        modes += seen.size
    return max(square / max(modes - free, 1.0), 1.0)


def determined(fit: Fit, layout: Layout) -> float:
    """How many of a fit's coordinates the data determined, and not their priors.

    Σ 1 - c_ii/s_i², by posterior variances c and prior widths s (MacKay, 1992, "Bayesian
    interpolation", eq. 4.9).
    """
    width = layout.width[layout.columns(fit.model)]
    return float(np.sum(1.0 - np.clip(np.diag(fit.covariance) / width**2, 0.0, 1.0)))
