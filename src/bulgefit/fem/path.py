"""The displacement at any pressure between the solved levels.

Near zero pressure a flat membrane rises as w ~ p^(1/3), so paths live in s = p^(1/3), where they
are smooth: between levels that carry the displacement u and its slope du/ds, Hermite's
interpolation through up to four of them is far more accurate than the steps between them are
long. A flat membrane blown from the other side mirrors its shape: w is odd in s, the in-plane
displacement even. The mirror images of the lowest levels complete the stencils down to p = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bulgefit.errors import InputError
from bulgefit.fem.hermite import combine, hermite_weights

__all__ = ["Path"]

Floats = NDArray[np.float64]

#: Share of the highest pressure within which one is a level's: that is known by its cube root.
_AT_LEVEL = 1e-12


@dataclass(frozen=True, eq=False)
class Path:
    """Balanced shapes of one membrane against pressure.

    Attributes
    ----------
    nodes : (n, 2) array, mm
    cells : (m, 4) int array
    pressure : (levels,) array, MPa
        Solved pressures, ascending.
    displacement : (levels, n, 3) array, mm
    slope : (levels, n, 3) array, mm/MPa^(1/3)
        ∂u/∂s, s = p^(1/3).
    sensitivity : (levels, 4, n, 3) array, mm/MPa, or None
        ∂u/∂(D11, D22, D12, D33) at fixed pressure.
    sensitivity_slope : (levels, 4, n, 3) array, mm/MPa^(4/3), or None
        Its derivative ∂/∂s, so that the dense output's own derivative is exact.
    mirrored : bool
        True where the membrane lies flat without pressure, so that levels have mirror images.
    factorisations : int
        Spent on the whole path.
    errors : (levels - 1,) array, mm
        Estimated error of the dense output halfway between two levels; inf where it is not known.
    wrinkled : (levels,) int array
        Gauss points in tension-field relaxation.
    stable : (levels,) bool array
        False where the tangent was not positive definite.
    """

    nodes: Floats
    cells: NDArray[np.int64]
    pressure: Floats
    displacement: Floats
    slope: Floats
    sensitivity: Floats | None
    sensitivity_slope: Floats | None
    mirrored: bool
    factorisations: int
    errors: Floats
    wrinkled: NDArray[np.int64]
    stable: NDArray[np.bool_]

    @property
    def error_estimate(self) -> float:
        """The largest of the errors, mm."""
        return float(self.errors.max(initial=0.0))

    def errors_at(self, pressure: Floats) -> Floats:
        """Estimated error (k,) mm of the dense output at pressures (k,) MPa.

        Of a level there is none, nor is any told below the first one.
        """
        after = np.searchsorted(self.pressure, pressure, side="right") - 1
        apart = np.abs(pressure[:, None] - self.pressure).min(axis=1)
        inside = (after >= 0) & (after < len(self.errors)) & (apart > _AT_LEVEL * self.pressure[-1])
        out = np.zeros(len(after))
        out[inside] = self.errors[after[inside]]
        return out

    def __call__(self, pressure: ArrayLike) -> Floats:
        """Displacement (k, n, 3) mm at pressures (k,) MPa: the dense output."""
        return combine(self.weights(pressure), self.displacement, self.slope)

    def stiffness_sensitivity(self, pressure: ArrayLike) -> Floats:
        """∂u/∂(D11, D22, D12, D33) at pressures (k,) MPa: (4, k, n, 3) mm/MPa."""
        if self.sensitivity is None or self.sensitivity_slope is None:
            raise ValueError("the path was traced without sensitivities")
        weights = self.weights(pressure)
        return np.stack(
            [
                combine(weights, self.sensitivity[:, j], self.sensitivity_slope[:, j])
                for j in range(4)
            ]
        )

    def weights(self, pressure: ArrayLike) -> tuple[Floats, Floats]:
        """Weights of level values and slopes, each (3 components, k, levels)."""
        p = self._checked(pressure)
        return hermite_weights(np.cbrt(self.pressure), np.cbrt(p), mirrored=self.mirrored)

    def _checked(self, pressure: ArrayLike) -> Floats:
        p = np.atleast_1d(np.asarray(pressure, dtype=float))
        low, high = (0.0 if self.mirrored else self.pressure[0]), self.pressure[-1]
        if not (p.min() >= low - 1e-12 and p.max() <= high * (1 + 1e-12)):
            raise InputError(
                f"pressure {10 * p.min():g} to {10 * p.max():g} bar lies outside the traced "
                f"range {10 * low:g} to {10 * high:g} bar"
            )
        return np.clip(p, low, high)
