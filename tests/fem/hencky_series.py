"""Hencky's series (1915) for the clamped disc at vanishing pressure, by its power series.

With x = (r/a)² and the radial force N = E t (p a/(E t))^(2/3) n(x), balance and compatibility give

    n² (x n'' + 2 n') = -1/32,     (1 - ν) n(1) + 2 n'(1) = 0 (no radial displacement at the rim),
    w0/a = ¼ ∫ dx/n(x) (p a/(E t))^(1/3).
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

TERMS = 120


def _coefficients(centre: float) -> np.ndarray:
    """Power series of n with n(0) = centre: n (n (x n'' + 2 n')) = -1/32."""
    n, g, h = np.zeros((3, TERMS))  # n; g = x n'' + 2 n'; h = n g
    n[0] = centre
    for k in range(TERMS - 1):
        target = -1.0 / 32.0 if k == 0 else 0.0
        # n h = target at order k, h_k = Σ n_i g_(k-i)
        h[k] = (target - n[1 : k + 1] @ h[:k][::-1]) / centre
        g[k] = (h[k] - n[1 : k + 1] @ g[:k][::-1]) / centre
        n[k + 1] = g[k] / ((k + 1) * (k + 2))
    return n


def apex_coefficient(nu: float) -> float:
    """W0 in w0/a = W0 (p a/(E t))^(1/3)."""
    powers = np.arange(TERMS)

    def rim(centre: float) -> float:
        n = _coefficients(centre)
        return float((1 - nu) * n.sum() + 2 * (powers * n).sum())

    n = _coefficients(brentq(rim, 0.3, 0.8, xtol=1e-15))
    at, weight = np.polynomial.legendre.leggauss(80)
    x = 0.5 * (at + 1)
    return float(0.25 * 0.5 * (weight / np.polynomial.polynomial.polyval(x, n)).sum())
