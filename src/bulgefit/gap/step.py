"""How far does a fit step, and where to: damped, within bounds, and straight in logarithms.

What multiplies a stiffness steps in the logarithm of its distance from where the stiffness would
be nothing, so that steps keep products along valleys that are bent in both factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from scipy.optimize import lsq_linear

from bulgefit.effects.parameter import Key
from bulgefit.gap.effects import MODULI
from bulgefit.gap.keys import parameter_of
from bulgefit.gap.normal import Quadratic, scales

__all__ = ["along", "bounded_step"]

Floats = NDArray[np.float64]


def along(key: Key, value: float, step: float) -> float:
    """Where a step leads that is straight in the logarithm of what multiplies a stiffness.

    The slope after a knee is E(1 + s): to first order steps keep such products, and in logarithms
    they do so however far they go, along valleys that are bent in E and s.
    """
    origin = parameter_of(key).origin
    if origin is None:
        return value + step
    return float(origin + (value - origin) * np.exp(step / (value - origin)))


def bounded_step(
    current: Quadratic,
    values: Mapping[Key, float],
    keys: Sequence[Key],
    bounds: Floats,
    damping: float,
) -> Floats:
    """Damped Gauss-Newton step that stays in the bounds; a modulus grows to threefold at most.

    What has no effect here, and so a scale of zero, stays.
    """
    h, g = current.hessian, current.gradient
    here = np.array([values[key] for key in keys])
    low, high = np.array(
        [[_step_to(k, v, b) for b in pair] for k, v, pair in zip(keys, here, bounds, strict=True)]
    ).T
    moduli = np.array([key in MODULI for key in keys])
    low = np.where(moduli, np.maximum(low, np.log(0.6) * here), low)
    high = np.where(moduli, np.minimum(high, np.log(3.0) * here), high)
    low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
    scale = scales(h)
    root = _root(h * np.outer(scale, scale) + damping * np.eye(len(keys)))
    free = scale * cho_solve((root, True), g * scale)
    if ((free >= low) & (free <= high)).all():
        return free
    with np.errstate(divide="ignore"):
        bounds = np.array([low / scale, high / scale])
    found = lsq_linear(
        root.T,
        np.linalg.solve(root, g * scale),
        bounds=bounds,
        method="bvls" if len(keys) < 40 else "trf",
    )
    return np.clip(found.x * scale, low, high)


def _step_to(key: Key, value: float, target: float) -> float:
    """The step that leads to a target, as `along` goes."""
    origin = parameter_of(key).origin
    if origin is None:
        return target - value
    return float((value - origin) * np.log((target - origin) / (value - origin)))


def _root(scaled: Floats) -> Floats:
    """Cholesky factor of a matrix with a unit diagonal, lifted above what rounding did to it."""
    lowest = float(np.linalg.eigvalsh(scaled)[0])
    lifted = scaled + max(1e-9, -2.0 * lowest) * np.eye(len(scaled))
    return np.asarray(np.linalg.cholesky(lifted), dtype=np.float64)
