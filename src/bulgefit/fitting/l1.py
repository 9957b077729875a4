"""Rows of a linearised model, and what a descent on them needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.fem.jit import compiled

__all__ = ["Rows", "count_and_peaks"]

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals r - J d (measured minus modelled) and what they weigh.

    F(d) = Σ scale |r - J d|, or Σ scale (r - J d)²/2 where they are `squared`.

    Attributes
    ----------
    jacobian : (m, free) array
        Of the model.
    residual : (m,) array, mm
    scale : (m,) array
    whole : bool
        False where the rows are a sample that stands for all data.
    squared : bool
    """

    jacobian: Floats
    residual: Floats
    scale: Floats
    whole: bool
    squared: bool = False

    def value(self, step: Floats | None = None) -> float:
        """The linearised objective after a step."""
        left = self.residual if step is None else self.residual - self.jacobian @ step
        return float(self.scale @ (0.5 * left**2 if self.squared else np.abs(left)))

    def slope(self) -> Floats:
        """Its derivative at no step, (free,)."""
        pull = self.residual if self.squared else np.sign(self.residual)
        return -(self.scale * pull) @ self.jacobian

    def normal(self, step: Floats, floor: float) -> tuple[Floats, Floats]:
        """Hessian JᵀWJ and slope -JᵀW(r - J step), W = scale / max(|r - J step|, floor).

        Their quadratic lies above Σ scale |r - J d| rounded off below `floor`, and touches it at
        `step`: minimising it again and again descends (Hunter and Lange, 2004). Squared rows are
        a quadratic already, with W = scale.
        """
        size = self.jacobian.shape[1]
        hessian, slope = np.zeros((size, size)), np.zeros(size)
        _normal(self.jacobian, self.residual, self.scale, step, floor, self.squared, hessian, slope)
        return hessian, slope


def count_and_peaks(measured: NDArray[np.floating]) -> tuple[NDArray[np.int64], Floats]:
    """Measured values per frame and component (k, 3), and the largest |value| of each, (3,) mm."""
    counts = np.zeros((len(measured), 3), dtype=np.int64)
    peaks = np.zeros(3)
    for count, frame in zip(counts, measured, strict=True):
        seen = np.isfinite(frame)
        count[:] = seen.sum(axis=0)
        peaks = np.maximum(peaks, np.where(seen, np.abs(frame), 0.0).max(axis=0, initial=0.0))
    return counts, peaks


@compiled
def _normal(jacobian, residual, scale, step, floor, squared, hessian, slope):
    size = jacobian.shape[1]
    for row in range(jacobian.shape[0]):
        left = residual[row]
        for j in range(size):
            left -= jacobian[row, j] * step[j]
        weight = scale[row]
        if not squared:
            weight /= max(abs(left), floor)
        for j in range(size):
            share = weight * jacobian[row, j]
            slope[j] -= share * left
            for i in range(j + 1):
                hessian[j, i] += share * jacobian[row, i]
    for j in range(size):
        for i in range(j):
            hessian[i, j] = hessian[j, i]
