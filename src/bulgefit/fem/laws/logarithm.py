"""Logarithms in the lanes: series near the natural state, where they need neither branch nor call.

With u = (√x - 1)/(√x + 1), ½ ln x = 2 atanh u.
"""

from __future__ import annotations

import math

from bulgefit.fem.jit import merged

__all__ = ["NEAR", "TERMS", "half_log", "log_argument"]

#: Series are used up to this square of their argument, where as many terms leave 1e-16: areas
#: that are stretched 1.9 times, and stretches of the ratio 1.4.
NEAR, TERMS = 0.1, 16


@merged
def log_argument(x):
    """The u of ½ ln x = 2 atanh u."""
    root = math.sqrt(x)
    return (root - 1.0) / (root + 1.0)


@merged
def half_log(x):
    """½ ln x."""
    u = log_argument(x)
    sum_ = 0.0
    for n in range(TERMS - 1, -1, -1):
        sum_ = sum_ * (u * u) + 1.0 / (2.0 * n + 1.0)
    return 2.0 * u * sum_
