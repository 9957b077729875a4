"""How far do specimens of one cloth scatter, and what is the cloth's own stiffness?

Factors of all specimens and the moduli of their cloth may go opposite ways: the cloth's are those
of the mean specimen, in the logarithm, so that its factors multiply to 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bulgefit.effects.parameter import Key
from bulgefit.effects.registry import scatter
from bulgefit.gap.effects import MODULI
from bulgefit.gap.keys import parameter_of
from bulgefit.gap.regress import Regression

__all__ = ["AXES", "Scatter", "modulus_errors", "of_the_cloth", "scatter_of"]

Floats = NDArray[np.float64]

#: The modulus along each axis that a specimen's factor multiplies.
AXES = {
    Key.of(modulus): Key(effect.id, name)
    for effect in scatter().values()
    for modulus, name in effect.factors.items()
}
#: What is believed of the scatter: 5 to 10 % is usual for coated fabrics, one standard deviation of
#: its logarithm either way.
_USUAL = (0.05, 0.10)
#: Scatters (relative) over which it is averaged, evenly in the logarithm.
_SCATTERS = np.geomspace(1e-3, 1.0, 400)


@dataclass(frozen=True)
class Scatter:
    """Standard deviation of the logarithm of one factor over specimens of the cloth.

    Attributes
    ----------
    value, stderr : float
        Mean and standard deviation of what the specimens leave of the belief.
    factors : dict of specimen to (float, float)
        Each specimen's factor and its standard error.
    """

    value: float
    stderr: float
    factors: dict[int | None, tuple[float, float]]


def _factors(keys: Iterable[Key], factor: Key) -> list[Key]:
    """Those of one factor, of every specimen in their order; none where there is only one."""
    return sorted(k for k in keys if k._replace(specimen=None) == factor)


def of_the_cloth(values: Mapping[Key, float]) -> dict[Key, float]:
    """Values by the same keys, with the moduli of the mean specimen and factors about it."""
    out = dict(values)
    for modulus, factor in AXES.items():
        keys = _factors(values, factor)
        if keys:
            mean = float(np.exp(np.mean([np.log(values[k]) for k in keys])))
            out[modulus] = values[modulus] * mean
            out |= {k: values[k] / mean for k in keys}
    return out


def modulus_errors(fit: Regression) -> dict[Key, float]:
    """Standard errors (MPa) of the moduli of `of_the_cloth`."""
    errors = fit.standard_errors()
    values, covariance = of_the_cloth(fit.values), fit.covariance
    out = {m: errors[m] for m in MODULI}
    for modulus, factor in AXES.items():
        keys = _factors(fit.columns, factor)
        if keys:
            row = np.zeros(len(fit.columns))
            row[fit.columns.index(modulus)] = 1.0 / fit.values[modulus]
            for key in keys:
                row[fit.columns.index(key)] = 1.0 / (len(keys) * fit.values[key])
            out[modulus] = float(values[modulus] * np.sqrt(row @ covariance @ row))
    return out


def scatter_of(final: Regression) -> dict[str, Scatter]:
    """By modulus, E1 and E2; empty where there is one specimen.

    The n logarithms about their mean are known as m, with covariance C that the fit gives beside
    the priors it was given (taken off again); with a scatter s they are drawn with s²(1 - 11ᵀ/n).
    Their evidence, times a belief that is normal in ln s, is averaged over s (Gelman et al., 2013,
    "Bayesian data analysis", section 5.4).
    """
    out = {}
    for modulus, factor in AXES.items():
        keys = _factors(final.columns, factor)
        if len(keys) > 1:
            out[modulus.name] = _scatter(final, keys)
    return out


def _scatter(final: Regression, keys: Sequence[Key]) -> Scatter:
    place = [final.columns.index(k) for k in keys]
    logs = np.log([final.values[k] for k in keys])
    slopes = np.exp(-logs)
    covariance = final.covariance[np.ix_(place, place)] * np.outer(slopes, slopes)
    # an orthonormal basis of what is left once the mean is taken off
    about = np.linalg.svd(np.eye(len(keys)) - 1.0 / len(keys))[0][:, : len(keys) - 1]
    believed = parameter_of(keys[0]).prior
    mean, known = _beside_the_prior(about.T @ logs, about.T @ covariance @ about, believed)
    chance = np.array([_log_evidence(mean, known + s**2 * np.eye(len(mean))) for s in _SCATTERS])
    low, high = np.log(_USUAL)
    chance -= 0.5 * ((np.log(_SCATTERS) - 0.5 * (low + high)) / (0.5 * (high - low))) ** 2
    weight = np.exp(chance - chance.max())
    weight /= weight.sum()
    value = float(weight @ _SCATTERS)
    centred = logs - logs.mean()
    errors = np.sqrt(np.diag(about @ about.T @ covariance @ about @ about.T))
    return Scatter(
        value,
        float(np.sqrt(weight @ (_SCATTERS - value) ** 2)),
        {
            k.specimen: (float(np.exp(c)), float(np.exp(c) * e))
            for k, c, e in zip(keys, centred, errors, strict=True)
        },
    )


def _beside_the_prior(mean: Floats, covariance: Floats, prior: float) -> tuple[Floats, Floats]:
    """What the data alone say, of a posterior under independent priors about zero."""
    precision = np.linalg.inv(covariance)
    alone = precision - np.eye(len(mean)) / prior**2
    # what the data say nothing of has no precision but rounding's
    lowest = 1e-9 / prior**2
    values, vectors = np.linalg.eigh(alone)
    known = (vectors / np.maximum(values, lowest)) @ vectors.T
    return known @ precision @ mean, known


def _log_evidence(mean: Floats, covariance: Floats) -> float:
    """Of a normal mean about zero, up to a constant."""
    _, log_det = np.linalg.slogdet(covariance)
    return float(-0.5 * (log_det + mean @ np.linalg.solve(covariance, mean)))
