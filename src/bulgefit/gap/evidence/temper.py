"""How far does what a model leaves go beyond the noise, in the modes that effects have?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bulgefit.gap.data import Data
from bulgefit.model.virtual_test import Prediction

__all__ = ["temper"]

Floats = NDArray[np.float64]

#: Degree of the polynomials in x and y that effects and fields hardly go beyond.
DEGREE = 5


def temper(data: Sequence[Data], predictions: Sequence[Prediction], free: int) -> float:
    """Mean square of the residual's smooth modes over what correlated noise makes of it; 1 or more.

    In each frame and component the residual is projected on orthonormal polynomials over the
    specimen. Noise leaves each mode its inflation v as variance; a model that errs leaves more, and
    effects that it has not are told by just such modes. So variances there are v T, and evidence
    counts 1/T of what it would.

    Parameters
    ----------
    free : int
        Coordinates that were fitted: each takes up to one mode away.
    """
    square, modes = 0.0, 0
    for d, p in zip(data, predictions, strict=True):
        x, y = d.specimen.reference[:, :2].T / d.specimen.test.radius
        orders = [(i, n - i) for n in range(DEGREE + 1) for i in range(n + 1)]
        basis, _ = np.linalg.qr(np.stack([x**i * y**j for i, j in orders], axis=1))
        seen = np.einsum("nk,fnc->fkc", basis, d.residual(p))
        square += float((seen**2).sum()) / d.inflation
        modes += seen.size
    return max(square / max(modes - free, 1), 1.0)
